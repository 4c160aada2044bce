"""The answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..damping import Damping
from .initial_value import ModalProblem, MpmProblem
from .particles import Grid
from .poses import transformed
from .scale import Quantity, Scale


@dataclass(frozen=True)
class Recovery:
    """The answer: fields on the body's own particles, in the world frame, and what moves them so."""

    points: np.ndarray  # at rest [m], shape (N, 3)
    volume: np.ndarray  # [m^3], shape (N,)
    part: np.ndarray  # 1..n, shape (N,)
    young: np.ndarray  # corrected for the grid's apparent stiffness [Pa where `scale` is absolute, else at the density and size that were assumed], shape (N,)
    log10_young_sd: np.ndarray  # shape (N,)
    poisson: np.ndarray  # shape (N,)
    density: np.ndarray  # [kg/m^3], shape (N,)
    poisson_sd: np.ndarray  # shape (N,); 0 where it was told
    density_sd: np.ndarray  # [kg/m^3], shape (N,); 0 where it was told
    young_lower: np.ndarray  # least modulus of a part that hardly strains, with 95 % [Pa], shape (N,); NaN where E is identified or no bound is known
    log10_specific_sd: np.ndarray  # of log10(young / density), shape (N,)
    force: np.ndarray  # [N/m^3 of rest volume, in the same sense], float32, shape (T, N, 3); force[k] acts in [t_k, t_k+1)
    trajectory: np.ndarray  # [m], float32, shape (T, N, 3)
    net_force_sd: np.ndarray  # of each component of net_force() [N], shape (T, 3); 0 in frames without a force, NaN where the force is not identified
    net_force_peak: float  # largest size of the net force [N]: a mean over what is off about it; NaN where it is not identified
    net_force_peak_sd: float  # [N]
    clamped: np.ndarray  # bool, shape (N,): more than half held by the clamp (particles.held_by), all within 2/3 of a cell of it; left out of net forces
    frames: np.ndarray | None  # rendered, uint8 RGB, shape (T, H, W, 3)
    world_from_body: np.ndarray  # rigid transform, m, shape (4, 4): of the body frame, which grid, gravity and simulation are in
    gravity: np.ndarray  # body frame [m/s^2], shape (3,)
    simulation: MpmProblem | ModalProblem  # whose solution the trajectory is
    apparent_stiffness: float  # E_apparent / E of the grid: young over what the material points must be given
    grid: Grid  # body frame
    period_s: float  # between frames [s]
    substeps: int  # per frame
    damping: Damping[float]
    initial_velocity: np.ndarray  # [m/s], world frame, shape (N, 3)
    identified: np.ndarray  # per part, bool, shape (n,)
    reasons: tuple[str, ...]  # per part, one sentence
    metrics: dict[str, object]  # what metrics.json holds
    notes: tuple[str, ...] = ()  # what was assumed, one sentence each
    force_identified: bool = False  # whether the force can be believed
    force_reason: str = "nobody has judged the force."  # one sentence

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """World coordinates (..., 3) of body points (..., 3)."""
        return transformed(self.world_from_body, points)

    @property
    def young_solver(self) -> np.ndarray:
        """Young's modulus that the trajectory was really simulated with [Pa], shape (N,): for the material points that on their grid,
        before its correction; for eigenmodes `young` itself."""
        problem = self.simulation
        return (problem.young if isinstance(problem, ModalProblem) else problem.young[~problem.ghost]).astype(float)

    def net_force(self) -> np.ndarray:
        """Sum of force * volume over the unclamped particles [N, in the sense of `force`], shape (T, 3)."""
        return np.einsum("tnc,n->tc", self.force.astype(float), self.volume * ~self.clamped)

    @property
    def scale(self) -> Scale:
        """Whether E and force are absolute, and what of them is known where they are not."""
        return Scale.of(self.metrics, "_source")

    @property
    def mass_kg(self) -> float:
        """Mass [kg, at the density and size that were told or assumed]."""
        return float(self.density @ self.volume)

    def known_young(self) -> np.ndarray:
        """`young` (N,), NaN in parts that are not identified."""
        return np.where(self.identified[self.part - 1], self.young, np.nan)

    def stiffness(self, scale: Scale) -> Quantity:
        """What a scale makes of `known_young`, (N,)."""
        return scale.stiffness(self.known_young(), self.density)

    def net_quantity(self, scale: Scale) -> Quantity:
        """What a scale makes of `net_force`, (T, 3)."""
        return scale.force(self.net_force(), self.mass_kg)
