"""The loss of the inverse problem (paper Eq. 10, A.12): tracks + images + depth + priors, with its exact gradient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch

from ..config import Fit
from ..errors import SimulationError
from ..fields import Layout
from ..modes.force import AXIAL_SHARE
from ..particles import Binding, bind
from ..types import StartValues
from .forward import ForwardModel, Motion
from .images import ImageTerm
from .observations import TrackTarget


@dataclass(frozen=True)
class Prior:
    """Quadratic priors on z, each the half inverse variance in units of the loss; weak where the data speak.

    That of the force is the paper's smoothness (A.14), from and to no force where it begins and ends; tighter along the body, where a force
    moves hardly anything.
    """

    hessian: np.ndarray  # (size, size)
    centre: np.ndarray  # (size,)

    LOG_YOUNG = 2e-3  # log E one standard deviation of the start values away costs half of this: what the grid's own error
    # leaves as misfit, so that the fit does not pay with E for what the grid cannot follow
    MISSED = 0.3  # standard deviation of log10 E that the start values' linear motion leaves open, as a multiple of the share of the motion
    # that it misses: modes that do not follow the swing do not have its frequency either
    DAMPING = 2e-3  # likewise of one unit of alpha or beta: where one mode is seen the two can hardly be told apart
    SMOOTH = 3e-4

    @classmethod
    def of(cls, layout: Layout, start: StartValues, *, start_scale: float, precision: np.ndarray | None = None) -> Prior:
        """Priors about the start values (log E, damping) and about zero (changes of the force). The search may begin
        `start_scale` times off the start values; the prior stays where they are. `precision` (n, n) is the inverse covariance of
        log E where more is known than the standard deviations."""
        n = layout.parts
        hessian, centre = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        sd = np.hypot(start.log10_young_sd, cls.MISSED * np.sqrt(start.track_cost))
        known = np.diag((np.log(10) * sd) ** -2.0) if precision is None else precision
        hessian[:n, :n] = cls.LOG_YOUNG * known
        centre[:n] = -np.log(start_scale)
        hessian[range(n, n + 2), range(n, n + 2)] = cls.DAMPING
        difference = _changes(layout.forced, layout.frames)
        per_frame = cls.SMOOTH * difference.T @ difference
        stiffer_along = np.diag([AXIAL_SHARE**-2, 1.0, 1.0])
        hessian[layout.force_slice, layout.force_slice] = np.kron(per_frame, stiffer_along)
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


@dataclass
class Terms:
    """The loss at one z, term by term."""

    z: torch.Tensor
    motion: Motion | None
    total: torch.Tensor
    parts: dict[str, float] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """The loss; infinite where the simulation left its bounds."""
        return float(self.total.detach())

    def gradient(self) -> np.ndarray:
        """d(loss)/dz, (size,), by replaying the simulation backwards."""
        (gradient,) = torch.autograd.grad(self.total, self.z)
        return gradient.double().cpu().numpy()


class Objective:
    """z -> Terms."""

    def __init__(self, forward: ForwardModel, target: TrackTarget, images: ImageTerm | None, prior: Prior, weights: Fit):
        self.forward, self.target, self.images, self.prior, self.weights = forward, target, images, prior, weights
        self.binding: Binding = bind(target.rest_points, forward.disc.particles.x_rest)
        self.failures: list[str] = []  # what the simulation said where a step went too far
        self.watch: Callable[[float], None] | None = None  # hears the share of a simulation that is done; may end it by an exception

    def __call__(self, z: np.ndarray) -> Terms:
        leaf = torch.as_tensor(z, dtype=torch.float64).requires_grad_(True)
        try:
            motion = self.forward(leaf.to(self.forward.device, self.forward.dtype), report=self.watch)
        except SimulationError as error:
            self.failures.append(str(error))
            return Terms(leaf, None, torch.tensor(float("inf")))
        return self.terms(leaf, motion)

    def terms(self, leaf: torch.Tensor, motion: Motion) -> Terms:
        """The loss of a motion and of the unknowns z (size,) that it belongs to."""
        weighted = self.evidence(motion.x, motion.F) | {"prior": self.prior.value(leaf)}
        return Terms(leaf, motion, _sum(weighted), {name: float(v.detach()) for name, v in weighted.items()})

    def evidence(self, x: torch.Tensor, F: torch.Tensor) -> dict[str, torch.Tensor]:
        """Weighted misfits of particles x (T, P, 3) [m], F (T, P, 3, 3) since frame 0, body frame, whatever moved them: tracks, images, depth."""
        w = self.weights
        weighted = {"track": w.track_weight * self.target.loss(self.binding.apply(x - x[:1])).double()}
        if self.images is not None:
            image, depth = self.images(x, F, self.target.mean_square)
            weighted |= {"image": w.image_weight * image.double(), "depth": w.depth_weight * depth.double()}
        return weighted

    def misfit(self, x: torch.Tensor, F: torch.Tensor) -> float:
        """How badly a motion (see `evidence`) explains the clip; that of a better explanation is lower."""
        with torch.no_grad():
            return float(_sum(self.evidence(x, F)))

    def track_loss(self, x: torch.Tensor) -> float:
        """TrackTarget.loss of particles x (T, P, 3) [m], whatever tracks weigh."""
        return float(self.target.loss(self.binding.apply((x - x[:1]).detach())))

    def track_rms(self, x: torch.Tensor) -> float:
        """Misfit of one track coordinate [m] of particles x (T, P, 3) [m]."""
        return self.target.rms(self.binding.apply((x - x[:1]).detach()))


def _sum(weighted: dict[str, torch.Tensor]) -> torch.Tensor:
    return sum((v.cpu() for v in weighted.values()), torch.zeros((), dtype=torch.float64))
