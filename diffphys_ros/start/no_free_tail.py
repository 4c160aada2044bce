"""Start values where no free tail tells the stiffness: force and Young's moduli together, on the linear modal motion.

Joint from the first iteration (a force fitted first would explain the motion at any stiffness), with a penalty on the force that
is sparse in time and fades, then the frames that carry a force are kept and everything is fitted again on those alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..config import Settings
from ..footprints import Footprint
from ..linear_systems import solved
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from .force import AXES

ITERATIONS = 130
FIRST_SPARSITY, LAST_SPARSITY, FADING = 3.0, 0.1, 0.965  # weight of the sparse penalty: first, least, factor per iteration
ROUNDING = 0.02  # of its corner, in units of the accelerations seen
RATE_YOUNG, RATE_DAMPING, RATE_FORCE = 0.1, 0.02, 0.05  # Adam steps of log E, of the dampings and of the force, in their units
MOMENTS = (0.9, 0.99)
ACTIVE = 0.15  # share of the largest force above which a frame counts as forced
BRIDGED = 2  # frames between two forced ones that are taken as forced
REFIT, REFIT_MAGNITUDE, REFIT_SMOOTH = 12, 0.01, 0.03  # iterations and penalties of the second fit
STARTS = (0.3, 1.0, 3.0)  # factors on the guess
AGREEMENT = 0.05  # of log10 E between starts that still counts as one answer
LEAST_FREE = 8  # frames without a force below which the answer is the penalty's, not the clip's
LOG_YOUNG = 2e-3  # misfit that one standard deviation of a believed log E is worth
DAMPING_UNITS = (0.5, 5e-4)  # alpha [1/s], beta [s]


@dataclass(frozen=True)
class _Problem:
    """Tracks compressed to modal coordinates: misfit = q G q - 2 b q + c, over the mean squared motion."""

    modal: ModalModel
    gram: np.ndarray  # (T, r, r)
    moment: np.ndarray  # (T, r)
    constant: float
    footprint: np.ndarray  # (r, 3)
    force_unit: float  # [N/m^3]
    period_s: float
    young: np.ndarray  # guess [Pa], (n,)
    tightness: np.ndarray  # weight of log E / guess, squared, in the cost, (n,)

    @property
    def frames(self) -> int:
        return len(self.gram)

    def motion(self, z: np.ndarray) -> dict[str, Any]:
        """Arguments of the modal response at unknowns z: log E / guess, dampings, force of all frames."""
        n = len(self.young)
        return {
            "young": self.young * np.exp(z[:n]),
            "mass_damping": z[n] * DAMPING_UNITS[0],
            "stiffness_damping": z[n + 1] * DAMPING_UNITS[1],
            "force": z[n + 2 :].reshape(-1, 3) * self.force_unit,
        }

    def misfit(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Mean squared misfit over the mean squared motion, its gradient and Gauss-Newton Hessian."""
        motion = self.motion(z)
        young, force = motion.pop("young"), motion["force"]
        load = force @ self.footprint.T
        damping = {k: motion[k] for k in ("mass_damping", "stiffness_damping")}
        q = self.modal.respond(young, load=load, period_s=self.period_s, **damping)
        jacobian = self.modal.jacobian(young, footprint=self.footprint, frames=np.arange(self.frames), period_s=self.period_s, **motion)
        n = len(self.young)
        jacobian = jacobian * np.r_[np.ones(n), DAMPING_UNITS, np.full(3 * self.frames, self.force_unit)]
        pulled = np.einsum("tab,tb->ta", self.gram, q)
        value = float((q * (pulled - 2 * self.moment)).sum() + self.constant)
        gradient = 2 * np.einsum("ta,tas->s", pulled - self.moment, jacobian)
        hessian = 2 * np.einsum("tas,tab,tbr->sr", jacobian, self.gram, jacobian, optimize=True)
        return value, gradient, hessian


def joint_wanted(start: StartValues, settings: Settings) -> bool:
    """Whether force and stiffness are to be found together: where that is asked for, or no free tail tells the stiffness."""
    schedule = settings.experiment.schedule
    return schedule == "joint" or (schedule == "auto" and not start.has_free_tail)


def joint_values(body: Body, tracks: Tracks, period_s: float, start: StartValues, modal: ModalModel, *, camera: Camera, believed: bool = False) -> StartValues:
    """`start` with moduli, damping, forced frames and force found jointly; its moduli are the guess, held to within their
    standard deviations where they are `believed`."""
    sd = start.log10_young_sd if believed and not start.has_free_tail else np.full(len(start.young), np.inf)
    problem = _problem(body, tracks, period_s, start, modal, camera, sd)
    found = [_fit(problem, factor) for factor in STARTS]
    cost, z, forced = min(found, key=lambda f: f[0])
    n = len(start.young)
    logs = np.array([f[1][:n] for f in found if f[0] < 1.5 * cost + 1e-6])
    spread = (np.ptp(logs, axis=0) if len(logs) > 1 else np.full(n, np.log(3.0))) / np.log(10)
    free = int((~forced).sum())
    told = (spread < AGREEMENT) & (free >= LEAST_FREE)
    reason = (
        f"no free tail; joint fit of stiffness and force with {free} force-free frames (needs {LEAST_FREE}), "
        f"starts agree within {{:.2f}} in log10 E (needs {AGREEMENT:g})."
    )
    motion = problem.motion(z)
    return replace(
        start,
        young=motion["young"],
        log10_young_sd=np.minimum(np.maximum(spread, 0.1), sd),
        mass_damping=float(motion["mass_damping"]),
        stiffness_damping=max(float(motion["stiffness_damping"]), 0.0),  # a negative one makes fast modes grow that the tracks hardly show
        forced=forced,
        footprint=Footprint(),
        force=np.where(forced[:, None], motion["force"], 0.0),
        frequencies_hz=modal.frequencies(motion["young"]),
        track_cost=problem.misfit(z)[0],
        identified=told,
        reasons=tuple(reason.format(s) for s in spread),
    )


