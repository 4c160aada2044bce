"""Figures of stored recoveries, one row each, kept in rows.json: rows of another device or length of run stay beside them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from diffphys_ros import result, store
from diffphys_ros.batch import read_status
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError
from diffphys_ros.metrics.lpips import Lpips
from diffphys_ros.types import Clip, MpmProblem, Recovery

from .oracle import moved_freely
from .pictures import frozen, moving, scores, warped
from .variants import QUICK

ORACLE = "Gaussians moved by free flow"


class Run(NamedTuple):
    """What the rows of one run share."""

    clip: str
    device: str
    quick: bool


@dataclass(frozen=True)
class Row:
    """One line of a table. None: there is none."""

    clip: str
    variant: str
    device: str
    quick: bool
    psnr: float | None = None  # masked [dB]
    ssim: float | None = None
    lpips: float | None = None
    seconds: float | None = None
    memory_mb: float | None = None
    young_log10_error: tuple[float | None, ...] = ()  # by part, signed, whether E is called identified or not
    identified: bool | None = None
    force_cosine: float | None = None
    still: bool = False  # nothing moves in its pictures: no motion was found that shows the clip better, or material alone was sought
    why: str = ""  # there are no figures

    @property
    def key(self) -> tuple[str, str, str, bool]:
        return self.clip, self.variant, self.device, self.quick


def of_recovery(folder: Path, video: np.ndarray, run: Run, *, variant: str, lpips: Lpips | None = None, truth: Path | None = None, scored: int | None = None) -> Row:
    """The row of a batch's folder; one that failed says why. video uint8 (T, H, W, 3); of the pictures the first `scored` count, None: all."""
    status = read_status(folder)
    if status is None or status.state != "done":
        return Row(run.clip, variant, run.device, run.quick, why=status.reason or status.state if status else "not run")
    recovery, metrics = result.load(folder), result.read_metrics(folder)
    time = {"seconds": status.seconds, "memory_mb": status.memory_mb}
    about: dict[str, Any] = {**time, "still": not recovery.force.any(), "identified": bool(recovery.identified.all()), "force_cosine": metrics.get("net_force_cosine")}
    if truth is not None:
        about["young_log10_error"] = young_errors(recovery, truth)
    if recovery.frames is None:
        return Row(run.clip, variant, run.device, run.quick, why="holds no rendered frames", **about)
    return _scored(Row(run.clip, variant, run.device, run.quick, **about), recovery.frames[:scored], video, lpips)


def without_physics(video: np.ndarray, run: Run, *, lpips: Lpips | None = None) -> list[Row]:
    """Rows of the frozen first frame and of the flow warp, over the frames that a run of this length fits."""
    shown = video[: int(QUICK["frames.fit"])] if run.quick else video
    made = {"frozen first frame": frozen(shown), "flow warp of frame 0": warped(shown)}
    return [_scored(Row(run.clip, name, run.device, run.quick), frames, video, lpips) for name, frames in made.items()]


def of_oracle(clip: Clip, settings: Settings, run: Run, *, lpips: Lpips | None = None) -> Row:
    """The row of Gaussians that no physics moves, over the frames that a run of this length fits."""
    shown = clip.part(0, min(len(clip), int(QUICK["frames.fit"]))) if run.quick else clip
    row = Row(run.clip, ORACLE, run.device, run.quick)
    try:
        frames = moved_freely(shown, settings)
    except InputError as error:
        return replace(row, why=str(error))
    return _scored(row, frames, clip.frames, lpips)


def young_errors(recovery: Recovery, truth: Path) -> tuple[float | None, ...]:
    """log10 of the simulated Young's modulus over the true one, by the truth's part, also where the result does not call it identified."""
    with np.load(truth) as z:
        vertices, part, true = z["rest_vertices"], z["vertex_part"], z["part_E"]
    young = young_moved_with(recovery)
    nearest = part[cKDTree(vertices).query(recovery.points)[1]]
    return tuple(float(np.log10(np.median(young[nearest == k]) / true[k])) if (nearest == k).any() else None for k in range(len(true)))


def young_moved_with(recovery: Recovery) -> np.ndarray:
    """Young's modulus of the simulation, corrected for its grid [Pa], (N,): that of a part which is not identified, too."""
    return recovery.young_solver * (recovery.apparent_stiffness if isinstance(recovery.simulation, MpmProblem) else 1.0)


def merged(path: Path, rows: Iterable[Row]) -> list[Row]:
    """Writes rows into the file, in the place of those of the same clip, variant, device and length of run; returns all."""
    kept = {row.key: row for row in read(path)} | {row.key: row for row in rows}
    text = json.dumps([asdict(row) for row in kept.values()], indent=1) + "\n"
    store.write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return list(kept.values())


def read(path: Path) -> list[Row]:
    """Rows of the file; none where there is none."""
    if not path.exists():
        return []
    return [Row(**{**row, "young_log10_error": tuple(row["young_log10_error"])}) for row in json.loads(path.read_text(encoding="utf-8"))]


def _scored(row: Row, frames: np.ndarray, video: np.ndarray, lpips: Lpips | None) -> Row:
    mask, video = moving(video), video[: len(frames)]
    if not mask.any():
        return replace(row, why="nothing moves in this clip")
    psnr, ssim = scores(frames, video, mask)
    distance = float(np.mean([lpips.masked(a, b, mask) for a, b in zip(frames[1:], video[1:], strict=True)])) if lpips else None
    return replace(row, psnr=psnr, ssim=ssim, lpips=distance)
