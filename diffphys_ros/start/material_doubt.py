"""What nobody told of the materials, densities and Poisson's ratios, and what it makes of Young's moduli; to first order, without what gravity does.

Other densities change the square of a mode's frequency by the part's share of its inertia, other Poisson's ratios by what they change of its
elastic energy (Rayleigh); what the tail fit then makes of E follows from how it bends. Several modes tell densities as well, so that these may be surer
than they were before anything was seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Scene
from ..differences import differences
from ..linear_systems import inverted
from ..modes.interpolation import at_quadrature, quadrature
from ..types import Body, MaterialDoubt
from .densities import told_by_motion
from .free_tail import Physics, Tail
from .uncertainty import SHAPE_SD, Bend, contradiction
from .untold import poisson_sds

ANY_DENSITY = 0.7  # of ln(density) when nothing is given: foam 30 kg/m^3, wood 600, tissue 1000, aluminium 2700 [chosen]


def material_doubt(tail: Tail, physics: Physics, bend: Bend | None, body: Body, scene: Scene, contrast: float, detune: np.ndarray, *, twists: bool = True) -> MaterialDoubt:
    """Of the parts of a body; `contrast` is the standard deviation of ln(density) of a part where none was given, and the mass of all stays as it
    is. `detune` (k,): by how much the frequencies of the modes are off; `twists`: whether the tracks show a twist. Without a tail fit (`bend` None) E of all parts goes with the lowest mode."""
    if scene.density_kg_m3 is not None and scene.poisson_ratio is not None:
        return MaterialDoubt.none(body.parts)
    if bend is None:
        densities, ratios = _before(tail, body, scene, contrast)
        by_density, by_poisson = (np.tile(-by[0], (body.parts, 1)) for by in mode_changes(tail, physics, body))
        young = by_density @ densities + by_poisson @ ratios
    else:
        densities, ratios, young = material_changes(tail, physics, bend, body, scene, contrast, detune, twists=twists)
    nothing = scene.density_kg_m3 is None and scene.mass_kg is None
    return MaterialDoubt(
        density_log_sd=np.hypot(_lengths(densities), ANY_DENSITY if nothing else 0.0),
        poisson_sd=_lengths(ratios),
        of_young=_lengths(young) / np.log(10.0),
        of_specific=_lengths(young - densities) / np.log(10.0),
    )


def material_changes(
    tail: Tail, physics: Physics, bend: Bend, body: Body, scene: Scene, contrast: float, detune: np.ndarray, *, twists: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Changes (n, m) of ln(density) and of Poisson's ratio by one standard deviation of each of what the tail leaves open, which are independent, and those
    of ln E that follow. Arguments as for material_doubt."""
    densities, ratios = _before(tail, body, scene, contrast)
    by_density, by_poisson = _misfit_by_density(tail, physics, body) @ densities, _misfit_by_poisson(tail, physics) @ ratios
    left = np.eye(len(densities.T))
    if told_by_motion(body):
        left = _left_open(tail, physics, bend, by_density + by_poisson if twists else by_density, contradiction(bend.inverse, detune))
    return densities @ left, ratios @ left, bend.young_by((by_density + by_poisson) @ left, len(physics.young))


