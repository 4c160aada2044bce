"""How far Young's moduli may be off: what the fit leaves open, errors common to all points of a frame, and the geometry.

Independent track noise is irrelevant beside these three, so a standard deviation from it alone would be far too small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..differences import differences
from ..elements.mesh import narrowest_limb
from ..linear_systems import inverted
from ..types import Body, Tracks
from .free_tail import DETUNED, FREQUENCY_SD, Physics, Tail, prior_residual

HELD_SD = 0.01  # of a mode's log frequency where modes are held to the model: a width, a thickness and a density alone make it [chosen]
SHAPE_SD = 0.02  # of a mode's shape, root mean square over its own: outline, thickness and parts make one error of it [chosen]
SMOOTH = 6  # directions, at most, that such an error of held modes is spread over: it is smooth along the body, and strains the parts as stiffness would [chosen]
UNSEEN_SD = 0.005  # of a mode's shape, root mean square over its own, where the fit misses nothing: stiffness takes on most of such an error [docs/measurements/choices.md]
LEADING = 8  # modes along whose shapes an error of a shape lies: 6 to 12 are as likely of 92 outer parts [docs/measurements/choices.md]
SILHOUETTE_PX = 0.1  # standard deviation of the outline's position: with half a pixel 38 of 46 told parts of the choice seeds lay inside the 50 % interval [docs/measurements/choices.md]
OPEN_SD = 2.6  # of log10 E where nothing is known: solids lie anywhere between 1e3 and 1e12 Pa [derived: standard deviation of an even spread]


def log10_young_sd(tail: Tail, physics: Physics, bend: Bend, geometry_sd: np.ndarray, detune: np.ndarray) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,): covariance of the tail fit (noise of each frame, in every direction as large as what is missed there out
    of step with the modes, for what is missed in step is of_shapes, or, where modes are held to the model, as all that is missed; model error in every mode's
    frequency; priors), widened where the frequencies, off by `detune` (k,), fit each other worse than is allowed for, and that of outline and densities;
    OPEN_SD where a tail that the modes do not explain leaves more open than that."""
    fit_sd = contradiction(bend.inverse, detune) * np.sqrt(_fit_variance(tail, physics, bend)) / np.log(10.0)
    return np.minimum(np.hypot(fit_sd, geometry_sd), OPEN_SD)


def spread_over_curvature(tail: Tail, physics: Physics) -> np.ndarray:
    """Standard deviation of log E per part by noise of the frames, priors and shapes of the modes, over the one that the curvature of the misfit alone
    would make it, (n,): what a misfit that rises by one standard deviation squared is worth. Without the prior that ties a part to its neighbours where
    that is more: with it this is 1 where the tail tells next to nothing of the part, however much is missed. The whole excess where modes are held to the
    model."""
    parts = len(physics.young)
    if not tail.detuned:
        return np.full(parts, tail.excess(physics))
    bend = Bend.of(tail, physics)
    return np.maximum(_worth(tail, physics, bend), [_worth(tail, physics, bend.untied(part))[part] for part in range(parts)])


def _worth(tail: Tail, physics: Physics, bend: Bend) -> np.ndarray:
    """The same under one set of priors."""
    variance = _fit_variance(tail, physics, bend) + (np.log(10.0) * of_shapes(tail, physics, bend)) ** 2
    return np.asarray(np.sqrt(variance / np.diag(bend.inverse)[: len(physics.young)]))


def _fit_variance(tail: Tail, physics: Physics, bend: Bend) -> np.ndarray:
    """Variance of log E per part, (n,), by noise of the frames and priors."""
    width = tail.data.shape[1]
    noise = tail.noise(physics) if tail.detuned else tail.excess(physics) ** 2 * np.eye(width)
    noisy = (np.linalg.cholesky(noise).T @ bend.jacobian.reshape(-1, width, len(bend.inverse))).reshape(bend.jacobian.shape)
    covariance = bend.inverse @ (noisy.T @ noisy + bend.prior.T @ bend.prior) @ bend.inverse
    variance = np.diag(covariance)[: len(physics.young)]
    return np.where(variance < 0, np.inf, variance)  # by rounding, where next to nothing is told


def contradiction(covariance: np.ndarray, detune: np.ndarray) -> float:
    """By how much frequencies that are off by `detune` (k,) contradict each other, over what is allowed for; at least 1. `covariance` (S, S) is that of
    Physics.vector()."""
    return inconsistency(detune / FREQUENCY_SD, np.diag(covariance)[len(covariance) - len(detune) :])


def inconsistency(detune: np.ndarray, variance: np.ndarray) -> float:
    """By how much the log frequencies are off, over the standard deviation that is allowed for; at least 1. `detune` (k,) and its posterior variance
    (k,) are in units of the prior's, of which this is one step of expectation maximisation. Where what is fitted contradicts itself, all that
    follows from it is as much less sure (Birge 1932)."""
    return float(np.sqrt(max((detune**2 + variance).mean(), 1.0))) if len(detune) else 1.0


