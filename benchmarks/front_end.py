"""The front end against scenes whose answer is known, stage by stage: python benchmarks/front_end.py SCENE... [--record NAME]

A scene is a folder with clip.mcap, given.yaml and truth.npz; a clip put through a sensor model is a folder like any other. One row
per scene, the last is the median. --record puts the medians among the results as front_end_NAME_<figure>.

iou: masks of all frames from the given first one, and (motion_) from motion alone. parts: how many too many or too few colour finds in
the true silhouette, and the least IoU of a true part. depth: error of frame 0's surface. track: error of
a displacement per coordinate; common to all points of a frame, their own, along the line of sight, as the tracks themselves claim, as
a share of the motion; z_: error over the deviation that each position claims, root mean square; tenth_: the largest factor between the
two in any tenth of the positions, by what they claim. volume: of the filled body, over the truth's. particles: at 4 cells over the thickness, 2 per cell and axis.
frame0: masked PSNR of the Gaussians. _s: seconds of a stage.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from table import record, row
from true_scene import TrueScene

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.body import build_body
from diffphys_ros.depth import surface_depth
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.evidence.pixels import static_background
from diffphys_ros.metrics.image import psnr_masked
from diffphys_ros.particles import fill
from diffphys_ros.progress import finished
from diffphys_ros.render import Rasterizer
from diffphys_ros.segment import label_clip
from diffphys_ros.segment.label import first_labels
from diffphys_ros.splats import fit_splats
from diffphys_ros.tracks import follow
from diffphys_ros.types import Clip, object_mask

CELLS, PER_CELL = 4, 2.0  # over the thickness, and particles per cell and axis
WIDTH = 9  # of a column, at the least
UNITS = {"mm": "mm", "s": "s", "db": "dB", "pct": "%"}  # by the last word of a figure's name


@dataclass
class Case:
    """One scene on its way through the front end."""

    settings: config.Settings
    clip: Clip
    truth: TrueScene
    device: str
    depth0: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (H, W) [m]
    seconds: dict[str, float] = field(default_factory=dict)  # per stage

    @classmethod
    def of(cls, folder: Path, device: str) -> Case:
        """The scene in a folder, read."""
        settings = config.layered([folder / "given.yaml"])
        clip = read_clip(folder / "clip.mcap", settings)
        return cls(settings, clip, TrueScene.of(folder / "truth.npz", clip), device)

    def timed(self, stage: str, work: Callable[[], object]) -> object:
        """What a stage gives; its seconds are kept: the processor's, which others on it do not lengthen, or on a GPU the clock's."""
        clock = time.process_time if self.device == "cpu" else time.perf_counter
        start = clock()
        done = work()
        self.seconds[stage] = clock() - start
        return done


def masks(case: Case) -> dict[str, float]:
    """Labels of every frame from the given first mask."""
    labels = case.timed("masks", lambda: label_clip(case.clip, case.settings))
    case.clip = case.clip.with_labels(labels)
    iou = _iou(case, labels)
    return {"iou_min": iou.min(), "iou_mean": iou.mean()}


def motion(case: Case) -> dict[str, float]:
    """Labels of every frame from motion alone."""
    segment, scene = replace(case.settings.segment, method="motion"), replace(case.settings.scene, first_mask=None)
    settings = replace(case.settings, segment=segment, scene=scene)
    iou = _iou(case, case.timed("motion", lambda: label_clip(replace(case.clip, labels=None), settings)))
    return {"motion_iou_min": iou.min(), "motion_iou_mean": iou.mean()}


def parts(case: Case) -> dict[str, float]:
    """Parts by colour alone, in the true silhouette."""
    true = case.truth.surface_part(case.clip.camera)
    found = case.timed("parts", lambda: first_labels(case.truth.mask[0].astype(np.uint8), case.clip, case.settings))
    pairs = [[(found == j) & (true == k) for j in range(1, found.max() + 1)] for k in range(1, true.max() + 1)]
    iou = [max(p.sum() / ((found == j) | (true == k)).sum() for j, p in enumerate(row, 1)) for k, row in enumerate(pairs, 1)]
    return {"parts_wrong": abs(int(found.max()) - int(true.max())), "parts_iou_min": min(iou)}


def depth(case: Case) -> dict[str, float]:
    """Surface depth of frame 0, where the object is seen and the front end says so."""
    case.depth0 = case.timed("depth", lambda: surface_depth(case.clip, case.settings)[0])
    true = case.truth.surface_depth(case.clip.camera)
    error = 1e3 * np.abs(case.depth0 - true)[(case.depth0 > 0) & (true > 0)]
    return {"depth_median_mm": float(np.median(error)), "depth_p90_mm": float(np.quantile(error, 0.9))}


def tracks(case: Case) -> dict[str, float]:
    """Displacements of tracked points, per coordinate: in all, the part common to all points of a frame, the rest. Without a depth
    topic motion along the line of sight is not tracked, and not asked for."""
    found = case.timed("tracks", lambda: follow(case.clip, case.depth0, case.settings))
    valid = found.valid & (np.arange(len(found.valid)) > 0)[:, None]
    true = case.truth.displacement(found.points[0])
    error = np.where(valid[..., None], found.points - found.points[0] - true, 0.0)
    sight = found.points[0] - case.clip.camera.position
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    along = (error * sight).sum(-1)
    across = error - along[..., None] * sight
    if not found.has_depth:
        error = across
    coordinates, count = 3 if found.has_depth else 2, valid.sum(1)
    total = (error**2).sum() / count.sum()
    common = ((error.sum(1) ** 2).sum(1) / np.maximum(count, 1)).sum() / count.sum()
    return {
        "tracks": found.points.shape[1],
        "valid_pct": 100 * valid[case.clip.seen][1:].mean(),
        "track_mm": 1e3 * np.sqrt(total / coordinates),
        "common_mm": 1e3 * np.sqrt(common / coordinates),
        "own_mm": 1e3 * np.sqrt((total - common) / coordinates),
        "sight_mm": 1e3 * np.sqrt((along**2).sum() / count.sum()) if found.has_depth else np.nan,
        "claimed_mm": 1e3 * found.noise_m,
        **_calibration(np.sqrt((across**2).sum(-1) / 2)[valid], found.sd_m[valid, 0], "across"),
        **(_calibration(np.abs(along)[valid], found.sd_m[valid, 1], "sight") if found.has_depth else {}),
        "track_pct": 100 * np.sqrt(total / (true[valid] ** 2).sum(1).mean()),
    }


def _calibration(error: np.ndarray, claimed: np.ndarray, direction: str) -> dict[str, float]:
    tenths = np.array_split(np.argsort(claimed, kind="stable"), 10)
    factor = np.array([np.sqrt((error[t] ** 2).mean() / (claimed[t] ** 2).mean()) for t in tenths])
    return {f"z_{direction}": np.sqrt(((error / claimed) ** 2).mean()), f"tenth_{direction}": np.exp(np.abs(np.log(factor)).max())}


def body(case: Case) -> dict[str, float]:
    """The filled solid."""
    solid = case.timed("body", lambda: build_body(case.clip, case.depth0, case.settings))
    dx = float(2 * solid.half_thickness[solid.inside].max() / CELLS)
    particles = len(fill(solid, dx, PER_CELL).own)
    return {"volume_pct": 100 * (solid.volume_m3 / case.truth.volume_m3 - 1), "particles": particles}


def splats(case: Case) -> dict[str, float]:
    """Gaussians of frame 0, rendered over the scene behind."""
    clip = case.clip
    found = case.timed("splats", lambda: _fitted(case))
    values = (found.mean, found.rotation, found.scale, found.opacity, found.color, static_background(clip).astype(np.float32) / 255)
    with torch.no_grad():
        image = Rasterizer(clip.camera, case.device).render(*(torch.as_tensor(a, device=case.device) for a in values))[0]
    return {"gaussians": len(found.mean), "frame0_db": psnr_masked(image, torch.as_tensor(clip.frames[0]), object_mask(clip.labels[0]))}


STAGES: dict[str, Callable[[Case], dict[str, float]]] = {
    "masks": masks,
    "parts": parts,
    "depth": depth,
    "tracks": tracks,
    "body": body,
    "splats": splats,
    "motion": motion,
}
NEEDED = ("masks", "depth")  # by all others


def _iou(case: Case, labels: object) -> np.ndarray:
    """Intersection over union with the truth, of every frame received (T,)."""
    found, true = object_mask(np.asarray(labels))[case.clip.seen], case.truth.mask[case.clip.seen]
    return (found & true).sum((1, 2)) / np.maximum((found | true).sum((1, 2)), 1)


def _fitted(case: Case) -> object:
    return finished(fit_splats(case.clip.frames[0], case.clip.labels[0], case.depth0, case.clip.camera, case.settings, case.device))


def measured(folder: Path, wanted: list[str], device: str) -> dict[str, float]:
    """All figures of one scene; those of a stage that refuses the clip are left out, and the reason printed."""
    case, figures = Case.of(folder, device), {}
    for name in (n for n in STAGES if n in wanted or n in NEEDED):
        try:
            figures |= STAGES[name](case)
        except InputError as error:
            print(f"{folder.name}: {name}: {error}")
    return {k: float(v) for k, v in figures.items()} | {f"{stage}_s": s for stage, s in case.seconds.items()}


def medians(rows: list[dict[str, float]]) -> dict[str, float]:
    """Of every figure over the scenes that have it."""
    return {name: float(np.median([r[name] for r in rows if name in r])) for name in dict.fromkeys(n for r in rows for n in r)}


def show(name: str, figures: dict[str, float], columns: list[str]) -> None:
    """One line of the table."""
    print(f"{name:16s}" + "".join(f"{figures.get(c, float('nan')):{max(len(c), WIDTH) + 1}.4g}" for c in columns), flush=True)


def main() -> None:
    """Read the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path)
    parser.add_argument("--stages", nargs="+", choices=list(STAGES), default=list(STAGES))
    parser.add_argument("--device", default="cpu", help="of the Gaussians' fit")
    parser.add_argument("--record", metavar="NAME")
    options = parser.parse_args()
    rows: list[dict[str, float]] = []
    for folder in options.scenes:
        rows.append(measured(folder, options.stages, options.device))
        if len(rows) == 1:
            print(" " * 16 + "".join(f" {c:>{WIDTH}s}" for c in rows[0]))
        show(folder.name, rows[-1], list(rows[0]))
    middle = medians(rows)
    show("median", middle, list(rows[0]))
    if options.record:
        unit = {name: UNITS.get(name.rsplit("_", 1)[-1], "") for name in middle}
        record([row(f"front_end_{options.record}_{name}", value, unit[name], device=options.device) for name, value in middle.items()])


if __name__ == "__main__":
    main()
