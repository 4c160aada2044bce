"""Time of the renderer, forward and backward together: python benchmarks/raster.py [cpu] [cuda]

Gaussians that cover the picture evenly, as large as their distance from each other, in one frame and in a batch of eight
that move. Cotangents of image and alpha are given; every run ends with the device's last work, the median of many counts.
On CUDA the same frames go through gsplat, turn by turn, where it is installed (rows ending in _vs_gsplat: our time over
its own).
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from peer import gsplat_cameras, gsplat_frames, gsplat_version, has_gsplat, per_frame
from table import Row, record, row

from diffphys_ros.render import Rasterizer
from diffphys_ros.types import Camera

SIZES = ((480, 360), (1024, 576))  # [px]
COUNTS = (5_000, 20_000, 100_000)
BATCH = 8
REPEATS = {"cpu": 7, "cuda": 60}
WARM = 5
OVERLAP = 0.7  # standard deviation over the distance between neighbours
MOVED_M = 0.02  # over the batch
HARMONICS = 16  # coefficients of degree 3


def camera_of(width: int, height: int) -> Camera:
    """At the world's origin, looking along z."""
    focal = 1.2 * width
    return Camera(np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]), np.eye(4), width, height)


def gaussians(camera: Camera, count: int, frames: int, coefficients: int, device: str) -> list[torch.Tensor]:
    """Leaves mean (T, G, 3), rotation (T, G, 4), scale, opacity, color."""
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.8, 1.4, count)
    mean = camera.backproject(rng.uniform([0, 0], [camera.width, camera.height], (count, 2)), depth)
    spread = OVERLAP * np.sqrt(camera.width * camera.height / count) * depth[:, None] / camera.focal_px
    moved = np.linspace(0, MOVED_M, frames)[:, None, None]
    color = rng.normal(0, 0.3, (count, coefficients, 3)) if coefficients else rng.random((count, 3))
    values = (mean + moved, np.broadcast_to(rng.normal(size=(count, 4)), (frames, count, 4)), spread * rng.uniform(0.5, 1.5, (count, 3)))
    return [
        torch.tensor(v, dtype=torch.float32, device=device, requires_grad=True) for v in (*values, rng.uniform(0.2, 0.95, count), color)
    ]


def turn(render: Callable[[], tuple[torch.Tensor, ...]], leaves: list[torch.Tensor], seen: list[torch.Tensor]) -> Callable[[], float]:
    """One run, forward and backward, which returns its time [ms]."""

    def run() -> float:
        start = clock(leaves[0].device)
        torch.autograd.grad(render()[: len(seen)], leaves, seen)
        return 1e3 * (clock(leaves[0].device) - start)

    return run


def clock(device: torch.device) -> float:
    """Time at which everything launched so far has ended [s]."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def medians(runs: list[Callable[[], float]], repeats: int) -> list[float]:
    """Median times of several runs that take turns [ms]."""
    times = [[run() for run in runs] for _ in range(WARM + repeats)]
    return [statistics.median(column) for column in zip(*times[WARM:], strict=True)]


def measure(size: tuple[int, int], count: int, frames: int, device: str, coefficients: int = 0) -> list[Row]:
    """Rows of one scene: our time; gsplat's beside it, where it is there."""
    camera, kind = camera_of(*size), torch.device(device).type
    leaves, renderer = gaussians(camera, count, frames, coefficients, device), Rasterizer(camera, device)
    generator = torch.Generator().manual_seed(0)
    seen = [torch.randn(frames, *size[::-1], *n, generator=generator).to(device) for n in ((3,), ())]
    runs = [turn(lambda: renderer.render_frames(*leaves), leaves, seen)]
    if kind == "cuda" and has_gsplat():
        theirs, cameras = per_frame(leaves), gsplat_cameras(camera, frames, device)
        runs.append(turn(lambda: gsplat_frames(theirs, cameras, size), theirs, seen))
    found = medians(runs, REPEATS[kind])
    suffix = ("_sh3" if coefficients else "") + (f"_{frames}_frames" if frames > 1 else "")
    name = f"raster_{'cpu_' if kind == 'cpu' else ''}{count // 1000}k_{size[0]}x{size[1]}{suffix}"
    rows = [row(name, found[0], "ms", device=device)]
    if len(found) > 1:
        theirs_too = [
            row(f"{name}_gsplat", found[1], "ms", device=device),
            row(f"{name}_vs_gsplat", found[0] / found[1], "x", device=device),
        ]
        rows += [replace(r, versions=f"{r.versions}, gsplat {gsplat_version()}") for r in theirs_too]
    return rows


def on_cuda() -> list[Row]:
    """Every size and count, one frame and a batch; spherical harmonics once."""
    if not has_gsplat():
        print("gsplat is not installed here: its rows are left out.")
    rows = [r for frames in (1, BATCH) for size in SIZES for count in COUNTS for r in measure(size, count, frames, "cuda:0")]
    return rows + measure(SIZES[1], COUNTS[1], 1, "cuda:0", HARMONICS)


def main() -> None:
    """Measure the devices named, or what this machine has; its processor on one core."""
    torch.set_num_threads(1)
    wanted = sys.argv[1:] or ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    rows: list[Row] = []
    if "cpu" in wanted:
        rows += [replace(r, device=f"{r.device} (one core)") for r in measure(SIZES[0], COUNTS[0], 1, "cpu")]
    if "cuda" in wanted:
        rows += on_cuda()
    record(rows)


if __name__ == "__main__":
    main()
