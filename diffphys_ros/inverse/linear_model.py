"""Engine 1: the motion of a few modes of the finite-element body; linear, exact in time, differentiable in double precision."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import torch

from ..damping import Damping
from .forward import FieldForce, ForwardModel, Motion
from .linear import footprint_load
from .unknowns import Unknowns

UNKNOWN_TO_MODES = frozenset({"density", "poisson"})
DOUBLE: dict[str, Any] = {"dtype": torch.float64, "device": "cpu"}


class LinearModel:
    """Unknowns -> Motion, as `ForwardModel`. Young's moduli are the grid's; its apparent stiffness makes them the body's."""

    def __init__(self, forward: ForwardModel) -> None:
        modal = forward.prepared.modal
        self.forward = forward
        self.stiffness, self.added = torch.as_tensor(modal.stiffness, **DOUBLE), torch.as_tensor(modal.geometric + modal.retuning, **DOUBLE)
        self.basis, self.basis_gradient = (torch.as_tensor(a, **DOUBLE) for a in (forward.disc.basis, forward.disc.basis_gradient))

    @cached_property
    def load(self) -> torch.Tensor:
        """Modal loads (r, 3) of unit amplitudes of the force."""
        return torch.as_tensor(footprint_load(self.forward.prepared), **DOUBLE)

    def simulate(
        self,
        unknowns: Unknowns,
        young: torch.Tensor,
        field_poisson: torch.Tensor | None = None,
        field_force: torch.Tensor | FieldForce | None = None,
        *,
        report: Callable[[float], None] | None = None,
    ) -> Motion:
        """Motion under constants per part and one vector per frame. Raises ValueError for fields, densities and Poisson's ratios."""
        if not (field_poisson is None and field_force is None and unknowns.density is None and unknowns.poisson is None):
            raise ValueError("eigenmodes know neither fields nor densities nor Poisson's ratios; hold them, or take the engine mpm")
        simulator, q = self.forward.simulator, self.coordinates(unknowns)
        if report:
            report(1.0)
        displacement, gradient = (torch.tensordot(q - q[:1], shape, ([1], [shape.ndim - 1])).to(simulator.x_rest) for shape in (self.basis, self.basis_gradient))
        start = simulator.rest(v=(self.basis @ unknowns.initial_velocity.to(**DOUBLE)).to(simulator.x_rest))
        force = self.forward.density_of(unknowns.force)
        return Motion(simulator.x_rest + displacement, gradient + torch.eye(3, **simulator.options), force, unknowns, start, young, self.forward.poisson)

    def coordinates(self, unknowns: Unknowns) -> torch.Tensor:
        """Basis coordinates (T, r) at the frames, as `ModalModel.respond` has them, with derivatives. By the exponential of the state's
        matrix and not by eigenmodes: a body that is as thick as wide has equal frequencies, whose modes have no derivative."""
        young = unknowns.young.to(**DOUBLE) * self.forward.disc.apparent
        stiffness = torch.einsum("i,iab->ab", young, self.stiffness) + self.added
        transition, push = self._step(stiffness, unknowns.damping)
        state = torch.cat([unknowns.initial_displacement.to(**DOUBLE), unknowns.initial_velocity.to(**DOUBLE)])
        rows = [state]
        for acting in unknowns.force.to(**DOUBLE)[:-1] @ self.load.T:
            rows.append(transition @ rows[-1] + push @ acting)
        return torch.stack(rows)[:, : len(stiffness)]

    def _step(self, stiffness: torch.Tensor, damping: Damping[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        """Of q'' + (alpha + beta K) q' + K q = p over a frame: what becomes of a state (q, q'), (2 r, 2 r), and what a load p adds, (2 r, r).

        Rates are counted in units of the fastest frequency, so that no entry outgrows the others."""
        r, unit = len(stiffness), torch.eye(len(stiffness), **DOUBLE)
        fast = stiffness.diagonal().max().detach().clamp_min(1.0).sqrt()
        none = torch.zeros_like(stiffness)
        alpha, beta = damping.mass_per_s.to(**DOUBLE), damping.stiffness_s.to(**DOUBLE)
        rows = [[none, fast * unit, none], [-stiffness / fast, -alpha * unit - beta * stiffness, unit / fast], [none, none, none]]
        exponential = torch.linalg.matrix_exp(torch.cat([torch.cat(row, 1) for row in rows]) * self.forward.prepared.clip.period_s)
        scale = torch.cat([torch.ones(r, **DOUBLE), fast.expand(r)])
        return scale[:, None] * exponential[: 2 * r, : 2 * r] / scale, scale[:, None] * exponential[: 2 * r, 2 * r :]
