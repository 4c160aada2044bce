"""The start values' linear motion, by the modal model."""

from __future__ import annotations

import numpy as np

from .prepared import Prepared


def linear_coordinates(prepared: Prepared) -> np.ndarray:
    """Modal coordinates (T, r) of the start values' linear motion."""
    start, modal, load = prepared.start, prepared.modal, footprint_load(prepared)
    return modal.respond(
        start.young,
        damping=start.damping,
        load=start.force @ load.T,
        period_s=prepared.clip.period_s,
        initial_displacement=start.initial_displacement,
        initial_velocity=start.initial_velocity,
    )


def footprint_load(prepared: Prepared) -> np.ndarray:
    """Modal loads (r, 3) of unit amplitudes of the start values' force along x, y, z."""
    return prepared.modal.footprint_load(prepared.start.footprint.weights)


def linear_motion(prepared: Prepared, basis: np.ndarray, basis_gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements from frame 0 (T, P, 3) [m, body frame] and deformation gradients since then (T, P, 3, 3) by the start values' linear
    motion, at particles with modal basis (P, 3, r) and its gradient (P, 3, 3, r) [1/m]."""
    q = linear_coordinates(prepared)
    moved = q - q[:1]
    return np.einsum("pcr,tr->tpc", basis, moved), np.eye(3) + np.einsum("pijr,tr->tpij", basis_gradient, moved)
