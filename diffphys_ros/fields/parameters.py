"""The vector of unknowns of the inverse problem and its meaning.

One flat vector z of dimensionless numbers of order one, so that one step length suits all:
log E per part (natural logarithm over the start value), damping, force amplitude per forced frame, initial motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ..types import StartValues

DAMPING_UNIT_PER_S = 1.0  # alpha: APIC's own dissipation is .1-.45 1/s, so corrections are of this size


@dataclass(frozen=True)
class Unknowns:
    """What a vector z stands for; torch tensors that carry gradients to it."""

    young: torch.Tensor  # per part [Pa], (n,)
    mass_damping: torch.Tensor  # alpha [1/s], ()
    stiffness_damping: torch.Tensor  # beta [s], ()
    force: torch.Tensor  # amplitude per frame, body frame [N/m^3], (T, 3); zero off the support
    initial_displacement: torch.Tensor  # modal coordinates, (r,)
    initial_velocity: torch.Tensor  # modal coordinates [1/s], (r,)


@dataclass(frozen=True)
class Layout:
    """Where each unknown lies in z, and its unit.

    z = 0 is not the start: `start` is, because force amplitudes are measured from zero while log E is measured from the
    start value.
    """

    young: np.ndarray  # start values [Pa], (n,)
    mass_damping: float  # start value [1/s]
    stiffness_damping: float  # start value [s]
    stiffness_unit_s: float  # unit of beta [s]
    forced: np.ndarray  # frames that may carry a force, (F,) int
    frames: int
    force_unit: float  # [N/m^3]
    motion_unit: np.ndarray  # unit of the initial modal coordinates and rates, (2, r); r = 0 when at rest
    start: np.ndarray  # (size,)

    @classmethod
    def of(cls, start: StartValues, *, force_unit: float, initial_modes: int, motion_unit: np.ndarray) -> Layout:
        """Layout around start values; `initial_modes` leading modal coordinates of the initial motion are unknown."""
        forced = np.flatnonzero(start.forced)
        units = np.asarray(motion_unit, float).reshape(2, -1)[:, :initial_modes]
        z = np.concatenate([
            np.zeros(len(start.young) + 2),
            start.force[forced].ravel() / force_unit,
            (start.initial_displacement[:initial_modes] / units[0]),
            (start.initial_velocity[:initial_modes] / units[1]),
        ])
        beta_unit = max(start.stiffness_damping, 5e-4)
        return cls(start.young.copy(), start.mass_damping, start.stiffness_damping, beta_unit, forced, len(start.forced), force_unit, units, z)

    @property
    def parts(self) -> int:
        """Number of parts."""
        return len(self.young)

    @property
    def size(self) -> int:
        """Length of z."""
        return len(self.start)

    @property
    def force_slice(self) -> slice:
        """Where the force amplitudes lie in z."""
        first = self.parts + 2
        return slice(first, first + 3 * len(self.forced))

    @property
    def motion_slice(self) -> slice:
        """Where the initial motion lies in z: displacements, then rates."""
        return slice(self.force_slice.stop, self.size)

    def young_of(self, z: np.ndarray) -> np.ndarray:
        """Young's modulus per part [Pa], (n,)."""
        return self.young * np.exp(z[: self.parts])

    def unpack(self, z: torch.Tensor, *, modes: int) -> Unknowns:
        """The unknowns that z (size,) stands for; initial motion padded with zeros to `modes` coordinates."""
        like: dict[str, Any] = {"dtype": z.dtype, "device": z.device}
        n = self.parts
        force = torch.zeros((self.frames, 3), **like)
        if len(self.forced):
            index = torch.as_tensor(self.forced, device=z.device)
            force = force.index_copy(0, index, z[self.force_slice].reshape(-1, 3) * self.force_unit)
        motion = z[self.motion_slice].reshape(2, -1) * torch.as_tensor(self.motion_unit, **like)
        motion = torch.nn.functional.pad(motion, (0, modes - motion.shape[1]))
        return Unknowns(
            young=torch.as_tensor(self.young, **like) * torch.exp(z[:n]),
            mass_damping=self.mass_damping + DAMPING_UNIT_PER_S * z[n],
            stiffness_damping=self.stiffness_damping + self.stiffness_unit_s * z[n + 1],
            force=force,
            initial_displacement=motion[0],
            initial_velocity=motion[1],
        )

    def scale(self) -> np.ndarray:
        """d(unknown)/dz at the start in the order of z, (size,): log E [1], alpha [1/s], beta [s], force [N/m^3], motion."""
        return np.concatenate([
            np.ones(self.parts),
            [DAMPING_UNIT_PER_S, self.stiffness_unit_s],
            np.full(3 * len(self.forced), self.force_unit),
            self.motion_unit.ravel(),
        ])
