"""The simulated half of the paper's equation 3: unknowns in, motion of the particles out, differentiable."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from ..errors import SimulationError
from ..modes.response import SLOWEST
from ..particles import DensePoints, downsample, fill, fit_grid
from ..simulate import ModalDamping, NodeSet, Plane, Push, Simulator, State, substeps_per_frame
from ..types import Grid, Particles
from .apparent_stiffness import UNMEASURED, measure_apparent, motion_share
from .linear import linear_coordinates
from .prepared import Prepared
from .resolution import Plan
from .unknowns import Layout, Unknowns

FieldForce = Callable[[torch.Tensor, int], torch.Tensor]  # positions (P, 3) [m] at the start of a frame and its number -> (P, 3) [N/m^3]
REACH = 1.6  # room in the grid, as a multiple of the largest displacement seen in the tracks
DAMPED_MODES = 6  # that stiffness-proportional damping acts on


@dataclass(frozen=True)
class Motion:
    """A simulated clip, body frame."""

    x: torch.Tensor  # positions [m], (T, P, 3)
    F: torch.Tensor  # deformation gradients since frame 0, (T, P, 3, 3)
    force: torch.Tensor  # all of it, density [N/m^3], (T - 1, P, 3)
    unknowns: Unknowns
    start: State  # frame 0
    young: torch.Tensor  # as simulated [Pa], (P,)
    poisson: torch.Tensor  # as simulated, (P,)
    density: torch.Tensor | None = None  # as simulated [kg/m^3], (P,); None: that of the particles
    field_force: torch.Tensor | None = None  # its share on top of the family's [N/m^3], (T - 1, P, 3)
    node_force: torch.Tensor | None = None  # where forces act on nodes: all of it [N/m^3], (T - 1, M, 3), of which the others are the picture

    @property
    def displacement(self) -> torch.Tensor:
        """From frame 0 [m], (T, P, 3)."""
        return self.x - self.x[:1]


@dataclass(frozen=True)
class Discretisation:
    """The body on one grid: all that does not change while a fit runs, except the number of substeps."""

    particles: Particles
    grid: Grid
    apparent: float  # E_apparent / E of this lattice on this body; E_true = E_solver * apparent
    expected_log10_error: float  # of E_solver * apparent, by the grid alone
    loss: np.ndarray  # log amplitude that the lattice alone takes of the lowest modes in a substep, (k,)
    basis: np.ndarray  # modal basis at the particles, 0 at ghosts, (P, 3, r)
    basis_gradient: np.ndarray  # [1/m], (P, 3, 3, r)
    sag_gradient: np.ndarray | None  # of the static displacement under gravity, (P, 3, 3)


def discretise(prepared: Prepared, plan: Plan, *, device: str, dense: DensePoints | None = None) -> Discretisation:
    """Particles and grid of a plan, and their apparent stiffness on this very body; the particles are a share of `dense` points, or fill
    a lattice."""
    body, modal, young = prepared.body, prepared.modal, prepared.start.young
    particles = fill(body, plan.dx, plan.per_cell) if dense is None else downsample(body, dense, plan.kept, plan.dx)
    grid = fit_grid(particles, dx=plan.dx, reach_m=reach_of(prepared) + 0.5 * plan.dx, clamped=body.clamped)
    value, gradient = modal.evaluate(particles.x_rest)
    value[particles.ghost], gradient[particles.ghost] = 0.0, 0.0
    sag = gradient @ modal.gravity_coordinates(young) if body.gravity.any() and body.clamped else None  # what nothing holds falls
    return Discretisation(particles, grid, *_apparent(prepared, plan, particles, grid, device), value, gradient, sag)


def _apparent(prepared: Prepared, plan: Plan, particles: Particles, grid: Grid, device: str) -> tuple[float, float, np.ndarray]:
    """The lattice's apparent stiffness, the error of log10 E that is left once it is corrected for, and its loss by mode."""
    if not prepared.body.clamped or not plan.simulates:
        return 1.0, UNMEASURED, np.zeros(0)
    young = prepared.start.young
    if np.linalg.eigvalsh(prepared.modal.elastic(young))[0] < SLOWEST**2:  # elements that nothing holds, though the body is clamped: no swing ends
        return 1.0, UNMEASURED, np.zeros(0)
    share = motion_share(prepared.modal, young, linear_coordinates(prepared))
    try:
        found = measure_apparent(particles, grid, prepared.modal, young, share, device=device)
    except SimulationError:  # the search will say what the grid does not carry
        return 1.0, UNMEASURED, np.zeros(0)
    return found.value, found.expected_log10_error, found.loss