@dataclass(frozen=True)
class Bend:
    """How the tail fit bends at its minimum, in standard deviations."""

    jacobian: np.ndarray  # of the misfit by Physics.vector(), (K d, n + 2 + k)
    prior: np.ndarray  # of the priors' residuals
    inverse: np.ndarray  # of the Gauss-Newton matrix of both

    @classmethod
    def of(cls, tail: Tail, physics: Physics) -> Bend:
        parts = len(physics.young)
        return cls.under(tail.slope(physics), prior_residual(np.eye(len(physics.vector())), parts))

    @classmethod
    def under(cls, jacobian: np.ndarray, prior: np.ndarray) -> Bend:
        """Of residuals with these derivatives."""
        return cls(jacobian, prior, inverted(jacobian.T @ jacobian + prior.T @ prior))

    def untied(self, part: int) -> Bend:
        """The same without the prior that ties a part to its neighbours."""
        return Bend.under(self.jacobian, self.prior[self.prior[:, part] == 0])

    def young_by(self, misfits: np.ndarray, parts: int) -> np.ndarray:
        """What ln E per part takes on, (parts, ...), of changes of the misfit (K d, ...) in standard deviations."""
        return np.asarray(-(self.inverse @ (self.jacobian.T @ misfits))[:parts])


def detuning_log10_sd(detuning: float) -> float:
    """Standard deviation of log10 E where a mode's log frequency is off by `detuning`: what made that, beyond the errors that are allowed
    for, may as well be off in all frequencies alike, where E takes it on with its square."""
    return 2 * float(np.sqrt(max(detuning**2 - FREQUENCY_SD**2, 0.0))) / np.log(10.0)


def of_held_modes(tail: Tail, physics: Physics, bend: Bend) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,), by what a search that holds the modes to the model leaves no room for, though it is the same in all
    frames: frequencies, each off by HELD_SD, and shapes, off by what they miss of the motion, or by SHAPE_SD."""
    count = DETUNED - tail.detuned
    frequencies = differences(lambda off: tail.misfit(replace(physics, detune=HELD_SD * off)).ravel() / tail.sigma_m, np.zeros(count))
    missed = max(SHAPE_SD, tail.missed_m(physics) / tail.size_m) / np.sqrt(min(tail.data.shape[1], SMOOTH))
    return np.hypot(_taken_on(bend, frequencies, len(physics.young)), _by_shapes(tail, physics, bend, missed * np.eye(tail.data.shape[1])))


def of_shapes(tail: Tail, physics: Physics, bend: Bend) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,), by shapes of the modes that are off along the leading ones, each by what the fit misses there in time
    with the modes and by UNSEEN_SD: the same error in all frames, which many frames do not average out."""
    directions = tail.smooth(physics, LEADING)
    missed = np.sqrt(((tail.in_step(physics) @ directions) ** 2).mean(0)) / tail.size_m
    return _by_shapes(tail, physics, bend, directions * np.hypot(missed, UNSEEN_SD / np.sqrt(len(missed))))


def _by_shapes(tail: Tail, physics: Physics, bend: Bend, off: np.ndarray) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,), by shapes of each mode that are off by independent errors (d, m), as shares of their size."""
    return _taken_on(bend, np.kron(tail.swings(physics), off) / tail.sigma_m, len(physics.young))


def _taken_on(bend: Bend, misfits: np.ndarray, parts: int) -> np.ndarray:
    """What log10 E per part takes on, (n,), of independent misfits (K d, m) in standard deviations."""
    return np.asarray(np.linalg.norm(bend.young_by(misfits, parts), axis=1) / np.log(10.0))


def outline_sd(body: Body, tracks: Tracks) -> np.ndarray:
    """Standard deviation of ln E per part from the outline: bending goes with the square of a limb's width and the fourth
    power of the length."""
    blur = SILHOUETTE_PX * metres_per_pixel(tracks)
    length = np.ptp(np.flatnonzero(body.inside.any(1))) * body.pitch_m
    widths = [narrowest_limb(body.inside & (body.part == i + 1)) * body.pitch_m for i in range(body.parts)]
    return np.hypot(2 * blur / np.maximum(widths, body.pitch_m), 4 * blur / length)


def metres_per_pixel(tracks: Tracks) -> float:
    """Size of a pixel on the object [m], from the spread of the tracks in frame 0."""
    spread = [np.linalg.norm(p - p.mean(0), axis=1) for p in (tracks.points[0], tracks.pixels[0])]
    return float(np.median(spread[0]) / np.median(spread[1]))
