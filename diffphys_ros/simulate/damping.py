"""Stiffness-proportional (Kelvin-Voigt) damping, split from the explicit substeps and applied once per frame.

A viscous stress beta C : d(strain)/dt inside an explicit substep would bound the time step by dx^2 (17 times more
substeps at beta = 1.7 ms on a soft beam). Its effect on the modes of the body is known exactly, though: mode m with
angular frequency w_m loses velocity at the rate beta w_m^2. So at every frame boundary the velocity's modal part is
multiplied by exp(-beta w_m^2 period): unconditionally stable, independent of the number of substeps, differentiable in
beta, and it leaves positions and everything outside the given modes alone. An oscillation's amplitude then decays at
beta w^2 / 2, on average over its phase; modes that are not given are damped by the mass damping and the lattice only.

The same kick carries by how much a body's frequencies were seen to be off those of its shape as it was told or measured (`retuning`): a
symplectic kick of the velocity by the modal displacement, right to first order in the change at any frequency that the frames resolve.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from .state import State
from .transition import Simulator


class ModalDamping:
    """The frame-boundary kick for k mode shapes of one body."""

    def __init__(self, shapes: Tensor, gradients: Tensor, angular_frequencies: Tensor, mass: Tensor, *, period_s: float, own: Tensor | None = None, retuning: Tensor | None = None, rest: Tensor | None = None):
        """`shapes` (P, 3, k) at the particles' rest positions, in any scale; `gradients` (P, 3, 3, k): d(shape_a)/dX_b [1/m];
        `angular_frequencies` (k,) [rad/s]; `mass` (P,) [kg]; `period_s` between frames; `own` (k,) [1/s]: at which rate the simulator alone makes the modes
        decay, which is given back; `retuning` (k, k) [1/s^2]: what to add to the modes' stiffness about the positions `rest` (P, 3) [m].
        Raises InputError."""
        count, _, modes = shapes.shape
        if gradients.shape != (count, 3, 3, modes) or angular_frequencies.shape != (modes,) or mass.shape != (count,):
            raise InputError(
                f"mode shapes of {count} particles and {modes} modes need gradients ({count}, 3, 3, {modes}), "
                f"{modes} frequencies and {count} masses; got {tuple(gradients.shape)}, {tuple(angular_frequencies.shape)} and {tuple(mass.shape)}"
            )
        weighted = shapes * mass[:, None, None]
        gram = torch.einsum("pak,pal->kl", weighted, shapes)
        self.shapes, self.gradients, self.angular_frequencies = shapes, gradients, angular_frequencies
        self.own = torch.zeros_like(angular_frequencies) if own is None else own
        self.rates = angular_frequencies**2 * period_s  # loss exponent of one frame over beta
        self.gain = 2.0 * self.own * period_s  # of one frame: velocity alone makes up for what velocity and displacement lost
        self.retuning, self.rest, self.period_s = retuning, rest, period_s
        self.projection = torch.linalg.solve(gram, weighted.flatten(0, 1).T)  # modal velocity of a field (k, 3 P)

    @classmethod
    def of(
        cls, simulator: Simulator, shapes: np.ndarray, gradients: np.ndarray, angular_frequencies: np.ndarray, own: np.ndarray | None = None, retuning: np.ndarray | None = None
    ) -> ModalDamping:
        """From arrays, in the scalar type, device, masses and frame period of a Simulator."""
        mass = simulator.density * simulator.volume
        see = simulator.tensor
        back, added = (None if values is None else see(values) for values in (own, retuning))
        return cls(see(shapes), see(gradients), see(angular_frequencies), mass, period_s=simulator.period_s, own=back, retuning=added, rest=simulator.x_rest)

    def kick(self, state: State, beta: Tensor | float) -> State:
        """The state after one frame's worth of viscous loss and retuning; `beta` [s] >= 0, in a batch also (B,). Differentiable in both."""
        beta = torch.as_tensor(beta, dtype=self.rates.dtype, device=self.rates.device)[..., None]
        amplitude = state.v.flatten(-2) @ self.projection.T
        lost = -torch.expm1(self.gain - beta * self.rates) * amplitude
        if self.retuning is not None and self.rest is not None:
            lost = lost + self.period_s * ((state.x - self.rest).flatten(-2) @ self.projection.T) @ self.retuning.T
        v = state.v - (lost @ self.shapes.flatten(0, -2).T).view_as(state.v)
        return state.replace(v=v, C=state.C - (lost @ self.gradients.flatten(0, -2).T).view_as(state.C))
