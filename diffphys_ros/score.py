"""A recovery against a known truth. Nothing else in the package opens a truth.

A truth is an .npz of a finite-element scene with V vertices and T frames: rest_vertices (V, 3), positions (T, V, 3) [m, world],
part_E (n,) and vertex_E (V,) [Pa], vertex_part (V,) 0..n-1, interface (V,) bool (vertices shared by parts), vertex_volume (V,)
[m^3], clamped (V,) bool, force_density (T, V, 3) [N/m^3]; where they are there, stamps_ns (T,) and time (T,) [s] or fps [Hz]
place its frames beside those of a clip that lost some.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial import cKDTree

from . import folder as folders
from . import result, shapes, store
from .errors import InputError

ACTIVE_SHARE = 0.1  # a frame counts as forced where the true net force exceeds this share of its peak
FREE_SHARE = 1e-12  # a frame is force-free below this share of the peak energy of the true force
NEIGHBOURS = 4  # of the inverse-distance interpolation between points and truth vertices

_TRUTH = {
    "rest_vertices": "number V 3", "positions": "number T V 3", "part_E": "number n", "vertex_E": "number V", "vertex_part": "whole V", "interface": "truth V",
    "vertex_volume": "number V", "clamped": "truth V", "force_density": "number T V 3",
}  # fmt: skip
_RECOVERY = {name: shapes.RECOVERY[name] for name in ("points", "young", "force", "trajectory")}
_TIMES = {"stamps_ns": "?whole s", "time": "?number s", "fps": "?number", "period_s": "?number"}  # read where they are there
SAME_FRAME = 0.1  # of a frame: what two clocks may differ by, from jitter of the stamps and the period that is estimated from them


Arrays = Mapping[str, np.ndarray]


def score(recovery_npz: str | Path, truth_npz: str | Path) -> dict[str, object]:
    """Figures of a recovery.npz against a truth.npz.

    young_log10_error: log10(recovered / true) by part, of the median over points off the interface, None where not identified;
    young_ratio_error: worst |log10| of the error in the ratio of two parts, None with fewer than two;
    net_force_cosine: mean cosine of recovered and true net force over forced frames; false_force_ratio: rms of the recovered
    net force over force-free frames / true peak; trajectory_rmse_over_rms_motion: 1 is no better than predicting no motion.
    With them young_pa, young_true_pa (by part) and force_peak_n, force_peak_true_n. Raises InputError for unreadable files.
    """
    found: Arrays = _read(recovery_npz, "recovery", _RECOVERY)
    recovery, truth = _on_truth_frames(found, _read(truth_npz, "truth", _TRUTH), recovery_npz)
    vertices, nearest = _match(truth, recovery["points"])
    return {
        **_score_young(truth, nearest, recovery["young"]),
        **_score_force(truth, _spread(recovery["points"], vertices, recovery["force"][: len(truth["positions"])].astype(float))),
        "trajectory_rmse_over_rms_motion": _score_motion(truth, vertices, recovery),
    }


def score_folder(folder: str | Path, truth_npz: str | Path) -> dict[str, object]:
    """Scores the recovery.npz of a result folder and adds the figures to its metrics.json. Raises InputError, also where a run
    still works in the folder."""
    figures = score(folders.current(folder, result.RECOVERY), truth_npz)
    with result.owned(folder):
        result.write_metrics(folder, result.read_metrics(folder) | figures)
    return figures


def net_force(truth: Arrays) -> np.ndarray:
    """True net force on the unclamped vertices [N], shape (T, 3)."""
    return np.einsum("tnc,n->tc", truth["force_density"].astype(float), _free_volume(truth))


def read_truth(path: str | Path) -> dict[str, np.ndarray]:
    """The arrays of a truth.npz that are scored. Raises InputError where one is missing."""
    return _read(path, "truth", _TRUTH)


def _read(path: str | Path, what: str, needed: dict[str, str]) -> dict[str, np.ndarray]:
    arrays = store.read_arrays(path, what)
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise InputError(f"{what} {path}: misses {', '.join(missing)}; give a {what}.npz that holds {', '.join(needed)}")
    try:
        sizes = shapes.check(arrays, needed | _TIMES)
        shapes.require(min(sizes.values()) > 0, "an array is empty")
        if what == "truth":
            shapes.require((arrays["part_E"] > 0).all(), "part_E must be > 0")
    except shapes.MisshapenError as error:
        raise InputError(f"{what} {path}: {error}; give the {what}.npz as it was written") from error
    return {name: arrays[name] for name in (*needed, *_TIMES) if name in arrays}


def _on_truth_frames(recovery: Arrays, truth: Arrays, source: str | Path) -> tuple[Arrays, Arrays]:
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
    force = recovery["force"].astype(float)
    # cubic: on the straight line between two of every other frame a swing would lose 5 % of its size
    path = make_interp_spline(np.arange(length), recovery["trajectory"].astype(float), k=min(3, length - 1))
    resampled = {
        "trajectory": path(at),
        "force": np.stack([_mean_between(force, start, min(start + ratio, len(force))) for start in at]),
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
    """Mean over [start, end] in frames of a force (T, N, 3) that stays as it is from each frame to the next."""
    frames = np.arange(int(start), min(int(np.ceil(end)), len(force)))
    weight = np.minimum(frames + 1, end) - np.maximum(frames, start)
    return np.tensordot(weight / weight.sum(), force[frames], 1)


def _match(truth: Arrays, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Truth vertices (V, 3) at rest or in frame 0, whichever lies nearer to the points, and the nearest one of each point."""
    found = []
    for vertices in (truth["positions"][0].astype(float), truth["rest_vertices"]):
        distance, index = cKDTree(vertices).query(points)
        found.append((distance.mean(), vertices, index))
    in_frame_0, at_rest = found
    _, vertices, index = at_rest if at_rest[0] < in_frame_0[0] - 1e-9 else in_frame_0
    return vertices, index


