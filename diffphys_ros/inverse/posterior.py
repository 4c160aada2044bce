"""How surely the stiffness of the answer is known, part by part, and its force; and why."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..linear_systems import inverted
from ..start.values import GUESS_SD, WIDEST_DOUBT_SD, WIDEST_SD, explained_badly
from ..types import MaterialDoubt
from ..vibration.forced_frames import LEAST_TAIL_FRAMES, LEAST_TAIL_PERIODS
from .prepared import Prepared
from .unknowns import Layout

GRID_SCATTER = 0.02  # of log10 E between grids, one part, where the simulation alone tells it (Gauss-Newton alone would claim too much)


@dataclass(frozen=True)
class Confidence:
    """Of Young's modulus of n parts, and of the force."""

    log10_young_sd: np.ndarray  # (n,)
    identified: np.ndarray  # bool, (n,)
    reasons: tuple[str, ...]  # one sentence per part
    young_lower: np.ndarray  # [Pa], (n,); NaN where the modulus itself or nothing is known
    force_identified: bool = False
    force_reason: str = ""  # one sentence

    def log10_specific_sd(self, material: MaterialDoubt) -> np.ndarray:
        """Standard deviation of log10(E / density), (n,): that of log10 E with what the materials do to the ratio in the place of what they do to E."""
        return np.hypot(material.taken_from(self.log10_young_sd), material.of_specific)


@dataclass(frozen=True)
class Explained:
    """How well the answer follows the tracks, and how much the unknowns matter to it."""

    rms_m: float  # misfit of one track coordinate [m]
    size_m: float  # rms of the tracked displacements [m]
    grid_log10_sd: float  # of log10 E by the grid alone, as it was measured on this body
    moved_log10: np.ndarray  # log10 of the answer's E over that of the start values, (n,)
    hessian: np.ndarray  # of the simulation's loss, whose misfit is half the mean squared misfit over size_m^2; (size, size)


def of_answer(prepared: Prepared, layout: Layout, explained: Explained, *, simulated: bool) -> Confidence:
    """Of the answer, the simulated one or the start values' linear motion."""
    of_young = _doubted(of_simulation(prepared, layout, explained) if simulated else of_start(prepared), prepared)
    known, reason = of_force(prepared, of_young, explained)
    return replace(of_young, force_identified=known, force_reason=reason)


def _doubted(confidence: Confidence, prepared: Prepared) -> Confidence:
    """The same without a stiffness where the recording itself is doubted."""
    doubt = next((doubt for doubt in prepared.doubts if doubt.of_young), None)
    if doubt is None:
        return confidence
    n = len(confidence.identified)
    sd = np.maximum(confidence.log10_young_sd, GUESS_SD)
    return replace(confidence, log10_young_sd=sd, identified=np.zeros(n, bool), reasons=(f"{doubt.text}.",) * n, young_lower=np.full(n, np.nan))


def of_force(prepared: Prepared, of_young: Confidence, explained: Explained) -> tuple[bool, str]:
    """Whether the force of an answer is known, and a sentence. It is what moves a body of known stiffness as it was seen to move: it needs a
    sound recording, a stiffness, and an answer that leaves of the motion little more than noise."""
    missed, size, noise = (1e3 * value for value in (np.sqrt(3) * explained.rms_m, explained.size_m, prepared.tracks.noise_m))
    found = f"the answer misses {missed:.2f} mm of a motion of {size:.2f} mm, where the tracks' noise is {noise:.2f} mm"
    badly = explained_badly(missed, noise, size)
    if prepared.doubts:
        return False, f"{prepared.doubts[0].text}." + (f" Its motion is not that of the film either: {found}." if badly else "")
    if not of_young.identified.any():
        return False, f"the force follows from a stiffness that is not identified: {of_young.reasons[0]}"
    if badly:
        return False, f"{found}: what moved the object so is not in the force; check mask, thickness and parts."
    return True, f"{found}."


def of_start(prepared: Prepared) -> Confidence:
    """Of the start values."""
    start = prepared.start
    return Confidence(start.log10_young_sd, start.identified, start.reasons, start.young_lower)