def mode_changes(tail: Tail, physics: Physics, body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of ln(omega^2) of the modes that the tail is fitted with by ln(density) and by Poisson's ratio of each part, (k, n) each."""
    modal = tail.modal
    _, volume, _ = quadrature(modal.nodes, modal.tets)
    part = np.repeat(modal.part, 4) - 1
    shapes = modal.eigen(physics.young)[1][:, : tail.most_modes]
    value, _ = at_quadrature(modal.nodes, modal.tets, modal.basis @ shapes)
    inertia = (volume * body.density[part])[:, None] * (value**2).sum(1)
    kinetic = np.stack([np.bincount(part, mode, body.parts) for mode in inertia.T])
    squares, by_all, _ = modal.eigen_changes(physics.young, poisson=modal.poisson)
    by_poisson = (by_all[len(physics.young) :] / squares)[:, : tail.most_modes]
    return -kinetic / kinetic.sum(1, keepdims=True), by_poisson.T


def _before(tail: Tail, body: Body, scene: Scene, contrast: float) -> tuple[np.ndarray, np.ndarray]:
    """Changes (n, m) of ln(density) and of Poisson's ratio of all parts by one standard deviation of each of what is open before the tail is looked at."""
    nought = np.zeros((body.parts, body.parts))
    densities = (0.0 if scene.density_kg_m3 is not None else contrast) * _of_equal_mass(body)
    ratios = np.diag(poisson_sds(body, scene) if tail.untold.ratios is None else tail.untold.ratios.sd)
    return np.hstack([densities, nought]), np.hstack([nought, ratios])


def _of_equal_mass(body: Body) -> np.ndarray:
    """Projection (n, n) of changes of ln(density) onto those that leave the mass as it is."""
    mass = body.density * body.part_volumes_m3
    return np.eye(body.parts) - np.outer(mass, mass) / (mass @ mass)


def _misfit_by_density(tail: Tail, physics: Physics, body: Body) -> np.ndarray:
    """Derivatives (K d, n) of the tail's misfit, in standard deviations, by ln(density) of each part; without what gravity does where the model
    does not keep densities apart."""
    if len(tail.modal.density) != body.parts:
        return _misfit_by(tail, physics, mode_changes(tail, physics, body)[0])
    density = tail.modal.density
    return differences(lambda by: tail.misfit(replace(physics, density=density * np.exp(by))).ravel() / tail.sigma_m, np.zeros(body.parts))


def _misfit_by_poisson(tail: Tail, physics: Physics) -> np.ndarray:
    """The same by Poisson's ratio of each part."""
    poisson = tail.modal.poisson
    return differences(lambda by: tail.misfit(replace(physics, poisson=poisson + by)).ravel() / tail.sigma_m, np.zeros(len(poisson)))


def _misfit_by(tail: Tail, physics: Physics, change: np.ndarray) -> np.ndarray:
    """Derivatives of the tail's misfit, in standard deviations, (K d, m), by quantities that change ln(omega^2) of the modes by (k, m) each."""
    still = np.zeros(len(change))
    still[: len(physics.detune)] = physics.detune

    def misfit(by: np.ndarray) -> np.ndarray:
        return tail.misfit(replace(physics, detune=still + 0.5 * change @ by)).ravel() / tail.sigma_m

    return differences(misfit, np.zeros(change.shape[1]))


def _left_open(tail: Tail, physics: Physics, bend: Bend, slope: np.ndarray, contradicted: float) -> np.ndarray:
    """Square root (m, m) of the covariance of unknowns with a unit normal prior, whose derivatives of the misfit are (K d, m), where all that the
    tail is fitted with is free as well and the shape of each mode is known to SHAPE_SD only, which is the same error in all frames. Frequencies that are off by
    `contradicted` times what is allowed for may be off by as much more, and tell densities the less."""
    swings = tail.swings(physics) * SHAPE_SD / tail.sigma_m
    square, turn = np.linalg.eigh(np.eye(len(swings)) * tail.excess(physics) ** 2 + swings @ swings.T)
    slope, jacobian = ((turn / np.sqrt(square)).T @ each.reshape(len(swings), -1) for each in (slope, bend.jacobian))
    slope, jacobian = slope.reshape(len(tail.data) * tail.data.shape[1], -1), jacobian.reshape(len(bend.jacobian), -1)
    shared, prior = jacobian.T @ slope, bend.prior.copy()
    prior[len(prior) - len(physics.detune) :] /= contradicted
    told = slope.T @ slope - shared.T @ inverted(jacobian.T @ jacobian + prior.T @ prior) @ shared
    return np.linalg.cholesky(np.linalg.inv(np.eye(len(told)) + 0.5 * (told + told.T)))


def _lengths(changes: np.ndarray) -> np.ndarray:
    """Root sum of squares (n,) over independent causes (n, m)."""
    return np.linalg.norm(changes, axis=1)