def _spread(sources: np.ndarray, targets: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (T, S, 3) at sources (S, 3), interpolated to targets (D, 3) by inverse squared distance: (T, D, 3)."""
    count = min(NEIGHBOURS, len(sources))
    distance, index = cKDTree(sources).query(targets, k=[*range(1, count + 1)])
    weight = 1 / np.maximum(distance, 1e-12) ** 2
    weight[distance[:, 0] < 1e-7] = np.eye(count)[0]
    weight /= weight.sum(1, keepdims=True)
    return np.einsum("tdkc,dk->tdc", values[:, index], weight)


def _score_young(truth: Arrays, nearest: np.ndarray, young: np.ndarray) -> dict[str, object]:
    scored = ~truth["interface"][nearest] & np.isfinite(young)
    true = [float(e) for e in truth["part_E"]]
    medians = [_median(np.log10(young[scored & (truth["vertex_part"][nearest] == part)])) for part in range(len(true))]
    error = [None if m is None else m - float(np.log10(e)) for m, e in zip(medians, true, strict=True)]
    ratios = [abs(a - b) for a, b in combinations([e for e in error if e is not None], 2)]
    return {
        "young_log10_error": error,
        "young_ratio_error": max(ratios, default=None),
        "young_pa": [None if m is None else 10**m for m in medians],
        "young_true_pa": true,
    }


def _score_force(truth: Arrays, force: np.ndarray) -> dict[str, object]:
    """Force: recovered density at the truth's vertices (T, V, 3)."""
    volume, density = _free_volume(truth), truth["force_density"][: len(force)].astype(float)
    true, found = (np.einsum("tnc,n->tc", f, volume) for f in (density, force))
    size, size_found = np.linalg.norm(true, axis=1), np.linalg.norm(found, axis=1)
    active = size > ACTIVE_SHARE * size.max()
    energy = np.einsum("tnc,tnc,n->t", density, density, volume)
    free = energy <= FREE_SHARE * energy.max()
    cosine = (true * found).sum(1) / np.maximum(size * size_found, np.finfo(float).tiny)
    return {
        "net_force_cosine": float(cosine[active].mean()) if active.any() else None,
        "false_force_ratio": float(np.sqrt((size_found[free] ** 2).mean()) / size.max()) if free.any() and size.max() else None,
        "force_peak_n": float(size_found.max()),
        "force_peak_true_n": float(size.max()),
    }


def _score_motion(truth: Arrays, vertices: np.ndarray, recovery: Arrays) -> float | None:
    path = recovery["trajectory"][: len(truth["positions"])].astype(float)
    true = truth["positions"][: len(path)].astype(float)
    motion = _spread(vertices, recovery["points"], true - true[0])
    moved = (motion**2).sum(2).mean()
    return float(np.sqrt(((path - path[0] - motion) ** 2).sum(2).mean() / moved)) if moved > 0 else None


def _free_volume(truth: Arrays) -> np.ndarray:
    # what acts on held vertices goes into the support and moves nothing
    return np.where(truth["clamped"], 0.0, truth["vertex_volume"])


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) else None
