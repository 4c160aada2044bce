"""Depth of a surface at sub-pixel positions, read from robust local planes: the one depth estimate that stages share."""

from __future__ import annotations

import numpy as np

GATES = (0.012, 0.004, 0.002, 0.0015)  # residual accepted in each pass, as a share of the depth


def plane_depth(depth: np.ndarray, pixels: np.ndarray, *, radius: int = 3, mask: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Depth at sub-pixel positions from a plane fitted robustly to the window around each.

    On a plane, inverse depth is linear in pixel coordinates, so the fit is exact for flat faces and averages the sensor's
    quantisation (bilinear reading keeps it). Pixels off the plane through the centre are left out in passes of narrowing gates,
    widened to the window's own spread where the sensor is noisier.

    Args:
        depth: along the optical axis [m], 0 where unknown, shape (H, W).
        pixels: positions [px], shape (P, 2).
        radius: half side of the window [px].
        mask: pixels that may be used, bool, shape (H, W); None: all with a depth.

    Returns:
        depth [m], shape (P,), 0 where no measured pixel lies at the centre; share of the window on the plane, shape (P,).
    """
    offset = np.stack(np.meshgrid(np.arange(-radius, radius + 1), np.arange(-radius, radius + 1)), -1).reshape(-1, 2)
    height, width = depth.shape
    centre = np.rint(pixels).astype(int)
    inside = ((centre >= 0) & (centre < (width, height))).all(-1)
    window = np.clip(centre[:, None] + offset, 0, (width - 1, height - 1))
    z = depth[window[..., 1], window[..., 0]].astype(float)
    usable = z > 0
    if mask is not None:
        usable &= mask[window[..., 1], window[..., 0]]
    z0 = z[:, len(offset) // 2]
    known = inside & usable[:, len(offset) // 2]
    basis = np.concatenate([np.ones_like(z)[..., None], window - pixels[:, None]], -1)
    inverse = np.where(usable, 1 / np.maximum(z, 1e-6), 0.0)
    weight = usable & (np.abs(z - z0[:, None]) < GATES[0] * z0[:, None])
    for gate in GATES[1:]:
        fitted = 1 / np.maximum(_fitted(basis, inverse, weight), 1e-6)
        weight = usable & (np.abs(fitted - z) < _gate(fitted, z, weight, gate, z0))
    value = _solve(basis, inverse, weight)[:, 0]
    enough = weight.sum(1) >= min(6, len(offset))
    flat = np.where(enough & (value > 0), 1 / np.maximum(value, 1e-6), z0)
    return np.where(known, flat, 0.0), np.where(known, weight.mean(1), 0.0)


def _solve(basis: np.ndarray, inverse: np.ndarray, weight: np.ndarray) -> np.ndarray:
    weighted = np.swapaxes(basis * weight[..., None], 1, 2)
    return np.linalg.solve(weighted @ basis + 1e-6 * np.eye(3), weighted @ inverse[..., None])[..., 0]


def _fitted(basis: np.ndarray, inverse: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return np.einsum("pki,pi->pk", basis, _solve(basis, inverse, weight))


def _gate(fitted: np.ndarray, z: np.ndarray, weight: np.ndarray, gate: float, z0: np.ndarray) -> np.ndarray:
    spread = np.sqrt((weight * (fitted - z) ** 2).sum(1) / np.maximum(weight.sum(1), 1))
    return np.maximum(gate * z0, np.minimum(1.5 * spread, GATES[0] * z0))[:, None]
