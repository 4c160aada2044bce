"""The first answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..damping import Damping
from ..footprints import Footprint

LEAST_SD = 0.005  # of log10 E: no start value is surer, whatever its material


@dataclass(frozen=True)
class MaterialDoubt:
    """How far what nobody told of the materials of n parts may be off, as standard deviations, shape (n,) each; 0 where it was told."""

    density_log_sd: np.ndarray  # of ln(density)
    poisson_sd: np.ndarray  # of Poisson's ratio
    of_young: np.ndarray  # of log10 E by both
    of_specific: np.ndarray  # of log10 (E / density) by both

    @classmethod
    def none(cls, parts: int) -> MaterialDoubt:
        """Everything was told."""
        return cls(*np.zeros((4, parts)))

    def taken_from(self, log10_young_sd: np.ndarray) -> np.ndarray:
        """What a standard deviation of log10 E (n,) would be if everything had been told."""
        return np.sqrt(np.maximum(log10_young_sd**2 - self.of_young**2, LEAST_SD**2))


@dataclass(frozen=True)
class StartValues:
    """What tracks and eigenmodes say before any simulation (arrays over parts have shape (n,))."""

    young: np.ndarray  # [Pa], shape (n,)
    log10_young_sd: np.ndarray  # shape (n,)
    damping: Damping[float]
    forced: np.ndarray  # frames in which a force may act, bool, shape (T,)
    footprint: Footprint  # where on the body the force acts
    force: np.ndarray  # amplitude per frame, body frame [N/m^3 of rest volume], shape (T, 3); force[k] acts in [t_k, t_k+1)
    initial_displacement: np.ndarray  # modal coordinates at frame 0 about rest, shape (r,); zeros when at rest
    initial_velocity: np.ndarray  # their rates [1/s], shape (r,)
    frequencies_hz: np.ndarray  # of the leading modes at `young`, shape (r,)
    observed_hz: np.ndarray  # seen in the tracks, leading first
    decay_per_s: np.ndarray  # of the observed frequencies
    track_cost: float  # mean squared misfit of the linear motion over all frames / mean squared motion
    identified: np.ndarray  # bool, shape (n,)
    reasons: tuple[str, ...]  # one sentence per part
    has_free_tail: bool  # false: young is a guess, the joint schedule must find it
    modes_hold: bool  # whether linear modes explain the free motion; false: only a simulation can tell the stiffness
    geometry_sd: np.ndarray  # of log10 E by outline and what is not told of the materials alone, shape (n,)
    young_lower: np.ndarray  # least modulus of parts that hardly strain, with 95 % [Pa], shape (n,); NaN elsewhere and where none is known
    material: MaterialDoubt
    density: np.ndarray  # told, assumed, or with the mass told found in the free motion [kg/m^3], shape (n,)
    poisson: np.ndarray  # Poisson's ratio: told, assumed, or found in the free motion, shape (n,)
    detuning: float = 0.0  # largest |log| of a leading mode's frequency over the one that the body as told would have at `young`