def reach_of(prepared: Prepared) -> float:
    """Room that the motion is given in the grid [m]: for what the tracks show, and for what the start values' linear motion makes of ends
    that no track follows, up to the body's own length."""
    tracks, nodes = prepared.tracks, prepared.modal.nodes
    moved = np.linalg.norm(tracks.points - tracks.points[:1], axis=-1)[tracks.valid]
    q = linear_coordinates(prepared)
    linear = float(np.linalg.norm(np.tensordot(q - q[:1], prepared.modal.basis, (1, 2)), axis=-1).max())
    return REACH * max(float(np.quantile(moved, 0.999)), min(linear, float(np.ptp(nodes, axis=0).max())))


class ForwardModel:
    """Engine 2: unknowns z -> Motion, at a number of substeps that is frozen until E passes what it carries."""

    def __init__(
        self,
        prepared: Prepared,
        disc: Discretisation,
        layout: Layout,
        *,
        device: str,
        dtype: torch.dtype = torch.float32,
        law: str,
        planes: tuple[Plane, ...] = (),
        simulates: bool = True,
        nodal: bool = False,
    ):
        """`simulates`: whether it will be asked for motions; else no substeps are laid out. `nodal`: forces act on the grid's nodes."""
        self.simulates, self.nodal = simulates, nodal
        self.prepared, self.disc, self.layout, self.device, self.dtype = prepared, disc, layout, device, dtype
        self.law, self.planes = law, planes
        self._simulator: Simulator | None = None
        self.capture(layout.young)
        tensor = self.simulator.tensor
        p, start = disc.particles, prepared.start
        weights = start.footprint.weights(p.x_rest) * ~p.ghost
        self.weights, self.poisson = tensor(weights), tensor(p.poisson)
        self.part = torch.as_tensor(p.part - 1, device=device)
        self.basis, self.basis_gradient = tensor(disc.basis), tensor(disc.basis_gradient)
        self.nodes = self._nodes() if nodal else None
        self.told_force: torch.Tensor | None = None  # on the nodes (T - 1, M, 3) [N/m^3], in place of the family's

    def _nodes(self) -> NodeSet:
        """Those that particles touch; where they keep their weights, wherever they go."""
        reach = 0.0 if self.simulator.anchored else reach_of(self.prepared)
        return NodeSet.around(self.disc.grid, self.disc.particles.x_rest, reach_m=reach, device=self.device)

    def capture(self, young: np.ndarray) -> None:
        """Lay out the substeps anew for moduli (n,) [Pa]."""
        self.captured = young
        self.simulator = self._simulator_for(young)
        self.damping = self._modal_damping()

    def _simulator_for(self, young: np.ndarray, *, batch: int | None = None) -> Simulator:
        body, clip, disc = self.prepared.body, self.prepared.clip, self.disc
        return Simulator(
            disc.particles,
            disc.grid,
            substeps=substeps_per_frame(young, body.poisson, body.density, dx=disc.grid.dx, period_s=clip.period_s) if self.simulates else 1,
            period_s=clip.period_s,
            gravity=body.gravity,
            device=self.device,
            dtype=self.dtype,
            law=self.law,
            planes=self.planes,
            batch=batch,
            frames=len(clip) - 1,
            force_on="nodes" if self.nodal else "particles",
        )

    def ensure_substeps(self, young: np.ndarray) -> bool:
        """Capture again where the stiffest of moduli (n,) [Pa] has passed what the substeps carry; whether that happened."""
        if young.max() <= self.simulator.max_young():
            return False
        self.capture(young)
        return True

    def simulate(
        self,
        unknowns: Unknowns,
        young: torch.Tensor,
        field_poisson: torch.Tensor | None = None,
        field_force: torch.Tensor | FieldForce | None = None,
        *,
        report: Callable[[float], None] | None = None,
    ) -> Motion:
        """Motion with E [Pa] of every particle (P,), a Poisson's ratio (P,) in place of the particles' own, and a force density
        [N/m^3] on top of the family's: (T - 1, P, 3), or a function of where the particles are; (T - 1, M, 3) where forces act on nodes. Raises
        SimulationError."""
        poisson = self._poisson(unknowns, field_poisson)
        start = self._start(unknowns, young, poisson, self.simulator)
        acted: list[torch.Tensor] = []

        def push(state: State, frame: int) -> torch.Tensor:
            acted.append(field_force(state.x, frame) if callable(field_force) else field_force[frame])  # type: ignore[index]
            return acted[-1]

        on_nodes = None if self.nodes is None else self.node_force(unknowns, field_force)  # type: ignore[arg-type]
        pushes = None if field_force is None and on_nodes is None else push if on_nodes is None else lambda _, frame: self.nodes.on_grid(on_nodes[frame])  # type: ignore[union-attr]
        path = self._path(self.simulator, unknowns, start, young, poisson, pushes, report)
        states = State(torch.stack([state.data for state in path]))
        since0 = states.F @ torch.linalg.inv(start.F)[None]
        of_field = torch.stack(acted) if acted else None if on_nodes is None else self.at_particles(on_nodes)
        force = self.density_of(unknowns.force, of_field) if on_nodes is None else of_field
        assert force is not None
        return Motion(states.x, since0, force, unknowns, start, young, poisson, self._density(unknowns), of_field, on_nodes)

    def start_of(self, unknowns: Unknowns, young: torch.Tensor, poisson: torch.Tensor) -> State:
        """Frame 0."""
        return self._start(unknowns, young, poisson, self.simulator)

    def advance(
        self, state: State, anchor: State, unknowns: Unknowns, young: torch.Tensor, poisson: torch.Tensor, on_nodes: torch.Tensor, first: int
    ) -> list[State]:
        """The states after each of the frames in which forces on_nodes (K, M, 3) [N/m^3] act, from that at frame `first` of a motion which began at
        `anchor`: what `simulate` has there, differentiable. Raises SimulationError."""
        assert self.nodes is not None
        found, density = [], self._density(unknowns)
        for number, force in enumerate(on_nodes, first):
            state = self.simulator.frame(
                state, young, poisson, self.nodes.on_grid(force), unknowns.damping.mass_per_s, density=density, anchor=anchor, number=number
            )
            state = self.damping.kick(state, unknowns.damping.stiffness_s)
            found.append(state)
        return found

    def node_force(self, unknowns: Unknowns, field: torch.Tensor | None) -> torch.Tensor:
        """Force densities on the nodes (T - 1, M, 3) [N/m^3]: the family's or the told ones, and a field's (T - 1, M, 3) on top."""
        assert self.nodes is not None
        weights = self.simulator.tensor(self.prepared.start.footprint.weights(self.nodes.places(self.disc.grid)))
        family = unknowns.force[:-1, None, :] * weights[None, :, None] if self.told_force is None else self.told_force
        return family if field is None else family + field

    def at_particles(self, on_nodes: torch.Tensor) -> torch.Tensor:
        """What forces on nodes (T - 1, M, 3) come to at the particles, at rest (T - 1, P, 3): the same net force."""
        assert self.nodes is not None
        return self.nodes.at_particles(self.disc.grid, self.disc.particles.x_rest, on_nodes.detach())

    def density_of(self, force: torch.Tensor, of_field: torch.Tensor | np.ndarray | None = None) -> torch.Tensor:
        """Force density (T - 1, P, 3) [N/m^3] of the family's amplitudes (T, 3) and a field (T - 1, P, 3) on top of it."""
        family = force[:-1, None, :] * self.weights[None, :, None]
        return family if of_field is None else family + torch.as_tensor(of_field).to(family)

    def _poisson(self, unknowns: Unknowns, of_field: torch.Tensor | None) -> torch.Tensor:
        if of_field is not None:
            return of_field
        return self.poisson if unknowns.poisson is None else unknowns.poisson[self.part]

    def _density(self, unknowns: Unknowns) -> torch.Tensor | None:
        """Of every particle (P,); None: the particles' own."""
        return None if unknowns.density is None else unknowns.density[self.part]

    def displacements(self, zs: np.ndarray, *, report: Callable[[float], None] | None = None) -> torch.Tensor:
        """From frame 0 [m], (B, T, P, 3), under unknowns zs (B, size) that differ in log E alone: one batch of simulations, without
        gradients. Raises SimulationError."""
        stiffest = np.max([self.layout.young_of(z) for z in zs], axis=0)
        simulator = self._simulator_for(stiffest, batch=len(zs))
        with torch.no_grad():
            every = [self.layout.unpack(simulator.tensor(z), modes=self.basis.shape[2]) for z in zs]
            young = torch.stack([unknowns.young[self.part] for unknowns in every])
            poisson = self._poisson(every[0], None)
            start = self._start(every[0], young, poisson, simulator)
            x = torch.stack([state.x.clone() for state in self._path(simulator, every[0], start, young, poisson, report=report)])
        return (x - x[:1]).transpose(0, 1)

    def _path(
        self,
        simulator: Simulator,
        unknowns: Unknowns,
        start: State,
        young: torch.Tensor,
        poisson: torch.Tensor,
        push: Push | None = None,
        report: Callable[[float], None] | None = None,
    ) -> Iterator[State]:
        """States at all frames under the force and damping of the unknowns."""
        return simulator.march(
            start,
            young,
            poisson,
            self.density_of(unknowns.force) if self.nodes is None else self.nodes.silent(len(unknowns.force) - 1).to(young),
            unknowns.damping.mass_per_s,
            density=self._density(unknowns),
            push=push,
            after_frame=lambda state: self.damping.kick(state, unknowns.damping.stiffness_s),
            report=report,
        )

    def _start(self, unknowns: Unknowns, young: torch.Tensor, poisson: torch.Tensor, simulator: Simulator) -> State:
        """Frame 0: settled under gravity, then the recovered initial motion on top."""
        state = simulator.rest()
        if self.disc.sag_gradient is not None:
            state = simulator.settle(young, poisson, simulator.tensor(self.disc.sag_gradient), density=self._density(unknowns))
        if not self.layout.motion_unit.size:
            return state
        strain = self.basis_gradient @ unknowns.initial_displacement
        F = state.F + strain @ state.F
        if self.prepared.tracks.first is not None:  # the particles are those of a pose near rest, not those of frame 0
            state = state.replace(x=state.x + self.basis @ unknowns.initial_displacement)
        v, C = (field @ unknowns.initial_velocity for field in (self.basis, self.basis_gradient))
        return state.replace(v=v.expand_as(state.v), C=C.expand_as(state.C), F=F)

    def _modal_damping(self) -> ModalDamping:
        young = self.prepared.start.young
        omega2, shapes = self.prepared.modal.eigen(young)
        shapes, omega = shapes[:, :DAMPED_MODES], np.sqrt(np.maximum(omega2[:DAMPED_MODES], 0.0))
        own = np.zeros_like(omega)
        own[: len(self.disc.loss)] = self.disc.loss[: len(omega)] * self.simulator.substeps / self.simulator.period_s
        off = self.prepared.modal.retuning
        retuning = shapes.T @ off @ shapes if off.any() and not self.layout.motion_unit.size else None  # about frame 0, where that is at rest
        return ModalDamping.of(self.simulator, self.disc.basis @ shapes, self.disc.basis_gradient @ shapes, omega, own, retuning)
