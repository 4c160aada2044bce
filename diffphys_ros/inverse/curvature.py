"""The Hessian of the track term by the linear modal model: what makes the first step of the search a good one."""

from __future__ import annotations

import numpy as np

from ..vibration.coordinates import seen_across
from .linear import footprint_load
from .observed import TrackTarget
from .prepared import Prepared
from .unknowns import Layout


def track_hessian(prepared: Prepared, layout: Layout, target: TrackTarget, *, initial_modes: int) -> np.ndarray:
    """Gauss-Newton Hessian (size, size) of TrackTarget.loss with respect to z at the start values; 0 where the linear engine knows no
    derivative."""
    jacobian = _jacobian(prepared, layout, target, initial_modes) * layout.scale()
    across = seen_across(prepared.body, prepared.tracks, prepared.clip.camera)
    if across is not None:
        jacobian = np.einsum("mdc,tmcs->tmds", across, jacobian)
    weight = target.weight.cpu().double().numpy()
    known = np.einsum("tm,tmcs,tmcr->sr", weight, jacobian, jacobian, optimize=True) / (weight.sum() * target.mean_square)
    return np.pad(known, (0, layout.size - layout.modal))


def _jacobian(prepared: Prepared, layout: Layout, target: TrackTarget, initial_modes: int) -> np.ndarray:
    start, modal = prepared.start, prepared.modal
    jacobian = modal.track_jacobian(
        target.rest_points,
        start.young,
        damping=start.damping,
        footprint=footprint_load(prepared),
        force=start.force,
        frames=layout.forced,
        period_s=prepared.clip.period_s,
        initial_displacement=start.initial_displacement,
        initial_velocity=start.initial_velocity,
        initial_modes=initial_modes,
    )
    return jacobian - jacobian[:1]
