"""Reading a truth, and what lies where and when in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial import cKDTree

from .. import shapes, store
from ..errors import InputError

NEIGHBOURS = 4  # of the inverse-distance interpolation between points and truth vertices
SAME_FRAME = 0.1  # of a frame: what two clocks may differ by, from jitter of the stamps and the period that is estimated from them

TRUTH = {
    "rest_vertices": "number V 3", "positions": "number T V 3", "part_E": "number n", "vertex_E": "number V", "vertex_part": "whole V", "interface": "truth V",
    "vertex_volume": "number V", "clamped": "truth V", "force_density": "number T V 3",
}  # fmt: skip
STATED_FORCE = ("net_force_sd", "net_force_peak", "net_force_peak_sd")
RECOVERY = {name: shapes.RECOVERY[name] for name in ("points", "young", "force", "trajectory")}
_WHERE_KNOWN = {  # read where they are there
    "stamps_ns": "?whole s", "time": "?number s", "fps": "?number", "period_s": "?number", "part_rho": "?number n", "vertex_mass": "?number V",
    **{name: f"?{shapes.RECOVERY[name]}" for name in ("density", "log10_young_sd", "log10_specific_sd", "young_lower", *STATED_FORCE)}, "net_force": "?real T 3",
}  # fmt: skip

Arrays = Mapping[str, np.ndarray]


def read_truth(path: str | Path) -> dict[str, np.ndarray]:
    """The arrays of a truth.npz that are scored. Raises InputError where one is missing."""
    return read(path, "truth", TRUTH)


def read(path: str | Path, what: str, needed: dict[str, str]) -> dict[str, np.ndarray]:
    arrays = store.read_arrays(path, what)
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise InputError(f"{what} {path}: misses {', '.join(missing)}; give a {what}.npz that holds {', '.join(needed)}")
    try:
        sizes = shapes.check(arrays, needed | _WHERE_KNOWN)
        shapes.require(min(sizes.values()) > 0, "an array is empty")
        if what == "truth":
            shapes.require((arrays["part_E"] > 0).all(), "part_E must be > 0")
    except shapes.MisshapenError as error:
        raise InputError(f"{what} {path}: {error}; give the {what}.npz as it was written") from error
    return {name: arrays[name] for name in (*needed, *_WHERE_KNOWN) if name in arrays}


def on_truth_frames(recovery: Arrays, truth: Arrays, source: str | Path) -> tuple[Arrays, Arrays]:
    """Both over the frames of the truth that the clip lasts: motion interpolated, force averaged over what it acts for.

    A clip may have lost frames at its ends, or every other one, which its clock takes for a longer period.
    """
    at, length = _frames_of_clip(recovery, truth), len(recovery["trajectory"])
    if np.array_equal(at, np.arange(len(at))):
        return recovery, truth
    inside = (at >= 0) & (at <= length - 1)
    if inside.sum() < 2 or length < 2:
        raise InputError(f"recovery {source}: lasts {inside.sum()} frames of the truth, at least 2 are compared; give the truth of this clip")
    ratio, at = float(np.median(np.diff(at))), at[inside]
    acting = {name: recovery[name].astype(float) for name in ("force", "net_force", "net_force_sd") if name in recovery}
    # cubic: on the straight line between two of every other frame a swing would lose 5 % of its size
    path = make_interp_spline(np.arange(length), recovery["trajectory"].astype(float), k=min(3, length - 1))
    resampled = {
        "trajectory": path(at),
        **{name: np.stack([_mean_between(each, start, min(start + ratio, length)) for start in at]) for name, each in acting.items()},
    }
    return {**recovery, **resampled}, {**truth, **{name: truth[name][inside] for name in ("positions", "force_density")}}


def _frames_of_clip(recovery: Arrays, truth: Arrays) -> np.ndarray:
    """Number, with a fraction, of each of the truth's frames (T,) among those of the clip."""
    count = len(truth["positions"])
    if "stamps_ns" in truth:
        seconds = (truth["stamps_ns"] - truth["stamps_ns"][0]) * 1e-9
    elif "time" in truth:
        seconds = truth["time"] - truth["time"][0]
    else:
        seconds = np.arange(count) / float(truth["fps"]) if "fps" in truth else np.zeros(0)
    if "period_s" not in recovery or len(seconds) != count or count < 2 or not (np.diff(seconds) > 0).all():
        return np.arange(count)
    seconds = seconds - seconds[_first_frame(recovery, truth)]
    at = seconds / float(recovery["period_s"])
    whole = np.rint(at)
    return np.where(np.abs(at - whole) < SAME_FRAME, whole, at)


def _first_frame(recovery: Arrays, truth: Arrays) -> int:
    """The truth's frame in which the clip begins: the first, unless stamps of one clock say another."""
    if "stamps_ns" not in truth or "stamps_ns" not in recovery or not len(recovery["stamps_ns"]):
        return 0
    away = np.abs(truth["stamps_ns"].astype(np.int64) - int(recovery["stamps_ns"][0])) * 1e-9
    nearest = int(away.argmin())
    return nearest if away[nearest] <= float(recovery["period_s"]) / 2 else 0


def _mean_between(force: np.ndarray, start: float, end: float) -> np.ndarray:
    """Mean over [start, end] in frames of what acts, (T, ...), and stays as it is from each frame to the next."""
    frames = np.arange(int(start), min(int(np.ceil(end)), len(force)))
    weight = np.minimum(frames + 1, end) - np.maximum(frames, start)
    return np.tensordot(weight / weight.sum(), force[frames], 1)


def match(truth: Arrays, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Truth vertices (V, 3) at rest or in frame 0, whichever lies nearer to the points, and the nearest one of each point."""
    found = []
    for vertices in (truth["positions"][0].astype(float), truth["rest_vertices"]):
        distance, index = cKDTree(vertices).query(points)
        found.append((distance.mean(), vertices, index))
    in_frame_0, at_rest = found
    _, vertices, index = at_rest if at_rest[0] < in_frame_0[0] - 1e-9 else in_frame_0
    return vertices, index


def spread(sources: np.ndarray, targets: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (T, S, 3) at sources (S, 3), interpolated to targets (D, 3) by inverse squared distance: (T, D, 3)."""
    count = min(NEIGHBOURS, len(sources))
    distance, index = cKDTree(sources).query(targets, k=[*range(1, count + 1)])
    weight = 1 / np.maximum(distance, 1e-12) ** 2
    weight[distance[:, 0] < 1e-7] = np.eye(count)[0]
    weight /= weight.sum(1, keepdims=True)
    return np.einsum("tdkc,dk->tdc", values[:, index], weight)


def free_volume(truth: Arrays) -> np.ndarray:
    # what acts on held vertices goes into the support and moves nothing
    return np.where(truth["clamped"], 0.0, truth["vertex_volume"])
