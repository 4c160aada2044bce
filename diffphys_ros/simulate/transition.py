"""The one border between torch and Warp: a frame of the simulation as a differentiable torch function (paper A.10)."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..types import Grid, Particles
from .borders import Borders, Handle, Plane
from .force_lattice import ForceLattice
from .handle import node_motion, substep_poses
from .laws import LAWS, VISCOSITY, constants
from .run.replay import Replay
from .stability import max_viscosity, max_young, raise_for_flag
from .state import State

SETTLING_DAMPING = 25.0  # of the frames that take a body into its static equilibrium [1/s]
ANCHORED_PER_CELL = 1.55  # particles per cell and axis from which a lattice has no motions that strain no particle; those that have
# creep along them under a steady force while weights stay
FORCE_ON = ("particles", "nodes", "lattice")

AfterFrame = Callable[[State], State]
Push = Callable[[State, int], Tensor]


class Options(TypedDict, total=False):
    """What a rollout may be given beside what moves the body at the least."""

    density: Tensor | None  # [kg/m^3]; that of the particles where left out
    friction: Tensor | None  # (planes,), in the place of that of the planes
    handle_poses: Tensor | None  # the handle's poses body_from_handle at the frames, (T, 4, 4) or (B, T, 4, 4)
    after_frame: AfterFrame | None  # maps the state at each new frame (stiffness damping)
    cut_every: int | None  # gradients do not pass frames cut_every, 2 cut_every, ..: they see at most so many frames back
    push: Push | None  # push(state, k) is a force on top of force[k], asked for once, with the state at frame k
    report: Callable[[float], None] | None  # hears the share of frames done


class _Frame(torch.autograd.Function):
    """Saves the state at the start of the frame and replays the frame in the backward pass."""

    @staticmethod
    def forward(ctx: Any, replay: Replay, data: Tensor, *values: Tensor) -> Tensor:
        after, ctx.place = replay.forward(data, values, keep=any(ctx.needs_input_grad))
        ctx.replay = replay
        ctx.save_for_backward(data, *values)
        return after

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        data, *values = ctx.saved_tensors
        data_bar, inputs_bar = ctx.replay.backward(data, tuple(values), grad_outputs[0], ctx.place)
        bars = zip(inputs_bar.tensors(), ctx.needs_input_grad[2:], strict=True)
        return None, data_bar, *(bar.clone() if needed else None for bar, needed in bars)


def _check(law: str, force_on: str, substeps: int, batch: int | None) -> None:
    """Raises InputError for names and counts that a simulator cannot have."""
    _check_name("law", law, LAWS)
    _check_name("force_on", force_on, FORCE_ON)
    if substeps < 1:
        raise InputError(f"substeps is {substeps}, must be at least 1; choose it with substeps_per_frame")
    if batch is not None and batch < 1:
        raise InputError(f"batch is {batch}, must be at least 1; leave it out for one simulation")


def _check_name(kind: str, value: str, known: Iterable[str]) -> None:
    if value not in known:
        close = difflib.get_close_matches(value, list(known), 1, 0.4)
        raise InputError(
            f"{kind} {value!r} is unknown; " + (f"did you mean {close[0]!r}" if close else "choose one of " + ", ".join(known))
        )


class Simulator:
    """Explicit MLS-MPM of one body on one grid, differentiable frame by frame; of `batch` such simulations at once where
    that is given.

    Every length is in the body frame. A rollout keeps about 96 bytes x batch x particles x frames (float32), and the
    simulator 96 bytes x batch x particles x 2 sqrt(substeps) beside its grids; up to `memory_budget_mb` it keeps substep
    states of whole frames instead, which saves replays and changes no result; not where that is a small share of the `frames` of a
    rollout.

    In a batch of B every shape below that starts with P may have a leading B, and states always have: (B, P, 24). Inputs
    without it are shared. A value for each simulation and not for each particle has shape (B, 1); mass damping (B,).
    The simulations know nothing of each other: each equals the same run alone, to the bit on a CPU.
    """

    def __init__(
        self,
        particles: Particles,
        grid: Grid,
        *,
        substeps: int,
        period_s: float,
        gravity: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
        device: str = "cpu",
        dtype: torch.dtype = torch.float32,
        law: str = "neo_hookean",
        law_parameters: constants.Given | None = None,
        force_on: str = "particles",
        force_lattice: Sequence[int] | None = None,
        planes: Sequence[Plane] = (),
        handle: Handle | None = None,
        batch: int | None = None,
        anchored: bool | None = None,
        memory_budget_mb: float = 512.0,
        frames: int = 0,
    ):
        """`substeps` per frame of `period_s` [s]; `gravity` [m/s^2]; `law`: a name in laws.LAWS.

        `law_parameters`: what the law takes beside E and nu, by name (LAWS[law].parameters), one value or one a particle
        each; a tensor that requires a gradient gets one.
        `force_on` "particles", "nodes" or "lattice" says where force densities live (paper Eq. 9: nodes). Node i receives
        f(x_i) sum_p w_ip V_p and particle p receives f_p V_p: a uniform f adds up to f V either way. A lattice of
        `force_lattice` nodes along each axis (see ForceLattice) is read at the nodes. `planes` are floor and walls, met in
        this order, `handle` moves what it holds.
        `anchored`: particles keep the weights that they have at the start of a rollout (total Lagrangian: de Vaucorbeil et al. 2020),
        so that x and F stay one motion however long it lasts. Where they do not, weights move along: what flows and what
        planes or a handle hold needs that, what may leave its planes again does not. None: anchored where possible and where there are ANCHORED_PER_CELL particles. Raises InputError.
        """
        _check(law, force_on, substeps, batch)
        self.particles, self.grid, self.substeps, self.period_s = particles, grid, int(substeps), float(period_s)
        self.batch, self._lead = batch or 1, () if batch is None else (batch,)
        self.options: dict[str, Any] = {"dtype": dtype, "device": torch.device(device)}
        self.x_rest = self.tensor(particles.x_rest)
        self.volume = self.tensor(particles.volume)
        self.density = self.tensor(particles.density)
        self.gravity = self.tensor(np.asarray(gravity, float))
        self._check_reach()
        self.law, self.law_parameters = LAWS[law], constants.checked(law, LAWS[law], law_parameters or {})
        self._check_viscosity()
        self._weight, self._mass = (
            self._each(self.density[:, None] * self.gravity, len(self.volume), 3),
            self._each(self.density * self.volume, len(self.volume)),
        )
        self._no_force = self.volume.new_zeros(0, 3)
        self.nodal = force_on != "particles"
        self.force_lattice = ForceLattice(grid, force_lattice, **self.options) if force_on == "lattice" else None
        self.borders = Borders(tuple(planes), handle)
        self.anchored = self._check_anchored(anchored)
        self._standing = self._stand()
        self.replay = self._replay(law, memory_budget_mb * 2**20, frames)

    def _replay(self, law: str, budget: float, frames: int) -> Replay:
        """What launches the substeps, with `budget` bytes for what it keeps."""
        sizes: dict[str, Any] = {"batch": self.batch, "substeps": self.substeps, "period_s": self.period_s, "budget": budget, "frames": frames}
        kind: dict[str, Any] = {"law": law, "nodal": self.nodal, "anchored": self.anchored, "borders": self.borders}
        return Replay(self.x_rest, self.volume, float(self.particles.mass.mean()), self.grid, **sizes, **kind)

    def tensor(self, values: np.ndarray | Tensor | Sequence[float] | float) -> Tensor:
        """Values in the simulator's scalar type, on its device."""
        return torch.as_tensor(values, **self.options).contiguous()

    def rest(self, *, x: Tensor | None = None, v: Tensor | None = None, C: Tensor | None = None, F: Tensor | None = None) -> State:
        """The body at rest and free of stress, with some of its parts exchanged; shapes as in State."""
        shape = (*self._lead, *self.x_rest.shape)
        zero, unit = torch.zeros_like(self.x_rest), torch.eye(3, **self.options)
        still = self.x_rest, zero, torch.zeros_like(unit), unit
        sizes = shape, shape, (*shape, 3), (*shape, 3)
        given = (mine if part is None else part for mine, part in zip(still, (x, v, C, F), strict=True))
        return State.assemble(*(part.expand(size) for part, size in zip(given, sizes, strict=True)))

    def frame(
        self,
        state: State,
        young: Tensor,
        poisson: Tensor,
        force: Tensor | None,
        mass_damping: Tensor | float,
        *,
        density: Tensor | None = None,
        friction: Tensor | None = None,
        handle_path: Tensor | None = None,
        anchor: State | None = None,
        number: int = 0,
    ) -> State:
        """The state one frame later; differentiable with respect to every tensor.

        `young` [Pa], `poisson`, `density` [kg/m^3] (that of the particles where left out) have shape (P,) or (), `force`
        is a density [N/m^3 of rest volume] of shape (P, 3) (on nodes: (nx, ny, nz, 3); on a lattice: its shape), constant
        over the frame, `mass_damping` alpha [1/s] acts as the force density -alpha rho v. `friction` (planes,) replaces
        that of the planes; `handle_path` (substeps + 1, 4, 4) are the handle's poses body_from_handle at the substep
        boundaries (substep_poses), else it stands. `anchor`: the state at the start of the motion, where this is not its first frame and
        the body is anchored; C is with respect to positions there, see `rollout`. `number` names the frame in errors. Raises SimulationError.
        """
        material = self._material(young, poisson, density)
        rubbing, place = self._borders(friction, handle_path), self._anchor(anchor or state)
        after = self._step(state, place, material, force, self._drag(mass_damping), rubbing, number)
        return after.restated(state) if self.anchored and anchor is None else after

    def rollout(
        self, state: State, young: Tensor, poisson: Tensor, force: Tensor, mass_damping: Tensor | float, **options: Unpack[Options]
    ) -> State:
        """States at all T frames, as one State of shape (T, P, 24), in a batch (T, B, P, 24); the first is `state`.

        Where the body is anchored, C of a state is the gradient with respect to the positions in `state`; `restated` makes it that
        with respect to its own, for a rollout that goes on from there.
        `force` has shape (T - 1, P, 3), in a batch also (T - 1, B, P, 3): force[k] acts between frames k and k + 1; for
        `options` see Options. Else as in `frame`.
        """
        return State(torch.stack([s.data for s in self.march(state, young, poisson, force, mass_damping, **options)]))

    def march(
        self, state: State, young: Tensor, poisson: Tensor, force: Tensor, mass_damping: Tensor | float, **options: Unpack[Options]
    ) -> Iterator[State]:
        """The states of `rollout` one by one, for who needs little of each."""
        material, drag = self._material(young, poisson, options.get("density")), self._drag(mass_damping)
        paths = self._paths(options.get("handle_poses"), len(force))
        cut_every, push = options.get("cut_every"), options.get("push")
        after_frame, report = options.get("after_frame"), options.get("report")
        anchor = self._anchor(state)
        yield state
        for k, density_of_force in enumerate(force):
            before = state
            if cut_every and k and k % cut_every == 0:
                before, anchor = state.detach(), anchor.detach()
            acting = density_of_force + push(before, k) if push else density_of_force
            after = self._step(before, anchor, material, acting, drag, self._borders(options.get("friction"), paths[k]), k)
            state = after_frame(after) if after_frame else after
            yield state
            if report:
                report((k + 1) / len(force))

    def settle(
        self,
        young: Tensor,
        poisson: Tensor,
        displacement_gradient: Tensor,
        *,
        frames: int = 3,
        density: Tensor | None = None,
        friction: Tensor | None = None,
    ) -> State:
        """Frame 0 in static equilibrium under gravity: the particles at rest positions, prestressed, still.

        `displacement_gradient` (P, 3, 3) is that of the static sag under gravity; its symmetric part is the stretch, since a turn
        makes no stress. Rest positions are where the body hangs, not where it would lie free of stress. A few heavily damped frames
        take up what the lattice does otherwise; velocities end at zero. Measure displacements from the state returned.
        """
        state = self.rest(F=torch.eye(3, **self.options) + 0.5 * (displacement_gradient + displacement_gradient.mT))
        anchor, drag = self._anchor(state), self._drag(SETTLING_DAMPING)
        material, borders = self._material(young, poisson, density), self._borders(friction, None)
        for k in range(frames):
            state = self._step(state, anchor, material, None, drag, borders, k - frames)
        return state.replace(v=torch.zeros_like(state.v), C=torch.zeros_like(state.C))

    def max_young(self, substeps: int | None = None) -> float:
        """Largest Young's modulus [Pa] that the substeps, or so many of them, carry at CFL 0.5, for the particles' Poisson's ratio and
        density."""
        p = self.particles
        return float(max_young(substeps or self.substeps, p.poisson, p.density, dx=self.grid.dx, period_s=self.period_s).min())

    def scratch_bytes(self) -> int:
        """Memory of the simulator itself once gradients were asked for [bytes]; a rollout adds 96 B x particles x frames."""
        return self.replay.bytes()

    def release(self) -> None:
        """Let what is kept between a rollout and its gradient go, until a gradient is asked for again."""
        self.replay.release()

    def _material(self, young: Tensor, poisson: Tensor, density: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
        """Constants of the law (B, P, 4), weight density [N/m^3] (B, P, 3) and mass [kg] (B, P)."""
        every = self._each(self.volume, len(self.volume))
        of_law = constants.stacked(self.law, young, poisson, self.law_parameters, every)
        weight, mass = self._weight, self._mass
        if density is not None:
            density = self.tensor(density).expand_as(every)
            weight, mass = density[..., None] * self.gravity, density * self.volume
        return of_law, weight, mass

    def _each(self, value: Tensor, *shape: int) -> Tensor:
        """A value for every simulation, shape (B, *shape)."""
        return value.expand(self.batch, *shape)

    def _drag(self, mass_damping: Tensor | float) -> Tensor:
        """Share of velocity that mass damping leaves after one substep, shape (B,)."""
        dt = self.period_s / self.substeps
        if not isinstance(mass_damping, Tensor):
            return torch.full((self.batch,), math.exp(-mass_damping * dt), **self.options)
        return self._each(torch.exp(-dt * mass_damping.to(**self.options)))

    def _paths(self, poses: Tensor | None, frames: int) -> Sequence[Tensor | None]:
        """Poses at the substep boundaries of every frame."""
        if poses is None:
            return [None] * frames
        if poses.shape[-3] != frames + 1:
            raise InputError(f"handle_poses: there are {poses.shape[-3]} for {frames + 1} frames; give one pose a frame")
        if poses.ndim == 4:
            return torch.stack([substep_poses(own, self.substeps) for own in poses], 1)  # type: ignore[return-value]
        return substep_poses(poses, self.substeps)  # type: ignore[return-value]

    def _borders(self, friction: Tensor | None, path: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
        """What of the borders may change from frame to frame: Inputs.friction, motion and handle_from_body."""
        rubbing, motion, there = self._standing
        planes = len(self.borders.planes)
        if friction is not None:
            if friction.ndim == 0 or friction.shape[-1] != planes:
                raise InputError(f"friction has shape {tuple(friction.shape)} for {planes} planes; give one coefficient a plane")
            rubbing = self._each(self.tensor(friction), planes)
        if path is not None:
            if self.borders.handle is None or path.shape[-3:] != (self.substeps + 1, 4, 4):
                raise InputError(
                    f"handle_path has shape {tuple(path.shape)} for {self.substeps} substeps; give the simulator a handle and one pose at each of their {self.substeps + 1} boundaries"
                )
            motion, there = self._motion(path)
        return rubbing, motion, there

    def _stand(self) -> tuple[Tensor, Tensor, Tensor]:
        """The same while the handle stands and planes rub as they were given; empty without borders."""
        rubbing = self._each(self.tensor(np.array([plane.friction for plane in self.borders.planes])), len(self.borders.planes))
        if not self.borders:
            none = self.volume.new_zeros(self.batch, 0, 3, 4)
            return rubbing, none, none
        pose = np.eye(4) if self.borders.handle is None else self.borders.handle.pose
        standing = torch.as_tensor(pose, dtype=torch.float64, device=self.volume.device).expand(self.substeps + 1, 4, 4)
        return rubbing, *self._motion(standing)

    def _motion(self, path: Tensor) -> tuple[Tensor, Tensor]:
        """Inputs.motion and handle_from_body of a handle along a path (substeps + 1, 4, 4), in a batch also (B, ..)."""
        own = path.expand(self.batch, self.substeps + 1, 4, 4).movedim(0, 1)
        motion, there = (self.tensor(a.movedim(1, 0)) for a in node_motion(own, self.period_s / self.substeps))
        return motion, there

    def _step(
        self,
        state: State,
        anchor: Tensor,
        material: tuple[Tensor, Tensor, Tensor],
        force: Tensor | None,
        drag: Tensor,
        borders: tuple[Tensor, Tensor, Tensor],
        number: int,
    ) -> State:
        of_law, body, mass = material
        node_force = self._no_force
        if force is not None and self.nodal:
            node_force = (self.force_lattice.on_nodes(force) if self.force_lattice else force).flatten(-4, -2)
        elif force is not None:
            body = body + force
        elif self.nodal:
            node_force = node_force.new_zeros(1, 3).expand(math.prod(self.grid.size), 3)
        loads = self._each(body, *self.x_rest.shape), mass, drag, self._each(node_force, *node_force.shape[-2:])
        data = state.data if self._lead else state.data[None]
        after = _Frame.apply(self.replay, data.contiguous(), of_law, *loads, *borders, anchor)
        if self.replay.flagged:
            self._raise(number, of_law.detach())
        return State(after if self._lead else after[0])

    def _raise(self, number: int, of_law: Tensor) -> None:
        simulation, code, where = self.replay.first_flag()
        mu, lam = of_law[simulation, :, 0], of_law[simulation, :, 1]
        raise_for_flag(
            code,
            particles=len(self.volume),
            frame=number,
            substeps=self.substeps,
            where=where,
            stiffest=float((mu * (3 * lam + 2 * mu) / (lam + mu)).max()),
            allowed=self.max_young(),
            simulation=simulation if self._lead else None,
        )

    def _anchor(self, state: State) -> Tensor:
        """Inputs.anchor of motions that start from a state."""
        if not self.anchored:
            return self.volume.new_zeros(self.batch, 0, 12)
        return self._each(torch.cat([state.x, state.F.flatten(-2)], -1), len(self.volume), 12)

    def _check_anchored(self, wanted: bool | None) -> bool:
        lets_go = self.borders.handle is None and all(plane.kind == "separate" for plane in self.borders.planes)
        possible = self.law.elastic and lets_go
        if wanted and not possible:
            raise InputError("anchored: what flows, and what planes or a handle hold, has weights that move along; leave `anchored` out")
        per_cell = self.grid.dx / float(np.median(self.particles.volume)) ** (1 / 3)
        return possible and per_cell >= ANCHORED_PER_CELL if wanted is None else wanted

    def _check_viscosity(self) -> None:
        viscosity = float(torch.as_tensor(self.law_parameters.get(VISCOSITY, 0.0)).detach().max())
        carried = max_viscosity(self.substeps, self.particles.density, dx=self.grid.dx, period_s=self.period_s)
        if viscosity > carried:
            raise InputError(
                f"{VISCOSITY} is {viscosity:.3g} Pa s, too large for {self.substeps} substeps; lower it below {carried:.3g} or raise the substeps"
            )

    def _check_reach(self) -> None:
        cells = (self.particles.x_rest - self.grid.origin) / self.grid.dx
        high = np.asarray(self.grid.size) - 1.5
        if not np.all((cells >= 0.5) & (cells < high)):
            raise InputError("grid: particles lie closer than half a cell to its border; fit the grid with a larger reach")
