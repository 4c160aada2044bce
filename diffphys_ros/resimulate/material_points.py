"""By the material-point simulator, as the fit ran it last."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from ..simulate import ModalDamping, NodeSet, Plane, Simulator, State, substeps_per_frame
from ..types import Grid, MpmProblem, Particles, Recovery


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
    further = max(abs(force_scale), 1.0) / min(young_scale, 1.0)  # than it was recovered; as far, in the fit's own grid, to the bit
    grid = recovery.grid if further == 1 else _roomier(recovery, further)
    substeps = recovery.substeps if young_scale <= 1 else _substeps(recovery, problem, young)
    simulator = _simulator(recovery, problem, grid, substeps, device)
    see = simulator.tensor
    start = State.assemble(*map(see, (problem.position, problem.velocity, problem.velocity_gradient, problem.deformation_gradient)))
    if problem.node is None or problem.node_force is None:
        force = force_scale * see(problem.force)[:-1, None, :] * see(problem.force_weight)[None, :, None]
        push = None if problem.field_force is None else (force_scale * see(problem.field_force)).__getitem__
    else:
        nodes = NodeSet.of(grid, _renumbered(problem.node, recovery.grid, grid), device=device)
        force, push = nodes.silent(len(problem.node_force)), lambda frame: nodes.on_grid(force_scale * see(problem.node_force[frame]))  # type: ignore[index]
    frequencies = problem.damping_frequencies * problem.young.dtype.type(young_scale) ** 0.5
    retuning = None if problem.retuning is None else problem.young.dtype.type(young_scale) * problem.retuning
    damping = ModalDamping.of(simulator, problem.damping_shapes, problem.damping_gradients, frequencies, problem.damping_own, retuning)
    beta = see(recovery.damping.stiffness_s)
    with torch.no_grad():
        states = simulator.rollout(
            start,
            see(young),
            see(problem.poisson),
            force,
            see(recovery.damping.mass_per_s),
            push=None if push is None else lambda state, frame: push(frame),
            after_frame=lambda state: damping.kick(state, beta),
            report=report,
        )
    return (states.x - states.x[:1]).double().cpu().numpy()


def _substeps(recovery: Recovery, problem: MpmProblem, young: np.ndarray) -> int:
    """Those of the fit, or as many as Young's moduli (P,) [Pa] need."""
    needed = substeps_per_frame(young, problem.poisson, problem.density, dx=recovery.grid.dx, period_s=recovery.period_s, margin=1.0)
    return max(recovery.substeps, needed)


def _roomier(recovery: Recovery, further: float) -> Grid:
    """The grid with whole cells added to all sides for a motion so many times as large, at most for one of the body's extent."""
    grid, moved = recovery.grid, np.linalg.norm(recovery.trajectory - recovery.trajectory[0], axis=-1).max()
    cells = int(np.ceil(min((further - 1) * moved, np.ptp(recovery.points, axis=0).max()) / grid.dx))
    held = grid.clamp_index + cells if grid.clamp_index >= 0 else grid.clamp_index
    nx, ny, nz = (n + 2 * cells for n in grid.size)
    return Grid(grid.origin - cells * grid.dx, grid.dx, (nx, ny, nz), held)


def _renumbered(node: np.ndarray, before: Grid, grid: Grid) -> np.ndarray:
    """Flat numbers of the same nodes in a grid with as many more cells on all sides."""
    more = np.rint((before.origin - grid.origin) / grid.dx).astype(int)
    index = np.stack(np.unravel_index(node, before.size), -1) + more
    return np.ravel_multi_index(tuple(index.T), grid.size)


def _simulator(recovery: Recovery, problem: MpmProblem, grid: Grid, substeps: int, device: str) -> Simulator:
    part = np.ones(len(problem.rest), np.uint8)  # the simulator knows particles alone
    particles = Particles(problem.rest, problem.volume, part, problem.density, problem.poisson.astype(float), problem.ghost)
    planes = zip(problem.plane_normal, problem.plane_offset, problem.plane_kind, problem.plane_friction, strict=True)
    return Simulator(
        particles,
        grid,
        substeps=substeps,
        period_s=recovery.period_s,
        gravity=recovery.gravity,
        device=device,
        dtype=torch.from_numpy(problem.young).dtype,
        law=problem.law,
        force_on="particles" if problem.node is None else "nodes",
        planes=tuple(Plane(normal, float(offset), str(kind), float(friction)) for normal, offset, kind, friction in planes),
    )
