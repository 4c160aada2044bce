"""What is believed of the material, brought onto the body's parts and particles (paper section 3.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..config import Scene
from ..types import Body, Camera, MaterialPrior

BELIEVED = "material by"  # how the line about a prior begins
LEAST_SHARE = 0.015  # of the body that a part must hold


@dataclass(frozen=True)
class Belief:
    """Young's modulus per part before any motion is looked at."""

    young: np.ndarray  # [Pa], (n,)
    log10_young_sd: np.ndarray  # (n,)


def parted(body: Body, prior: MaterialPrior, camera: Camera) -> Body:
    """The body with the prior's materials for parts, where no parts were seen; 1 at the clamp, without one the largest first."""
    if body.parts > 1:
        return body
    front, index = body.front, _materials(prior, body, camera)
    share = np.bincount(index, front.volume, len(prior.name)) / front.volume.sum()
    kept = sorted(np.flatnonzero(share > LEAST_SHARE), key=lambda k: front.points[index == k, 0].min() if body.clamped else -share[k])
    if len(kept) < 2:
        return body
    number = np.zeros(len(prior.name), int)
    number[kept] = np.arange(len(kept)) + 1
    density, poisson = (np.repeat(value, len(kept)) for value in (body.density, body.poisson))
    return replace(body.with_parts(number[index], density, poisson), sources=body.sources | {"parts": prior.source})


def of_parts(prior: MaterialPrior, body: Body, camera: Camera) -> Belief:
    """Mean of log E over each part's volume, (n,) each; the spread is that of the materials and that between them."""
    share = _shares(prior, body, camera)
    log_young = np.log10(prior.young)
    mean = share @ log_young
    between = share @ log_young**2 - mean**2
    return Belief(10**mean, np.sqrt(share @ prior.log10_young_sd**2 + np.maximum(between, 0.0)))


def believed(body: Body, prior: MaterialPrior, camera: Camera, scene: Scene) -> Body:
    """The body with the prior's density and Poisson's ratio, volume means per part, where a person gave none."""
    from ..body.slab import part_densities

    share, sources = _shares(prior, body, camera), dict(body.sources)
    density, poisson = body.density, body.poisson
    if scene.density_kg_m3 is None:
        density, source = part_densities(replace(scene, density_kg_m3=list(share @ prior.density)), body.part_volumes_m3)
        sources["density"] = source.replace("density_kg_m3", prior.source, 1)
    if scene.poisson_ratio is None:
        poisson, sources["poisson_ratio"] = share @ prior.poisson, prior.source
    return replace(body, density=density, poisson=poisson, sources=sources)


def on_points(prior: MaterialPrior, body: Body, camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The prior's Young's modulus [Pa] and Poisson's ratio, (P,) each, at body points (P, 3) [m]: targets of the field's pretraining."""
    index = prior.at(camera, body.to_world(points))
    return prior.young[index], prior.poisson[index]


def _shares(prior: MaterialPrior, body: Body, camera: Camera) -> np.ndarray:
    """Share of each part's volume that each material has, (n, K); of the whole body's for a part without volume."""
    front, index = body.front, _materials(prior, body, camera)
    volumes = np.zeros((body.parts, len(prior.name)))
    np.add.at(volumes, (front.part - 1, index), front.volume)
    volumes = np.where(volumes.sum(1, keepdims=True) > 0, volumes, volumes.sum(0))
    return volumes / volumes.sum(1, keepdims=True)


def _materials(prior: MaterialPrior, body: Body, camera: Camera) -> np.ndarray:
    """The material that each piece of the body's front is seen in, (C,)."""
    return prior.at(camera, body.to_world(body.front.points))


def describe_prior(prior: MaterialPrior) -> str:
    """The material prior in a line for people."""
    values = zip(prior.name, prior.young, prior.poisson, prior.density, strict=True)
    return f"{BELIEVED} {prior.source}: " + "; ".join(f"{name}, E {e:.3g} Pa, nu {nu:.2f}, {rho:.4g} kg/m^3" for name, e, nu, rho in values)
