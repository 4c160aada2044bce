"""How well a body hangs as its outline is seen to swing: the shape of its leading mode against the one observed, at the modulus that the swing's
frequency tells. Where the clamp lies outside the picture, the best of several places tells where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..config import Settings
from ..errors import InputError
from ..types import Body, Camera, Tracks
from ..vibration.coordinates import observe
from .evidence import Evidence
from .stages import Fit, modes, run
from .values import supported


@dataclass(frozen=True)
class Hung:
    """One body's answer."""

    young: float  # of its first part [Pa]
    misfit: float  # of the mode's shape: sum of squares over the points, of unit root mean square
    points: int
    misfit_swayed: float = math.nan  # the same with what a camera may do together with the swing taken off the shape that is seen; NaN where it stands


def hung(body: Body, tracks: Tracks, period_s: float, settings: Settings, *, camera: Camera, swayed_m: np.ndarray | None = None) -> Hung:
    """Of a body under the free swing of its tracks. `swayed_m` (3,), world: what all points may seem to move by together with the swing, of unit root
    mean square over time, though the body does not. Raises InputError where the tracks are no free swing."""
    from ..elements.assemble import Elements

    evidence = Evidence(body, tracks, observe(body, tracks, camera), period_s, settings)
    support = supported(evidence)
    if not support.has_free_tail:
        raise InputError("the outline shows no free swing that its clamp could be read from; record a longer one that nobody touches")
    elements = Elements.of(body)
    fit = run(modes(elements, 1.0)[:1], Fit.begun(evidence, elements, support))
    young, tail = fit.physics.young, fit.tail
    mode = fit.modal.eigen(young)[1][:, tail.leading_mode(young)]
    shape = evidence.motion.seen_basis(fit.modal) @ mode
    seen = evidence.motion.shapes[..., 0]
    misfit = _misfit(seen, shape)
    if swayed_m is None:
        return Hung(float(young[0]), misfit, len(seen))
    assert evidence.motion.across is not None
    alike = evidence.motion.across @ (swayed_m @ body.world_from_body[:3, :3]) / evidence.motion.coordinates[:, 0].std()
    return Hung(float(young[0]), misfit, len(seen), _misfit(seen - alike, shape))


def _misfit(seen: np.ndarray, shape: np.ndarray) -> float:
    """Sum of squares of what a shape (M, 3), at its best size, leaves of the one that is seen."""
    factor = (shape * seen).sum() / (shape**2).sum()
    return float(((seen - factor * shape) ** 2).sum())
