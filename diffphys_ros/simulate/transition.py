"""The one border between torch and Warp: a frame of the simulation as a differentiable torch function (paper A.10)."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..types import Grid, Particles
from .borders import Borders, Handle, Plane
from .force_lattice import ForceLattice
from .handle import node_motion, substep_poses
from .laws import LAWS, VISCOSITY, constants
from .replay import Replay
from .scratch import NO_FLAG
from .stability import max_viscosity, max_young, raise_for_flag
from .state import State

FORCE_ON = ("particles", "nodes", "lattice")

AfterFrame = Callable[[State], State]


class _Frame(torch.autograd.Function):
    """Saves the state at the start of the frame and replays the frame in the backward pass."""

    @staticmethod
    def forward(ctx: Any, replay: Replay, data: Tensor, *values: Tensor) -> Tensor:
        after, ctx.box, ctx.lease = replay.forward(data, values, keep=any(ctx.needs_input_grad))
        ctx.replay = replay
        ctx.save_for_backward(data, *values)
        return after

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        data, *values = ctx.saved_tensors
        data_bar, inputs_bar = ctx.replay.backward(data, tuple(values), grad_outputs[0], ctx.box, ctx.lease)
        return None, data_bar, *(bar.clone() for bar in inputs_bar.tensors())


def _check_name(kind: str, value: str, known: Iterable[str]) -> None:
    if value not in known:
        close = difflib.get_close_matches(value, list(known), 1, 0.4)
        raise InputError(
            f"{kind} {value!r} is unknown; " + (f"did you mean {close[0]!r}" if close else "choose one of " + ", ".join(known))
        )


class Simulator:
    """Explicit MLS-MPM of one body on one grid, differentiable frame by frame.

    Every length is in the body frame. A rollout keeps about 96 bytes x particles x frames (float32), and the simulator
    96 bytes x particles x 2 sqrt(substeps) beside its grids; up to `memory_budget_mb` it keeps substep states of whole
    frames instead, which saves replays and changes no result.
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
        memory_budget_mb: float = 512.0,
    ):
        """`substeps` per frame of `period_s` [s]; `gravity` [m/s^2]; `law`: a name in laws.LAWS.

        `law_parameters`: what the law takes beside E and nu, by name (LAWS[law].parameters), one value or one a particle
        each; a tensor that requires a gradient gets one.
        `force_on` "particles", "nodes" or "lattice" says where force densities live (paper Eq. 9: nodes). Node i receives
        f(x_i) sum_p w_ip V_p and particle p receives f_p V_p: a uniform f adds up to f V either way. A lattice of
        `force_lattice` nodes along each axis (see ForceLattice) is read at the nodes. `planes` are floor and walls, met in
        this order, `handle` moves what it holds. Raises InputError.
        """
        _check_name("law", law, LAWS)
        _check_name("force_on", force_on, FORCE_ON)
        if substeps < 1:
            raise InputError(f"substeps is {substeps}, must be at least 1; choose it with substeps_per_frame")
        self.particles, self.grid, self.substeps, self.period_s = particles, grid, int(substeps), float(period_s)
        self.options: dict[str, Any] = {"dtype": dtype, "device": torch.device(device)}
        self.x_rest = self.tensor(particles.x_rest)
        self.volume = self.tensor(particles.volume)
        self.density = self.tensor(particles.density)
        self.gravity = self.tensor(np.asarray(gravity, float))
        self._check_reach()
        self.law, self.law_parameters = LAWS[law], constants.checked(law, LAWS[law], law_parameters or {})
        self._check_viscosity()
        self.nodal = force_on != "particles"
        self.force_lattice = ForceLattice(grid, force_lattice, **self.options) if force_on == "lattice" else None
        self.borders = Borders(tuple(planes), handle)
        self.replay = Replay(
            self.x_rest,
            self.volume,
            float(particles.mass.mean()),
            grid,
            substeps=self.substeps,
            period_s=self.period_s,
            law=law,
            nodal=self.nodal,
            borders=self.borders,
            budget=memory_budget_mb * 2**20,
        )

    def tensor(self, values: np.ndarray | Tensor | Sequence[float] | float) -> Tensor:
        """Values in the simulator's scalar type, on its device."""
        return torch.as_tensor(values).to(**self.options).contiguous()

    def rest(self, *, x: Tensor | None = None, v: Tensor | None = None, C: Tensor | None = None, F: Tensor | None = None) -> State:
        """The body at rest and free of stress, with some of its parts exchanged; shapes as in State."""
        zero = torch.zeros_like(self.x_rest)
        unit = torch.eye(3, **self.options).expand(len(zero), 3, 3)
        still = State.assemble(self.x_rest, zero, torch.zeros_like(unit), unit)
        return still if x is v is C is F is None else still.replace(x=x, v=v, C=C, F=F)

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
        number: int = 0,
    ) -> State:
        """The state one frame later; differentiable with respect to every tensor.

        `young` [Pa], `poisson`, `density` [kg/m^3] (that of the particles where left out) have shape (P,) or (), `force`
        is a density [N/m^3 of rest volume] of shape (P, 3) (on nodes: (nx, ny, nz, 3); on a lattice: its shape), constant
        over the frame, `mass_damping` alpha [1/s] acts as the force density -alpha rho v. `friction` (planes,) replaces
        that of the planes; `handle_path` (substeps + 1, 4, 4) are the handle's poses body_from_handle at the substep
        boundaries (substep_poses), else it stands. `number` names the frame in errors. Raises SimulationError.
        """
        material = self._material(young, poisson, density)
        return self._step(state, material, force, self._drag(mass_damping), self._borders(friction, handle_path), number)

    def rollout(
        self,
        state: State,
        young: Tensor,
        poisson: Tensor,
        force: Tensor,
        mass_damping: Tensor | float,
        *,
        density: Tensor | None = None,
        friction: Tensor | None = None,
        handle_poses: Tensor | None = None,
        after_frame: AfterFrame | None = None,
        report: Callable[[float], None] | None = None,
    ) -> State:
        """States at all T frames, as one State of shape (T, P, 24); the first is `state`.

        `force` has shape (T - 1, P, 3): force[k] acts between frames k and k + 1. `handle_poses` (T, 4, 4) are the
        handle's poses body_from_handle at the frames; `after_frame` maps the state at each new frame (stiffness damping);
        `report` hears the share of frames done. Else as in `frame`.
        """
        material, drag = self._material(young, poisson, density), self._drag(mass_damping)
        paths = self._paths(handle_poses, len(force))
        states = [state]
        for k, density_of_force in enumerate(force):
            after = self._step(states[-1], material, density_of_force, drag, self._borders(friction, paths[k]), k)
            states.append(after_frame(after) if after_frame else after)
            if report:
                report((k + 1) / len(force))
        return State(torch.stack([s.data for s in states]))

    def settle(
        self,
        young: Tensor,
        poisson: Tensor,
        displacement_gradient: Tensor,
        *,
        frames: int = 3,
        mass_damping: float = 25.0,
        density: Tensor | None = None,
        friction: Tensor | None = None,
    ) -> State:
        """Frame 0 in static equilibrium under gravity: the particles at rest positions, prestressed, still.

        `displacement_gradient` (P, 3, 3) is that of the static sag under gravity, so that rest positions are where
        the body hangs, not where it would lie free of stress. A few heavily damped frames (`mass_damping` [1/s]) take
        up what the lattice does otherwise; velocities end at zero. Measure displacements from the state returned.
        """
        state = self.rest(F=torch.eye(3, **self.options) + displacement_gradient)
        for k in range(frames):
            state = self.frame(state, young, poisson, None, mass_damping, density=density, friction=friction, number=k - frames)
        return state.replace(v=torch.zeros_like(state.v), C=torch.zeros_like(state.C))

    def max_young(self) -> float:
        """Largest Young's modulus [Pa] that the substeps carry at CFL 0.5, for the particles' Poisson's ratio and density."""
        p = self.particles
        return float(max_young(self.substeps, p.poisson, p.density, dx=self.grid.dx, period_s=self.period_s).min())

    def scratch_bytes(self) -> int:
        """Memory of the simulator itself once gradients were asked for [bytes]; a rollout adds 96 B x particles x frames."""
        return self.replay.bytes()

    def _material(self, young: Tensor, poisson: Tensor, density: Tensor | None) -> tuple[Tensor, Tensor]:
        """Constants of the law (P, 4) and density [kg/m^3] (P,)."""
        of_law = constants.stacked(self.law, young, poisson, self.law_parameters, self.volume)
        return of_law, self.tensor(self.density if density is None else density).expand_as(self.volume)

    def _drag(self, mass_damping: Tensor | float) -> Tensor:
        """Share of velocity that mass damping leaves after one substep, shape (1,)."""
        alpha = torch.as_tensor(mass_damping).to(**self.options)
        return torch.exp(-alpha * (self.period_s / self.substeps)).reshape(1)

    def _paths(self, poses: Tensor | None, frames: int) -> Sequence[Tensor | None]:
        """Poses at the substep boundaries of every frame."""
        if poses is None:
            return [None] * frames
        if len(poses) != frames + 1:
            raise InputError(f"handle_poses: there are {len(poses)} for {frames + 1} frames; give one pose a frame")
        return substep_poses(poses, self.substeps)  # type: ignore[return-value]

    def _borders(self, friction: Tensor | None, path: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
        """What of the borders may change from frame to frame: Inputs.friction, motion and handle_from_body."""
        if not self.borders:
            return self.volume.new_zeros(0), self.volume.new_zeros(0, 3, 4), self.volume.new_zeros(0, 3, 4)
        handle = self.borders.handle
        if path is not None and (handle is None or path.shape != (self.substeps + 1, 4, 4)):
            raise InputError(
                f"handle_path has shape {tuple(path.shape)} for {self.substeps} substeps; give the simulator a handle and one pose at each of their {self.substeps + 1} boundaries"
            )
        if path is None:
            pose = torch.as_tensor(handle.pose if handle else np.eye(4), dtype=torch.float64, device=self.volume.device)
            path = pose.expand(self.substeps + 1, 4, 4)
        rubbing = np.array([plane.friction for plane in self.borders.planes]) if friction is None else friction
        motion, there = node_motion(path, self.period_s / self.substeps)
        return self.tensor(rubbing), self.tensor(motion), self.tensor(there)

    def _step(
        self,
        state: State,
        material: tuple[Tensor, Tensor],
        force: Tensor | None,
        drag: Tensor,
        borders: tuple[Tensor, Tensor, Tensor],
        number: int,
    ) -> State:
        of_law, density = material
        body, node_force = density[:, None] * self.gravity, self.volume.new_zeros(1, 3)
        if force is not None and self.nodal:
            node_force = (self.force_lattice.on_nodes(force) if self.force_lattice else force).reshape(-1, 3)
        elif force is not None:
            body = body + force
        elif self.nodal:
            node_force = node_force.expand(math.prod(self.grid.size), 3)
        inputs = of_law, body, density * self.volume, drag, node_force, *borders
        data = _Frame.apply(self.replay, state.data.contiguous(), *inputs)
        self._check_flag(number, of_law.detach())
        return State(data)

    def _check_flag(self, number: int, of_law: Tensor) -> None:
        code = self.replay.code
        if code == NO_FLAG:
            return
        mu, lam = of_law[:, 0], of_law[:, 1]
        count = len(self.volume)
        raise_for_flag(
            code,
            particles=count,
            frame=number,
            substeps=self.substeps,
            where=self.replay.position(code),
            stiffest=float((mu * (3 * lam + 2 * mu) / (lam + mu)).max()),
            allowed=self.max_young(),
        )

    def _check_viscosity(self) -> None:
        viscosity = float(torch.as_tensor(self.law_parameters.get(VISCOSITY, 0.0)).max())
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
