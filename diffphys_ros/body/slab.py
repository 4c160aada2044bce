"""The filled solid of the object, from one view of it and what is known about the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Scene, Settings, leaves
from ..errors import InputError
from ..inpaint import nearest, nearest_known
from ..measured import scene_of
from ..types import Body, Clip, object_mask
from .leaving import line_sd_px, with_edge
from .solid import Solid, solid_of
from .view import FrontView, mask_with_depth, view_of

WATER_DENSITY = 1000.0  # kg/m^3, assumed where neither mass nor density is known
POISSON_RATIO = 0.3  # assumed where it is not known


def build_body(clip: Clip, depth0: np.ndarray, settings: Settings, *, behind_px: float | None = None, soft: np.ndarray | None = None, parallel: bool = False) -> Body:
    """The solid seen in frame 0: its silhouette along the thickness axis, extruded symmetrically to the mid-plane.

    The front comes from `depth0`; the unseen back is the front mirrored in the mid-plane half a thickness behind it. The thickness is
    `scene.thickness_m`, or the silhouette's own local width where that is not given, a sheet's at most with `experiment.sheet_share`. Without a depth topic the body is a slab
    between two planes, cut out where both show in the mask, and held where it leaves the picture if nobody tells its clamp. Needs `clip.labels`.

    Args:
        clip: recording with label images.
        depth0: the object's surface in frame 0 [m], 0 off the object, shape (H, W).
        settings: `scene.*` and `experiment.sheet_share`.
        behind_px: how far the held face lies behind the line of `scene.clamp_px`, out of the object, by who knows how surely; left out it lies on it,
            as surely as such a line is.
        soft: share of each pixel that the object covers (H, W), where that is known better than from frame 0.
        parallel: what lies beyond the picture is as wide as the object is at its edge; left out, its sides lean half as they do there.

    Raises:
        InputError: nothing of the object near the clamp, a density list that does not fit the parts, an object too small.
    """
    if clip.labels is None:
        raise ValueError("build_body needs clip.labels; run segment.label_clip first")
    told = scene_of(clip, settings.scene)
    scene, seen = with_edge(clip, told)
    view = view_of(clip, depth0, mask_with_depth(clip.labels[0], depth0), scene, behind_px or 0.0, soft)
    solid = solid_of(view, scene, sheet_share=settings.experiment.sheet_share, parallel=parallel)
    part = _parts(clip.labels[0], view, solid.inside)
    counted = _counted(part) if _by_colour(clip, settings) else part
    pose = view.pose.copy()
    pose[:3, 3] += pose[:3, 2] * solid.middle
    body = _described(scene, clip, view, pose, solid, counted)
    if counted.max() < part.max():
        body = replace(body, sources=body.sources | {"colours": f"{part.max() - body.parts} that cover(s) no cell of the object is no part"})
    if settings.experiment.sheet_share and not scene.thickness_m:
        body = replace(body, sources=body.sources | {"thickness": "a thin sheet (experiment.sheet_share)"})
    body = replace(body, sources=body.sources | {"clamp": seen}) if seen else body
    if scene.clamp_px is None or behind_px is not None:
        return body
    sd_px = line_sd_px(scene.clamp_px, object_mask(clip.labels[0]), drawn=told.tells_clamp)
    return replace(body, clamp_sd_m=sd_px * view.footprint_m, sources=body.sources | {"clamp": f"{body.sources['clamp']}; the held face lies within {sd_px:.1f} px of it (sd)"})


def _parts(labels: np.ndarray, view: FrontView, inside: np.ndarray) -> np.ndarray:
    """Part numbers (nx, ny) uint8 read from the label image under the front, extended to the nearest part."""
    value = nearest(labels, view.front_pixels()[0])
    known = inside & object_mask(value)
    return nearest_known(value, known).astype(np.uint8) if known.any() else np.ones(inside.shape, np.uint8)


def _by_colour(clip: Clip, settings: Settings) -> bool:
    """Whether nobody but the program itself says which parts there are: neither a mask nor a list of values part by part."""
    return settings.scene.first_mask is None and clip.first_labels is None and not settings.told_by_part


def _counted(part: np.ndarray) -> np.ndarray:
    """Part numbers (nx, ny) 1.. without those that no cell has, in the same order."""
    return np.asarray(np.unique(part, return_inverse=True)[1].reshape(part.shape) + 1).astype(np.uint8)


def _described(scene: Scene, clip: Clip, view: FrontView, pose: np.ndarray, solid: Solid, part: np.ndarray) -> Body:
    parts = max(int(part[solid.inside].max()), 1)
    if lacking := np.setdiff1d(np.arange(1, parts + 1), part[solid.inside]).tolist():
        raise InputError(
            f"{clip.source or 'clip'}: part {lacking[0]} of {parts} covers no cell of the object (its pixels lack a depth, or are too few); "
            "mark it larger in scene.first_mask, join it with its neighbour, or lower segment.max_parts"
        )
    volumes = np.array([(solid.half * (part == k + 1)).sum() for k in range(parts)]) * 2 * view.raster.pitch_m**2
    density, density_source = part_densities(scene, volumes)
    return Body(
        world_from_body=pose,
        inside=solid.inside,
        origin=view.raster.origin,
        pitch_m=view.raster.pitch_m,
        half_thickness=solid.half,
        part=part,
        density=density,
        poisson=_per_part(scene.poisson_ratio or [POISSON_RATIO], parts, "scene.poisson_ratio"),
        gravity=np.array(scene.gravity_m_s2 or (0.0, 0.0, 0.0)) @ pose[:3, :3],
        clamped=view.clamp is not None,
        sources={"density": density_source, "thickness": "thickness_m" if scene.thickness_m else "the mask's own width"} | _root_source(solid, view),
    )


def _root_source(solid: Solid, view: FrontView) -> dict[str, str]:
    lean, said = view.lean, []
    if lean:
        said.append(f"the object's outline ends on a line that leans {abs(np.rad2deg(lean)):.0f} degrees off the box face, which is taken for the held face")
    if solid.short_m:
        said.append(f"the object's outline ends {1e3 * solid.short_m:.1f} mm before the clamped plane and was continued to it")
    if view.clamp is not None and view.clamp.drawn:
        return {"clamp": "; ".join(["clamp_px, a line in the picture", *said])}
    return {"clamp": "clamp_box_m; " + "; ".join(said)} if said else {}


def part_densities(scene: Scene, volumes: np.ndarray) -> tuple[np.ndarray, str]:
    """Density per part [kg/m^3] of parts with these volumes [m^3], and what fixed it."""
    if scene.density_kg_m3 is not None:
        density = _per_part(scene.density_kg_m3, len(volumes), "scene.density_kg_m3")
        if scene.mass_kg is None:
            return density, "density_kg_m3"
        return _of_mass(density * scene.mass_kg / float(density @ volumes), "density_kg_m3 scaled to mass_kg")
    if scene.mass_kg is not None:
        return _of_mass(np.full(len(volumes), scene.mass_kg / volumes.sum()), "mass_kg over the filled volume")
    return np.full(len(volumes), WATER_DENSITY), f"assumed: {WATER_DENSITY:g} kg/m^3"


def _of_mass(density: np.ndarray, source: str) -> tuple[np.ndarray, str]:
    """Density per part [kg/m^3] that follows from a mass, and what fixed it, with a word of doubt where no solid is so light or so heavy."""
    leaf = leaves()["scene.density_kg_m3"]
    assert leaf.low is not None
    assert leaf.high is not None
    if leaf.low <= density.min() and density.max() <= leaf.high:
        return density, source
    strange = density.min() if density.min() < leaf.low else density.max()
    return density, f"{source}, which makes {strange:.3g} kg/m^3 where solids have {leaf.range_text}: check mass_kg, thickness_m and the scale"


def _per_part(values: list[float], parts: int, name: str) -> np.ndarray:
    if len(values) not in (1, parts):
        raise InputError(f"{name} has {len(values)} values, must be 1 or {parts} (one per part found); correct the list or segment.max_parts")
    return np.broadcast_to(np.array(values, float), (parts,)).copy()
