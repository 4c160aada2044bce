"""The door of both engines: unknowns in, motion of the particles out, differentiable.

`modes` is linear and takes milliseconds: eigenmodes of the finite elements. `mpm` is nonlinear: material points on the fit's grid. Both
answer the same question, so a stage of a fit may use either, and what one of them found is where the other begins.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import torch

from .forward import FieldForce, ForwardModel, Motion
from .linear_model import LinearModel
from .unknowns import Unknowns


class Engine(Protocol):
    """Unknowns -> Motion."""

    def simulate(
        self,
        unknowns: Unknowns,
        young: torch.Tensor,
        field_poisson: torch.Tensor | None = None,
        field_force: torch.Tensor | FieldForce | None = None,
        *,
        report: Callable[[float], None] | None = None,
    ) -> Motion:
        """Motion of the particles with E [Pa] of each (P,), on top of the unknowns' constants; the rest are fields (see model.py). Raises
        SimulationError where the motion leaves what the engine carries, ValueError for fields that it knows nothing of."""
        ...


def engines(forward: ForwardModel) -> dict[str, Engine]:
    """By name."""
    return {"modes": LinearModel(forward), "mpm": forward}
