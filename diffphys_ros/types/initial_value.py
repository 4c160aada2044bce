"""What a recovered motion follows from, by the engine that made it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np


@dataclass(frozen=True)
class MpmProblem:
    """The initial value problem that the material points solved: beside grid, substeps and damping all that their motion follows
    from, to the bit. P particles in the solver's order, those that are no ghosts in the order of Recovery.points; body frame.
    """

    engine: ClassVar[str] = "mpm"

    ghost: np.ndarray  # bool, shape (P,); see Particles
    rest: np.ndarray  # [m], shape (P, 3)
    volume: np.ndarray  # [m^3], shape (P,)
    density: np.ndarray  # [kg/m^3], shape (P,)
    young: np.ndarray  # as simulated [Pa], shape (P,)
    poisson: np.ndarray  # as simulated, shape (P,)
    position: np.ndarray  # in frame 0 [m], shape (P, 3); a body that settled under gravity is not quite at rest positions
    velocity: np.ndarray  # in frame 0 [m/s], shape (P, 3)
    velocity_gradient: np.ndarray  # C of APIC in frame 0 [1/s], shape (P, 3, 3)
    deformation_gradient: np.ndarray  # F in frame 0, shape (P, 3, 3): its prestress
    force: np.ndarray  # amplitude [N/m^3 of rest volume], shape (T, 3); force[k] acts in [t_k, t_k+1)
    force_weight: np.ndarray  # of the amplitude, shape (P,)
    damping_shapes: np.ndarray  # modes that stiffness damping acts on, in any scale, shape (P, 3, m)
    damping_gradients: np.ndarray  # d(shape_a)/dX_b [1/m], shape (P, 3, 3, m)
    damping_frequencies: np.ndarray  # angular [rad/s], shape (m,)
    law: str  # name of the constitutive law
    plane_normal: np.ndarray  # floor and walls, out of the obstacle, shape (K, 3)
    plane_offset: np.ndarray  # material stays where normal . x >= offset [m], shape (K,)
    plane_friction: np.ndarray  # Coulomb's coefficient, shape (K,)
    plane_kind: np.ndarray  # "sticky", "slip" or "separate", shape (K,)
    damping_own: np.ndarray | None = None  # rates at which the solver alone makes these modes decay, given back once a frame [1/s], shape (m,)
    retuning: np.ndarray | None = None  # added to the stiffness of these modes about rest, once a frame [1/s^2], shape (m, m)
    field_force: np.ndarray | None = None  # on top of force * force_weight [N/m^3], as it acted, shape (T - 1, P, 3)
    node: np.ndarray | None = None  # nodes of the grid that a force acts on, as flat numbers in the order of its size, shape (M,)
    node_force: np.ndarray | None = None  # on these, and then on nothing else [N/m^3], shape (T - 1, M, 3)


@dataclass(frozen=True)
class ModalProblem:
    """The linear motion about frame 0 where the material points were not the answer: q'' + (alpha + beta K) q' + K q = load force,
    K = elastic + geometric + retuning, displacement = basis q (see modes.ModalModel). N particles and r modes, body frame."""

    engine: ClassVar[str] = "modes"

    rest: np.ndarray  # [m], shape (N, 3)
    young: np.ndarray  # [Pa], shape (N,)
    basis: np.ndarray  # [kg^-1/2], shape (N, 3, r)
    elastic: np.ndarray  # of these Young's moduli [1/s^2], shape (r, r)
    geometric: np.ndarray  # of gravity's prestress [1/s^2], shape (r, r)
    retuning: np.ndarray  # [1/s^2], shape (r, r)
    load: np.ndarray  # modal loads of unit amplitudes along x, y, z, shape (r, 3)
    force: np.ndarray  # amplitude [N/m^3 of rest volume], shape (T, 3); force[k] acts in [t_k, t_k+1)
    initial_displacement: np.ndarray  # modal coordinates in frame 0, shape (r,)
    initial_velocity: np.ndarray  # their rates [1/s], shape (r,)


PROBLEMS: dict[str, type[MpmProblem] | type[ModalProblem]] = {kind.engine: kind for kind in (MpmProblem, ModalProblem)}
