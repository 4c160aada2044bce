"""By the material-point simulator, as the fit ran it last."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from ..simulate import ModalDamping, Plane, Simulator, State, substeps_per_frame
from ..types import MpmProblem, Particles, Recovery


def material_points(
    recovery: Recovery,
    problem: MpmProblem,
    young_scale: float,
    force_scale: float,
    *,
    device: str,
    report: Callable[[float], None] | None = None,
) -> np.ndarray:
    """Displacements from frame 0 [m], body frame, shape (T, P, 3). Raises SimulationError."""
    young = problem.young * problem.young.dtype.type(young_scale)
    simulator = _simulator(recovery, problem, device, recovery.substeps if young_scale <= 1 else _substeps(recovery, problem, young))
    see = simulator.tensor
    start = State.assemble(*map(see, (problem.position, problem.velocity, problem.velocity_gradient, problem.deformation_gradient)))
    force = force_scale * see(problem.force)[:-1, None, :] * see(problem.force_weight)[None, :, None]
    field = None if problem.field_force is None else force_scale * see(problem.field_force)
    damping = ModalDamping.of(simulator, problem.damping_shapes, problem.damping_gradients, problem.damping_frequencies)
    beta = see(recovery.stiffness_damping)
    with torch.no_grad():
        states = simulator.rollout(
            start,
            see(young),
            see(problem.poisson),
            force,
            see(recovery.mass_damping),
            push=None if field is None else lambda state, frame: field[frame],
            after_frame=lambda state: damping.kick(state, beta),
            report=report,
        )
    return (states.x - states.x[:1]).double().cpu().numpy()


def _substeps(recovery: Recovery, problem: MpmProblem, young: np.ndarray) -> int:
    """Those of the fit, or as many as Young's moduli (P,) [Pa] need."""
    needed = substeps_per_frame(young, problem.poisson, problem.density, dx=recovery.grid.dx, period_s=recovery.period_s, margin=1.0)
    return max(recovery.substeps, needed)


def _simulator(recovery: Recovery, problem: MpmProblem, device: str, substeps: int) -> Simulator:
    part = np.ones(len(problem.rest), np.uint8)  # the simulator knows particles alone
    particles = Particles(problem.rest, problem.volume, part, problem.density, problem.poisson.astype(float), problem.ghost)
    planes = zip(problem.plane_normal, problem.plane_offset, problem.plane_kind, problem.plane_friction, strict=True)
    return Simulator(
        particles,
        recovery.grid,
        substeps=substeps,
        period_s=recovery.period_s,
        gravity=recovery.gravity,
        device=device,
        dtype=torch.from_numpy(problem.young).dtype,
        law=problem.law,
        planes=tuple(Plane(normal, float(offset), str(kind), float(friction)) for normal, offset, kind, friction in planes),
    )
