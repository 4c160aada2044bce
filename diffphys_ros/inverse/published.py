"""What the published method begins with, whatever the tracks say: the prior's material, no force, a body that stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Settings
from ..damping import Damping
from ..start.values import GUESS_SD
from ..types import StartValues
from .material_prior import of_parts
from .posterior import Confidence
from .prepared import Prepared
from .unknowns import checked_hold

MOST_STRAIN = 0.5  # in frame 0, of what hangs under its own weight: its sag is taken to be small, and turns matter inside out from 1 on [chosen]
NOT_SOUGHT = "the published loss explains the video: what force and stiffness share it cannot tell, so E is the prior's as far as pictures let it be."


def as_published(prepared: Prepared, settings: Settings) -> Prepared:
    """Start values of the schedule paper; a force that fit.hold names, and an E that fit.prescribe tells, stay as they are. All frames may carry
    a force."""
    held, start, every = checked_hold(settings.fit.hold), prepared.start, np.ones(len(prepared.clip), bool)
    still = np.zeros_like(start.initial_displacement)
    start = replace(start, initial_displacement=still, initial_velocity=still, forced=every)
    if "force" not in held:
        start = replace(start, force=np.zeros_like(start.force))
    told = held if settings.fit.prescribe is not None else frozenset()
    if "force" not in held and "damping" not in told:
        start = replace(start, damping=_braked(start.damping, settings.experiment.frame_drag / prepared.clip.period_s))
    if prepared.prior is not None and "young" not in told:
        start = _believing(start, prepared, settings.experiment.soft_sd)
    return replace(prepared, start=start, zones=None)


def _believing(start: StartValues, prepared: Prepared, soft_sd: float) -> StartValues:
    """With the prior's E, so many of its standard deviations towards soft: forces then act where they are sought, and substeps are few. A wave
    that crosses a stiff body within a frame leaves a search by pictures the rigid motions alone. No softer than what carries its own weight."""
    assert prepared.prior is not None
    belief = of_parts(prepared.prior, prepared.body, prepared.clip.camera)
    young = _carrying(prepared, belief.young * 10 ** (-soft_sd * belief.log10_young_sd))
    return replace(start, young=young, log10_young_sd=belief.log10_young_sd)


def _carrying(prepared: Prepared, young: np.ndarray) -> np.ndarray:
    """Moduli (n,) [Pa], all raised by one factor where what hangs would be strained in frame 0 by more than MOST_STRAIN."""
    if not (prepared.body.clamped and prepared.body.gravity.any()):
        return young
    return young * max(1.0, prepared.modal.strain_by_weight(young) / MOST_STRAIN)


def _braked(damping: Damping[float], drag_per_s: float) -> Damping[float]:
    """With a drag beside it [1/s], under which the velocity that a force leaves fades within the next frame: that which is sought picture by picture
    would else have to take back for ever what the one before it left."""
    return replace(damping, mass_per_s=damping.mass_per_s + drag_per_s)


def unidentified(found: Confidence) -> Confidence:
    """The same with no claim about stiffness and force."""
    n = len(found.identified)
    sd = np.maximum(found.log10_young_sd, GUESS_SD)
    return Confidence(sd, np.zeros(n, bool), (NOT_SOUGHT,) * n, np.full(n, np.nan), False, NOT_SOUGHT)
