"""How far Young's moduli may be off: what the fit leaves open, errors common to all points of a frame, and the geometry.

Independent track noise is irrelevant beside these three, so a standard deviation from it alone would be far too small.
"""

from __future__ import annotations

import numpy as np

from ..elements.mesh import narrowest_limb
from ..linear_systems import inverted
from ..modes.interpolation import quadrature
from ..types import Body, Tracks
from .free_tail import FREQUENCY_SD, Physics, Tail, differences, prior_residual

SILHOUETTE_PX = 0.5  # standard deviation of the outline's position
OPEN_SD = 2.6  # of log10 E where nothing is known: solids lie anywhere between 1e3 and 1e12 Pa
DENSITY_CONTRAST = 0.15  # standard deviation of ln(density) of a part when only the mass of all is given


def log10_young_sd(tail: Tail, physics: Physics, geometry_sd: np.ndarray) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,): Gauss-Newton covariance of the tail fit (coherent error in every frame,
    model error in every mode's frequency, priors), and that of the geometry (see `geometry_log10_sd`); OPEN_SD where a tail
    that the modes do not explain leaves more open than that."""
    vector, parts = physics.vector(), len(physics.young)
    jacobian = differences(lambda v: tail.misfit(Physics.of(v, parts)).ravel(), vector) / tail.sigma_m
    prior = differences(lambda v: prior_residual(v, parts), vector)
    inverse = inverted(jacobian.T @ jacobian + prior.T @ prior)
    excess = max(float(np.sqrt((tail.misfit(physics) ** 2).sum(1).mean())) / tail.sigma_m, 1.0)
    covariance = inverse @ (jacobian.T @ jacobian * excess**2 + prior.T @ prior) @ inverse
    fit_sd = np.sqrt(np.diag(covariance)[:parts]) / np.log(10.0)
    return np.minimum(np.hypot(fit_sd, geometry_sd), OPEN_SD)


def geometry_log10_sd(tail: Tail, body: Body, tracks: Tracks, *, density_known: bool) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,), however well the motion is explained: half a pixel of the silhouette, and the
    densities of parts of which only the common mass is known."""
    density = 0.0 if density_known or body.parts == 1 else _density(tail, body)
    return np.hypot(outline_sd(body, tracks), density) / np.log(10.0)


def detuning_log10_sd(detuning: float) -> float:
    """Standard deviation of log10 E where a mode's log frequency is off by `detuning`: what made that, beyond the errors that are allowed
    for, may as well be off in all frequencies alike, where E takes it on with its square."""
    return 2 * float(np.sqrt(max(detuning**2 - FREQUENCY_SD**2, 0.0))) / np.log(10.0)


def outline_sd(body: Body, tracks: Tracks) -> np.ndarray:
    """Standard deviation of ln E per part from the outline: bending goes with the square of a limb's width and the fourth
    power of the length."""
    blur = SILHOUETTE_PX * metres_per_pixel(tracks)
    length = np.ptp(np.flatnonzero(body.inside.any(1))) * body.pitch_m
    widths = [narrowest_limb(body.inside & (body.part == i + 1)) * body.pitch_m for i in range(body.parts)]
    return np.hypot(2 * blur / np.maximum(widths, body.pitch_m), 4 * blur / length)


def _density(tail: Tail, body: Body) -> float:
    """Standard deviation of ln E, common to all parts, from densities that only share a known mass: E goes with the inertia of
    the leading mode, in which the parts do not share as in the mass."""
    points, volume, _ = quadrature(tail.modal.nodes, tail.modal.tets)
    mass = volume * body.density[np.repeat(tail.modal.part, 4) - 1]
    inertia = mass * (tail.modal.evaluate(points)[0][..., tail.leading_mode(tail.modal.reference)] ** 2).sum(1)
    shares = [np.bincount(np.repeat(tail.modal.part, 4) - 1, w, body.parts) / w.sum() for w in (inertia, mass)]
    along = shares[1] / np.linalg.norm(shares[1])
    return DENSITY_CONTRAST * float(np.linalg.norm(shares[0] - (shares[0] @ along) * along))


def metres_per_pixel(tracks: Tracks) -> float:
    """Size of a pixel on the object [m], from the spread of the tracks in frame 0."""
    spread = [np.linalg.norm(p - p.mean(0), axis=1) for p in (tracks.points[0], tracks.pixels[0])]
    return float(np.median(spread[0]) / np.median(spread[1]))
