"""What the first answer is read from: a body, how it moves, and what is told of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..config import Settings
from ..modes.model import ModalModel
from ..types import Body, Tracks
from ..vibration.coordinates import Motion, Projection
from ..vibration.forced_frames import Support
from .along import along_of
from .force import ForceProblem
from .free_tail import DETUNED, MODEL_ERROR, Tail
from .large_swing import LargeSwing
from .untold import TOLD, Untold

if TYPE_CHECKING:
    from ..elements.assemble import Elements

NARROW_MODES = 6  # per further point of the basis [numerical]
ALIKE = 0.9  # mean square of the cosines between normals and their common direction, from which on they count as one [chosen]
STILL = 4.0  # motion over noise below which nothing can be said [chosen]


class Belief(Protocol):
    """What is believed of Young's modulus before any motion is looked at."""

    @property
    def young(self) -> np.ndarray:
        """Per part [Pa], (n,)."""
        ...

    @property
    def log10_young_sd(self) -> np.ndarray:
        """Per part, (n,)."""
        ...


@dataclass(frozen=True)
class Evidence:
    """Told and seen; nothing in it is found by a fit."""

    body: Body
    tracks: Tracks
    motion: Motion
    period_s: float
    settings: Settings  # `scene.at_rest` and `experiment.mode_count`
    belief: Belief | None = None
    untold: Untold = TOLD  # of the materials, where the motion is to tell it
    first_order: bool = False  # whether the tracks hold what is linear in the amplitude alone

    @property
    def at_rest(self) -> bool:
        """Whether frame 0 is an equilibrium."""
        return self.settings.scene.at_rest

    @property
    def moves(self) -> bool:
        """Whether there is more to be seen than noise."""
        return self.motion.size_m >= STILL * self.motion.noise_m

    @property
    def of_points(self) -> bool:
        """Whether points were followed, and not an outline, which shows hardly anything of how a body twists."""
        return self.tracks.normals is None

    @property
    def _one_direction(self) -> bool:
        """Whether the tracks show nothing but motion along nearly the same direction."""
        normals = self.tracks.normals
        return normals is not None and bool(np.linalg.eigvalsh(normals.T @ normals / len(normals))[-1] > ALIKE)

    def believed(self, log_young: np.ndarray) -> np.ndarray:
        """Residuals of log E (n,) [ln Pa] against what is believed, in standard deviations; none where nothing is."""
        if self.belief is None:
            return log_young[:0]
        return (log_young - np.log(self.belief.young)) / (np.log(10) * self.belief.log10_young_sd)

    def basis(self, elements: Elements, young: np.ndarray, ratios: tuple[float, ...], *, loaded: bool = True) -> ModalModel:
        """Ritz model about moduli (n,) [Pa], exact at these ratios between the parts as well."""
        from ..elements.assemble import modal_model

        count = self.settings.experiment.mode_count
        outer = [np.where(np.arange(len(young)) == i, r, 1.0) for i in range(1, len(young)) for r in ratios]
        counts = [count] + [min(count, NARROW_MODES)] * len(outer)
        return modal_model(elements, [young, *(young * o for o in outer)], counts, loaded=loaded)

    def seen_alike(self, *models: ModalModel) -> tuple[Projection, ...]:
        """The observed motion as several models are compared with it."""
        return Projection.alike(self.motion, *models)

    def tail(self, modal: ModalModel, support: Support) -> Tail:
        """The misfit of the frames after the last force under a modal model."""
        first = support.tail_start
        seen = Projection.of(self.motion, modal)
        moved = seen.data[first:] if first < len(seen.data) else seen.data  # none at all where the force acts to the end
        sigma = float(np.hypot(self.motion.coherent_m, MODEL_ERROR * np.sqrt((moved**2).sum(1).mean())))
        detuned = 0 if self._one_direction else DETUNED  # one mode is seen well then: what its shape misses must not buy another frequency
        return Tail(modal, seen, first, self.period_s, self.motion.known, self.at_rest, sigma, self.settings.experiment.mode_count, self.untold, detuned)

    def whole(self, modal: ModalModel, support: Support) -> ForceProblem:
        """The misfit of all frames under a modal model and a force."""
        q, known = self.motion.coordinates, self.motion.known
        sigma = float(np.hypot(self.motion.coherent_m, MODEL_ERROR * self.motion.size_m))
        acceleration = np.sqrt((np.diff(q, 2, axis=0) ** 2).sum(1).mean()) / self.period_s**2
        unit = max(float(acceleration), 1e-6) * self.body.mass_kg / self.body.volume_m3
        seen = Projection.of_tracks(self.motion, modal) if support.allowed.any() else Projection.of(self.motion, modal)
        largest = self.motion.size_m / max(float(np.linalg.norm(seen.operator[:, 0])), 1e-12)
        calm, depth = np.ones(len(known)), self.tracks.has_depth
        return ForceProblem(modal, seen, self.period_s, known, support.allowed, self.at_rest, sigma, unit, largest, calm, along_of(self.body), depth, self.motion.coherent_m)

    def second_order(self, problem: ForceProblem) -> ForceProblem | None:
        """The same, of the tracks as they are, with what they hold of second order left open; None where they hold none. What was fitted as a product first has
        part of what the force did with it: beside a force that twists a body while it bends, millimetres of that twist."""
        if not (self.at_rest and self.of_points and self.body.clamped and not self.first_order):
            return None
        swing = LargeSwing.of(self.motion, problem.seen, problem.modal, problem.sigma_m, self.period_s)
        return replace(problem, seen=problem.seen.as_tracked, swing=swing)
