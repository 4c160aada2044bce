"""The unknowns of the inverse problem, as one vector z.

z holds dimensionless numbers of order one, so that one step length suits all, in blocks: log E per part (over the start value), damping,
force amplitude per forced frame, initial motion, log density per part (over the told or assumed one), Poisson's ratio per part. Any block
may be held where it is. Fields of E and force take the place of their blocks once they begin (model.py).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ..damping import Damping
from ..errors import InputError, short
from ..types import Body, StartValues

DAMPING_UNIT_PER_S = 1.0  # alpha: APIC's own dissipation is .1-.45 1/s, so corrections are of this size
POISSON_UNIT = 0.05  # about what solids of one kind differ by
LEAST_BETA_UNIT_S = 5e-4
BLOCKS = ("young", "damping", "force", "motion", "density", "poisson")  # in the order of z


HELD = ("density", "poisson")  # where a person says nothing


def checked_hold(names: Collection[str] | None) -> frozenset[str]:
    """Names of the blocks that are held. Raises InputError for another name, or where nothing is left to find."""
    if names is None or list(names) == ["none"]:
        return frozenset(HELD if names is None else ())
    wrong = [name for name in names if name not in BLOCKS]
    if wrong:
        raise InputError(f"fit.hold holds {short(wrong[0])}, must be of {', '.join(BLOCKS)}, or none alone")
    if set(names) == set(BLOCKS):
        raise InputError("fit.hold holds every unknown; leave one of them out")
    return frozenset(names)


@dataclass(frozen=True)
class Unknowns:
    """What a vector z stands for; torch tensors that carry gradients to it."""

    young: torch.Tensor  # per part [Pa], (n,)
    damping: Damping[torch.Tensor]  # ()
    force: torch.Tensor  # amplitude per frame, body frame [N/m^3], (T, 3); zero off the support
    initial_displacement: torch.Tensor  # modal coordinates, (r,)
    initial_velocity: torch.Tensor  # modal coordinates [1/s], (r,)
    density: torch.Tensor | None  # per part [kg/m^3], (n,); None: the body's
    poisson: torch.Tensor | None  # per part, (n,); None: the body's


@dataclass(frozen=True)
class Layout:
    """Where each unknown lies in z, and its unit.

    z = 0 is not the start: `start` is, because force amplitudes are measured from zero while log E is measured from the
    start value.
    """

    young: np.ndarray  # start values [Pa], (n,)
    damping: Damping[float]  # start value
    damping_unit: Damping[float]
    forced: np.ndarray  # frames that may carry a force, (F,) int
    frames: int
    force_unit: float  # [N/m^3]
    motion_unit: np.ndarray  # unit of the initial modal coordinates and rates, (2, r); r = 0 when at rest
    density: np.ndarray  # told or assumed [kg/m^3], (n,)
    poisson: np.ndarray  # told or assumed, (n,)
    held: frozenset[str]  # blocks that stay as they are
    start: np.ndarray  # (size,)

    @classmethod
    def of(
        cls, start: StartValues, body: Body, *, force_unit: float, initial_modes: int, motion_unit: np.ndarray, held: Collection[str]
    ) -> Layout:
        """Layout around start values; `initial_modes` leading modal coordinates of the initial motion are unknown."""
        forced = np.flatnonzero(start.forced)
        units = np.asarray(motion_unit, float).reshape(2, -1)[:, :initial_modes]
        z = np.concatenate(
            [
                np.zeros(len(start.young) + 2),
                start.force[forced].ravel() / force_unit,
                (start.initial_displacement[:initial_modes] / units[0]),
                (start.initial_velocity[:initial_modes] / units[1]),
                np.zeros(2 * len(start.young)),
            ]
        )
        damping_unit = Damping(DAMPING_UNIT_PER_S, max(start.damping.stiffness_s, LEAST_BETA_UNIT_S))
        return cls(
            start.young.copy(), start.damping, damping_unit, forced, len(start.forced), force_unit, units, body.density, body.poisson, frozenset(held), z
        )

    @property
    def parts(self) -> int:
        """Number of parts."""
        return len(self.young)

    @property
    def size(self) -> int:
        """Length of z."""
        return len(self.start)

    @property
    def free(self) -> tuple[str, ...]:
        """The blocks that are not held, in the order of z."""
        return tuple(name for name in BLOCKS if name not in self.held)

    @property
    def slices(self) -> dict[str, slice]:
        """Where each of BLOCKS lies in z."""
        sizes = (self.parts, 2, 3 * len(self.forced), self.motion_unit.size, self.parts, self.parts)
        ends = np.cumsum(sizes).tolist()
        return {name: slice(end - size, end) for name, size, end in zip(BLOCKS, sizes, ends, strict=True)}

    def index(self, names: Collection[str]) -> np.ndarray:
        """Places in z of the blocks of these names, in the order of z, (k,)."""
        every = np.arange(self.size)
        return np.concatenate([every[:0], *(every[place] for name, place in self.slices.items() if name in names)])

    @property
    def force_slice(self) -> slice:
        """Where the force amplitudes lie in z."""
        return self.slices["force"]

    @property
    def modal(self) -> int:
        """Length of the leading part of z that the linear engine has derivatives for."""
        return self.slices["motion"].stop

    def young_of(self, z: np.ndarray) -> np.ndarray:
        """Young's modulus per part [Pa], (n,)."""
        return self.young * np.exp(z[: self.parts])

    def poisson_of(self, z: np.ndarray) -> np.ndarray:
        """Poisson's ratio per part, (n,)."""
        return self.poisson + POISSON_UNIT * z[self.slices["poisson"]]

    def unpack(self, z: torch.Tensor, *, modes: int) -> Unknowns:
        """The unknowns that z (size,) stands for; initial motion padded with zeros to `modes` coordinates."""
        like: dict[str, Any] = {"dtype": z.dtype, "device": z.device}
        at = {name: z[place] for name, place in self.slices.items()}
        force = torch.zeros((self.frames, 3), **like)
        if len(self.forced):
            index = torch.as_tensor(self.forced, device=z.device)
            force = force.index_copy(0, index, at["force"].reshape(-1, 3) * self.force_unit)
        motion = at["motion"].reshape(2, -1) * torch.as_tensor(self.motion_unit, **like)
        motion = torch.nn.functional.pad(motion, (0, modes - motion.shape[1]))
        return Unknowns(
            young=torch.as_tensor(self.young, **like) * torch.exp(at["young"]),
            damping=Damping(
                self.damping.mass_per_s + self.damping_unit.mass_per_s * at["damping"][0],
                self.damping.stiffness_s + self.damping_unit.stiffness_s * at["damping"][1],
            ),
            force=force,
            initial_displacement=motion[0],
            initial_velocity=motion[1],
            density=None if "density" in self.held else torch.as_tensor(self.density, **like) * torch.exp(at["density"]),
            poisson=None if "poisson" in self.held else torch.as_tensor(self.poisson, **like) + POISSON_UNIT * at["poisson"],
        )

    def scale(self) -> np.ndarray:
        """d(unknown)/dz at the start in the order of z up to `modal`: log E [1], alpha [1/s], beta [s], force [N/m^3], motion."""
        return np.concatenate(
            [
                np.ones(self.parts),
                [self.damping_unit.mass_per_s, self.damping_unit.stiffness_s],
                np.full(3 * len(self.forced), self.force_unit),
                self.motion_unit.ravel(),
            ]
        )
