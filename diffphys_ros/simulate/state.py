"""The moving part of the simulation: one contiguous torch tensor with named views."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

WIDTH = 24  # scalars per particle: x 3, v 3, C 9, F 9 (96 bytes in float32)


@dataclass(frozen=True)
class State:
    """Particles at one time, or at several: leading dimensions of `data` before (P, 24) are times."""

    data: Tensor  # shape (..., P, 24), contiguous

    @classmethod
    def assemble(cls, x: Tensor, v: Tensor, C: Tensor, F: Tensor) -> State:
        """A state from x, v (..., P, 3) and C, F (..., P, 3, 3); differentiable."""
        return cls(torch.cat([x, v, C.flatten(-2), F.flatten(-2)], -1))

    @property
    def x(self) -> Tensor:
        """Positions in the body frame [m], shape (..., P, 3)."""
        return self.data[..., 0:3]

    @property
    def v(self) -> Tensor:
        """Velocities [m/s], shape (..., P, 3)."""
        return self.data[..., 3:6]

    @property
    def C(self) -> Tensor:  # noqa: N802 (the field's name)
        """Affine velocity gradients (APIC) [1/s], shape (..., P, 3, 3); of an anchored rollout with respect to positions at its start."""
        return self.data[..., 6:15].unflatten(-1, (3, 3))

    @property
    def F(self) -> Tensor:  # noqa: N802
        """Deformation gradients, shape (..., P, 3, 3)."""
        return self.data[..., 15:24].unflatten(-1, (3, 3))

    def replace(self, *, x: Tensor | None = None, v: Tensor | None = None, C: Tensor | None = None, F: Tensor | None = None) -> State:
        """The same state with some of its parts exchanged; differentiable."""
        pick = (self.x if x is None else x, self.v if v is None else v, self.C if C is None else C, self.F if F is None else F)
        return State.assemble(*pick)

    def restated(self, anchor: State) -> State:
        """The same state with C with respect to the positions it has, where it was so to those in `anchor`; differentiable."""
        return self.replace(C=self.C @ anchor.F @ torch.linalg.inv(self.F))

    def detach(self) -> State:
        """The same values without their history."""
        return State(self.data.detach())
