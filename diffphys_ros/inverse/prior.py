"""What is believed of the unknowns before they are fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ..start.along import costs_of
from ..types import StartValues
from .unknowns import Layout


@dataclass(frozen=True)
class Prior:
    """Quadratic priors on z, each the half inverse variance in units of the loss; weak where the data speak.

    That of the force is the paper's smoothness (A.14), from and to no force where it begins and ends; tighter in stiff ways, where a force
    moves hardly anything, and there about what the start values have: a simulation tells no more of it than modes do.
    """

    hessian: np.ndarray  # (size, size)
    centre: np.ndarray  # (size,)

    LOG_YOUNG = 2e-3  # log E one standard deviation of the start values away costs half of this: what the grid's own error
    # leaves as misfit, so that the fit does not pay with E for what the grid cannot follow
    MISSED = 0.3  # standard deviation of log10 E that the start values' linear motion leaves open, as a multiple of the share of the motion
    # that it misses: modes that do not follow the swing do not have its frequency either
    DENSITY = 2e-3 / 0.15**2  # of log density: the parts of one object differ by 15 % or so (one standard deviation, in the unit of LOG_YOUNG)
    POISSON = 2e-3  # of one unit of Poisson's ratio
    DAMPING = 2e-3  # likewise of one unit of alpha or beta: where one mode is seen the two can hardly be told apart
    SMOOTH = 1e-4  # where tracks are followed: three times as much flattens gusts, a third as much lets noise be force
    UNTRACKED = 3.0  # times that where pictures and depth alone tell the motion, whose noise is more

    @classmethod
    def of(cls, layout: Layout, start: StartValues, *, start_scale: float, ways: np.ndarray, precision: np.ndarray | None = None, tracked: bool = True) -> Prior:
        """Priors about the start values (log E, damping, the force in stiff ways) and about zero (changes of the force across them). The search may begin
        `start_scale` times off the start values; the prior stays where they are. `ways` (h, 3) are the
        stiff ones (start/along.py). `precision` (n, n) is the inverse covariance of
        log E where more is known than the standard deviations. `tracked`: whether tracks are evidence."""
        n = layout.parts
        hessian, centre = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        of_these = start.material.taken_from(start.log10_young_sd)  # densities and Poisson's ratios, which are held or have priors of their own
        sd = np.hypot(of_these, cls.MISSED * np.sqrt(start.track_cost))
        known = np.diag((np.log(10) * sd) ** -2.0) if precision is None else precision
        hessian[:n, :n] = cls.LOG_YOUNG * known
        centre[:n] = -np.log(start_scale)
        hessian[range(n, n + 2), range(n, n + 2)] = cls.DAMPING
        difference = _changes(layout.forced, layout.frames)
        per_frame = cls.SMOOTH * (1.0 if tracked else cls.UNTRACKED) * difference.T @ difference
        cost = costs_of(ways)
        hessian[layout.force_slice, layout.force_slice] = np.kron(per_frame, cost @ cost)
        centre[layout.force_slice] = (start.force[layout.forced] @ ways.T @ ways / layout.force_unit).ravel()
        at = layout.slices
        hessian[at["density"], at["density"]] = cls.DENSITY * np.eye(n)
        hessian[at["poisson"], at["poisson"]] = cls.POISSON * np.eye(n)
        return cls(hessian, centre)

    def value(self, z: torch.Tensor) -> torch.Tensor:
        """The prior's share of the loss."""
        offset = z.double() - torch.as_tensor(self.centre)
        return 0.5 * offset @ torch.as_tensor(self.hessian) @ offset


def _changes(forced: np.ndarray, frames: int) -> np.ndarray:
    """Rows (R, F) that take the change of the force from frame to frame, from and to none where it begins and ends; forced (F,)."""
    every = np.zeros((frames, len(forced)))
    every[forced, range(len(forced))] = 1.0
    change = np.diff(every, axis=0)
    return change[change.any(1)]