def _problem(body: Body, tracks: Tracks, period_s: float, start: StartValues, modal: ModalModel, camera: Camera, sd: np.ndarray) -> _Problem:
    points = body.to_body(tracks.points)
    moved, basis = points - points[:1], modal.evaluate(points[0])[0]
    if not tracks.has_depth:
        rays = points[0] - body.to_body(camera.position)
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        moved = moved - rays * np.einsum("mc,tmc->tm", rays, moved)[..., None]
        basis = basis - np.einsum("mc,mr->mcr", rays, np.einsum("mc,mcr->mr", rays, basis))
    moved = np.where(tracks.valid[..., None], moved, 0.0)
    scale = float((moved**2).sum()) or 1.0  # nothing moves at all: then nothing is told
    gram = np.einsum("tm,mca,mcb->tab", tracks.valid.astype(float), basis, basis, optimize=True) / scale
    second = np.diff(moved, 2, axis=0) / period_s**2
    acceleration = float(np.sqrt(np.median((second**2).sum(-1).mean(1))))
    unit = max(acceleration, 1e-9) * float(body.density.mean())
    return _Problem(modal, gram, np.einsum("tmc,mcr->tr", moved, basis) / scale, 1.0, modal.footprint_load(), unit, period_s, start.young, LOG_YOUNG / (np.log(10) * sd) ** 2)


def _fit(problem: _Problem, factor: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, unknowns and forced frames from moduli `factor` times the guess."""
    n = len(problem.young)
    z = np.zeros(n + 2 + 3 * problem.frames)
    z[:n], z[n + 1] = np.log(factor), 1.0
    z = _sparse(problem, z)
    forced = active_frames(np.linalg.norm(z[n + 2 :].reshape(-1, 3), axis=1))
    return *_refit(problem, z, forced), forced


def _sparse(problem: _Problem, z: np.ndarray) -> np.ndarray:
    """Adam on the misfit and the fading sparse penalty."""
    n = len(problem.young)
    rate = np.r_[np.full(n, RATE_YOUNG), RATE_DAMPING, RATE_DAMPING, np.full(3 * problem.frames, RATE_FORCE)]
    first, second = np.zeros_like(z), np.zeros_like(z)
    for k in range(ITERATIONS):
        gradient = problem.misfit(z)[1]
        gradient[:n] += 2 * problem.tightness * z[:n]
        force = z[n + 2 :].reshape(-1, 3)
        weight = max(LAST_SPARSITY, FIRST_SPARSITY * FADING**k) / problem.frames
        # what a large swing takes off the length looks like a huge force along it
        size = np.sqrt(((force * AXES) ** 2).sum(1, keepdims=True) + ROUNDING**2)
        gradient[n + 2 :] += (weight * AXES**2 * force / size).ravel()
        first = MOMENTS[0] * first + (1 - MOMENTS[0]) * gradient
        second = MOMENTS[1] * second + (1 - MOMENTS[1]) * gradient**2
        step = first / (1 - MOMENTS[0] ** (k + 1)) / (np.sqrt(second / (1 - MOMENTS[1] ** (k + 1))) + 1e-12)
        z = z - rate * min(1.0, 2 * (1 - k / ITERATIONS)) * step
    return z


def active_frames(force: np.ndarray) -> np.ndarray:
    """Frames (T,) bool with a force of more than ACTIVE of the largest, one more on either side, short gaps bridged."""
    strong = force > ACTIVE * max(force.max(), 1e-12)
    strong = strong | np.r_[strong[1:], False] | np.r_[False, strong[:-1]]
    index = np.flatnonzero(strong)
    for a, b in pairwise(index):
        if b - a - 1 <= BRIDGED:
            strong[a:b] = True
    return strong


def _refit(problem: _Problem, z: np.ndarray, forced: np.ndarray) -> tuple[float, np.ndarray]:
    """Levenberg-Marquardt on the forced frames alone, with a magnitude and a smoothness penalty."""
    n = len(problem.young)
    kept = np.r_[np.ones(n + 2, bool), np.repeat(forced, 3)]
    z = np.where(kept, z, 0.0)
    difference = np.diff(np.eye(problem.frames), axis=0)
    per_frame = (REFIT_MAGNITUDE * np.eye(problem.frames) + REFIT_SMOOTH * difference.T @ difference) / problem.frames
    penalty = np.zeros((len(z), len(z)))
    penalty[n + 2 :, n + 2 :] = np.kron(per_frame, np.diag(AXES**2))
    penalty[range(n, n + 2), range(n, n + 2)] = 1e-3
    penalty[range(n), range(n)] = problem.tightness
    damping, best = 1e-3, (np.inf, z)
    for _ in range(REFIT):
        value, gradient, hessian = problem.misfit(z)
        total = value + float(z @ penalty @ z)
        if total < best[0]:
            best, damping = (total, z), damping * 0.3
        else:
            z, damping = best[1], damping * 10
            value, gradient, hessian = problem.misfit(z)
        matrix = (hessian + 2 * penalty)[np.ix_(kept, kept)]
        step = np.zeros_like(z)
        step[kept] = -solved(matrix + damping * np.diag(np.diag(matrix)), (gradient + 2 * penalty @ z)[kept])
        z = z + step * min(1.0, 0.5 / max(np.abs(step[:n]).max(), 1e-12))
    return best