def of_simulation(prepared: Prepared, layout: Layout, explained: Explained) -> Confidence:
    """Of the simulated answer: that of the start values, the grid's own error and what the two engines differ by, where the modes hold; else from the simulation."""
    start = prepared.start
    if "young" in layout.held:
        return of_start(prepared)
    if start.has_free_tail and start.modes_hold:
        return _of_both(of_start(prepared), explained)
    sd = np.sqrt(_fit_sd(prepared, layout, explained) ** 2 + start.geometry_sd**2 + GRID_SCATTER**2)
    if not start.has_free_tail:  # then force may do what stiffness did not: of that a simulation of the same tracks tells no more than the modes
        sd = np.maximum(sd, start.log10_young_sd)
    fault = _fault(prepared, layout, explained)
    if fault:
        return Confidence(np.maximum(sd, start.log10_young_sd), np.zeros(len(sd), bool), (fault,) * len(sd), start.young_lower)
    found = f"simulated within {1e3 * explained.rms_m:.2f} mm of {1e3 * explained.size_m:.2f} mm, where linear modes miss {100 * start.track_cost**0.5:.0f} % of the motion"
    parts = prepared.body.sources.get("parts", "")
    hidden = start.geometry_sd > WIDEST_DOUBT_SD if parts else np.zeros(len(sd), bool)
    known = (sd <= WIDEST_SD) & ~hidden
    more = np.where(hidden, f"; {parts}", "")
    reasons = tuple(f"{found}." if told else f"log10 E is known to +-{s:.2f} only; {found}{why}." for s, told, why in zip(sd, known, more, strict=True))
    return Confidence(sd, known, reasons, start.young_lower)


def _of_both(first: Confidence, explained: Explained) -> Confidence:
    """Of the start values and of a simulation that began from them: which of the two is right where they differ is not known."""
    sd = np.hypot(np.hypot(first.log10_young_sd, explained.grid_log10_sd), explained.moved_log10)
    lost = first.identified & (sd > WIDEST_SD)
    why = "log10 E is known to +-{:.2f} only: of the modes' E the simulation makes {:.2g} times as much."
    reasons = tuple(why.format(s, 10.0**moved) if gone else said for said, s, moved, gone in zip(first.reasons, sd, explained.moved_log10, lost, strict=True))
    return replace(first, log10_young_sd=sd, identified=first.identified & ~lost, reasons=reasons)


def _fault(prepared: Prepared, layout: Layout, explained: Explained) -> str:
    """Why the simulated answer tells no stiffness; empty where it does."""
    rms, size = np.sqrt(3) * explained.rms_m, explained.size_m
    if explained_badly(rms, prepared.tracks.noise_m, size):
        return f"the motion differs from the simulated one by {1e3 * rms:.2f} mm of {1e3 * size:.2f} mm; check mask, thickness and parts."
    free_frames = int(len(prepared.clip) - 1 - layout.forced.max(initial=-1))
    periods = free_frames * prepared.clip.period_s * float(prepared.start.frequencies_hz[0])
    if free_frames < LEAST_TAIL_FRAMES or periods < LEAST_TAIL_PERIODS:
        return f"only {free_frames} frames ({periods:.1f} periods) follow the last force, needs {LEAST_TAIL_FRAMES} and {LEAST_TAIL_PERIODS}; record a longer tail without force."
    return ""


def _fit_sd(prepared: Prepared, layout: Layout, explained: Explained) -> np.ndarray:
    """Standard deviation of log10 E (n,) that the misfit leaves open with all other unknowns free. What is missed is common to all points
    of a frame and to the frames of a quarter period."""
    clip = prepared.clip
    quarter = 0.25 / (max(float(prepared.start.frequencies_hz[0]), 1e-3) * clip.period_s)
    independent = max(len(clip) / max(quarter, 1.0), 1.0)
    variance = np.diag(inverted(explained.hessian))[: layout.parts] * 3 * (explained.rms_m / explained.size_m) ** 2 / independent
    return np.sqrt(variance) / np.log(10)
