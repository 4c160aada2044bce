"""What the place of a clamp, where that is known to a few pixels only, leaves open of Young's moduli."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .free_tail import Physics, Tail
from .stages import NARROW_RATIOS, Fit
from .uncertainty import OPEN_SD, Bend

if TYPE_CHECKING:
    from ..elements.assemble import Elements
    from ..elements.mesh import SolidMesh

STEP = 0.002  # of the body's length, by which its held face is moved for a difference [numerical]


def clamp_doubt(fit: Fit, mesh: SolidMesh) -> np.ndarray:
    """Standard deviation of log10 E per part (n,): what a fit of the free motion makes of a held face that lies one of its own standard deviations off;
    0 where a box tells it. `mesh` is the body's. Without a free tail E of all parts goes with the lowest mode."""
    body, physics = fit.evidence.body, fit.physics
    if not body.clamp_sd_m:
        return np.zeros(body.parts)
    step_m = STEP * float(mesh.vertices[:, 0].max())
    models = [fit.evidence.basis(_elements(fit, mesh, by), physics.young, NARROW_RATIOS) for by in (0.0, step_m)]
    if fit.support.has_free_tail:
        change = _taken_on(physics, *(replace(fit.tail, modal=modal, seen=seen) for modal, seen in zip(models, fit.evidence.seen_alike(*models), strict=True)))
    else:
        here, there = (modal.eigen(physics.young)[0][0] for modal in models)
        change = np.full(body.parts, 1 - there / here)
    return np.minimum(np.abs(change) / step_m * body.clamp_sd_m / np.log(10.0), OPEN_SD)  # more where the lowest mode is that of a piece that nothing holds


def _elements(fit: Fit, mesh: SolidMesh, behind_m: float) -> Elements:
    """Of the body with its held face so far behind; of the mass that was told where one was."""
    from ..elements.assemble import Elements

    moved = mesh.held_behind(behind_m)
    elements = Elements.of(fit.evidence.body, moved)
    if fit.evidence.settings.scene.mass_kg is None:
        return elements
    return elements.weighing(elements.density * mesh.volume_m3 / moved.volume_m3)


def _taken_on(physics: Physics, here: Tail, there: Tail) -> np.ndarray:
    """By how much ln E per part (n,) changes where the body swings as the second says."""
    missed = (there.misfit(physics) - here.misfit(physics)).ravel() / here.sigma_m
    return Bend.of(here, physics).young_by(missed, len(physics.young))
