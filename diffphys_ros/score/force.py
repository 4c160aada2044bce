"""The net force against the true one."""

from __future__ import annotations

import numpy as np

from .truth import STATED_FORCE, Arrays, free_volume

ACTIVE_SHARE = 0.1  # a frame counts as forced where the true net force exceeds this share of its peak
CENTRED = 0.05  # of the body's size: held so near to its middle it has no axis
FREE_SHARE = 1e-12  # a frame is force-free below this share of the peak energy of the true force


def net_force(truth: Arrays) -> np.ndarray:
    """True net force on the unclamped vertices [N], shape (T, 3)."""
    return np.einsum("tnc,n->tc", truth["force_density"].astype(float), free_volume(truth))


def score_force_sd(truth: Arrays, recovery: Arrays) -> dict[str, object]:
    """Whether the truth lies where the net force and its peak were stated to lie; empty where the recovery states nothing.

    Components of frames count that carry a force, in the truth or in the recovery. Errors of a clip's frames go together, so that the shares are figures of a clip, not so many
    independent trials.
    """
    if not {"net_force", *STATED_FORCE} <= recovery.keys() or not np.isfinite(recovery["net_force_sd"]).all():
        return {}
    true = net_force(truth)
    found, sd = (recovery[name][: len(true)].astype(float) for name in ("net_force", "net_force_sd"))
    true = true[: len(found)]
    size = np.linalg.norm(true, axis=1)
    counted = (sd > 0).any(1) | (size > ACTIVE_SHARE * size.max())
    off = np.abs(found - true)[counted]
    inside = {f"net_force_inside_{k}sd": float((off <= k * sd[counted]).mean()) if counted.any() else None for k in (1, 2)}
    scale = np.sqrt((true**2).sum())
    relative = float(np.sqrt((sd**2).sum()) / scale) if scale else None
    return {**inside, "net_force_relative_sd": relative, "force_peak_stated_n": float(recovery["net_force_peak"]), "force_peak_sd_n": float(recovery["net_force_peak_sd"])}


def score_force(truth: Arrays, force: np.ndarray) -> dict[str, object]:
    """Force: recovered density at the truth's vertices (T, V, 3)."""
    volume, density = free_volume(truth), truth["force_density"][: len(force)].astype(float)
    true, found = (np.einsum("tnc,n->tc", f, volume) for f in (density, force))
    size, size_found = np.linalg.norm(true, axis=1), np.linalg.norm(found, axis=1)
    active = size > ACTIVE_SHARE * size.max()
    energy = np.einsum("tnc,tnc,n->t", density, density, volume)
    free = energy <= FREE_SHARE * energy.max()
    cosine = (true * found).sum(1) / np.maximum(size * size_found, np.finfo(float).tiny)
    scale = np.sqrt((true**2).sum())
    return {
        **_across(truth, true, found, active),
        "net_force_cosine": float(cosine[active].mean()) if active.any() else None,
        "false_force_ratio": float(np.sqrt((size_found[free] ** 2).mean()) / size.max()) if free.any() and size.max() else None,
        "net_force_relative_rmse": float(np.sqrt(((found - true) ** 2).sum()) / scale) if scale else None,
        "force_peak_n": float(size_found.max()),
        "force_peak_true_n": float(size.max()),
    }


def body_axis(truth: Arrays) -> np.ndarray | None:
    """Unit vector (3,) from what is held to the middle of the body at rest; None of a body that nothing holds, or that is held in its middle."""
    vertices, held = truth["rest_vertices"].astype(float), truth["clamped"].astype(bool)
    if not held.any():
        return None
    arm = vertices.mean(0) - vertices[held].mean(0)
    length = float(np.linalg.norm(arm))
    return arm / length if length > CENTRED * np.ptp(vertices, axis=0).max() else None


def _across(truth: Arrays, true: np.ndarray, found: np.ndarray, active: np.ndarray) -> dict[str, object]:
    """Of net forces (T, 3) what bends the body: a force along it hardly moves it, so that a film does not show that one."""
    axis = body_axis(truth)
    if axis is None:
        return {}
    true, found = (force - np.outer(force @ axis, axis) for force in (true, found))
    cosine = (true * found).sum(1) / np.maximum(np.linalg.norm(true, axis=1) * np.linalg.norm(found, axis=1), np.finfo(float).tiny)
    scale = np.sqrt((true**2).sum())
    return {
        "net_force_across_cosine": float(cosine[active].mean()) if active.any() else None,
        "net_force_across_relative_rmse": float(np.sqrt(((found - true) ** 2).sum()) / scale) if scale else None,
    }
