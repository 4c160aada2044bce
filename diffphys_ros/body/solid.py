"""Silhouette and thickness of the body on its raster."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from ..config import Scene
from ..errors import InputError
from ..inpaint import nearest, nearest_known
from ..picture import along_border, on_plane
from .silhouette import CELLS_PER_PIXEL, carved, ending, reaching_clamp, sample, smoothed, surface_height, tidy
from .view import FrontView

FLAT_PX, FLAT_NOISE = 0.5, 4.0  # footprints of a pixel, and standard deviations of the height: a front that recedes by less is flat
THINNEST = 0.15  # of the half thickness where it does not recede: a thinner rim is left out, it carries no load; a thin strand does
HIDDEN_ROOT = 0.35  # of the length: at most so much of the root may hide behind the mount
RAGGED = 0.25  # of its width: an end that is uneven by no more is one end [chosen]
ROOT_TOLERANCE_PX = 3.0  # gap at the clamp that is closed although nothing is seen to hide it
BESIDE_LINE_PX = 8.0  # from a line drawn for the clamp from which the outline counts: nearer, the picture's edge cuts it
SIDES = 1.0  # of its width where the object leaves the picture, along which its sides are read at the least; else along as much as is hidden [chosen]
SLANT = 0.05  # of its width, by which they draw nearer along that, or apart: straight strips are as uneven [docs/measurements/films.md]
LEANS_ON = 0.5  # of that, by which they lean where they are not seen: as likely as leaning on they are parallel there, as those of grips are [chosen]
HIDDEN_WIDTHS = (0.5, 2.0)  # of its width there, between which what is hidden stays [chosen]
UNSEEN_PX = 4.0  # from the nearest measured depth, beyond which what is filled in says nothing of a cell [chosen]
CLEAR_PX = 2.0  # from lost depth, within which measured depth is mixed with what is filled in [chosen]
IN_FRONT = 0.01  # an occluder is nearer than the front by this share of the depth


@dataclass(frozen=True)
class Solid:
    """A silhouette extruded symmetrically to a mid-plane."""

    inside: np.ndarray  # bool, shape (nx, ny)
    half: np.ndarray  # half thickness [m], 0 outside, shape (nx, ny)
    middle: float  # height of the mid-plane [m]
    short_m: float = 0.0  # how far the outline ended before the clamped plane, to which it is continued [m]


def solid_of(view: FrontView, scene: Scene, *, sheet_share: float = 0.0, parallel: bool = False) -> Solid:
    """The solid that a view shows. Where nobody tells its thickness and `sheet_share` is above 0, a sheet as thick as that share of its longest
    side at most, with the gaps between its strands. `parallel`: beyond the picture it is as wide as at its edge, whichever way its sides lean there. Raises
    InputError where nothing of it faces the thickness axis."""
    sheet_share = 0.0 if scene.thickness_m else sheet_share
    inside, height = _front(view, scene, strands=sheet_share > 0)
    if not inside.any():
        raise InputError(f"{view.source}: no part of the object faces scene.thickness_axis; correct the axis or the mask")
    short = 0
    if view.clamp:
        parallel = parallel or scene.clamp_px is None or not along_border(scene.clamp_px, view.soft.shape)
        inside, short = _with_straight_root(view, inside, parallel=parallel) if view.clamp.drawn else _with_root(view, inside)
    full = np.full(inside.shape, scene.thickness_m / 2) if scene.thickness_m else _own_half(inside, sheet_share) * view.raster.pitch_m
    receding = np.zeros(inside.shape) if sheet_share else np.clip(view.front - smoothed(height, inside), 0, None)  # a sheet that recedes is bent, not thinner
    half = full - np.where(receding > max(FLAT_PX * view.footprint_m, FLAT_NOISE * view.noise_m), receding, 0.0)
    inside &= half > THINNEST * full
    return Solid(inside, np.where(inside, half, 0.0), view.front - float(full.max()), short * view.raster.pitch_m)


def _own_half(inside: np.ndarray, sheet_share: float) -> np.ndarray:
    """Half thickness [cells] (nx, ny) that the silhouette itself gives: as thick as it is wide, a sheet no thicker than its share."""
    half = local_half_width(inside)
    longest = max(int(np.ptp(np.flatnonzero(inside.any(1 - axis)))) + 1 for axis in (0, 1))
    return np.minimum(half, sheet_share * longest / 2) if sheet_share else half


def _front(view: FrontView, scene: Scene, *, strands: bool) -> tuple[np.ndarray, np.ndarray]:
    """Silhouette (nx, ny) and height [m] of the front as far as it is seen; `strands`: with the gaps between them."""
    thickness = scene.thickness_m or 0.0
    gaps = sample(view.soft, view.front_pixels()[0]) < 0.5 if strands else None
    if view.measured is None:
        inside = carved(view.raster, view.pose, view.camera, view.soft, (view.front, view.front - thickness))
        return tidy(inside, gaps), np.full(inside.shape, view.front)
    height, inside = surface_height(view.raster, view.pose, view.camera, view.soft, view.surface, view.front, view.footprint_m)
    if thickness:
        height, inside = _where_depth_is_lost(view, height, inside, thickness)
        inside &= view.front - height < thickness / 2
    return tidy(inside, gaps), height


def _with_root(view: FrontView, inside: np.ndarray) -> tuple[np.ndarray, int]:
    """The silhouette continued to the clamp plane within the box's width, where it is hidden or stops short by a few pixels; where all of it
    stops further off, from there, and how far that is [cells]. Raises InputError where nothing of it lies in front of the box."""
    assert view.clamp is not None
    in_box = np.abs(view.raster.centres[0, :, 1]) <= np.abs(view.pose[:3, 1]) @ view.clamp.half_size
    reach, tolerance = round(HIDDEN_ROOT * float(np.flatnonzero(inside.any(1)).max())), round(ROOT_TOLERANCE_PX * CELLS_PER_PIXEL)
    grown = np.where(in_box, reaching_clamp(inside, _occluded(view, inside & in_box), reach=reach, tolerance=tolerance), inside)
    if grown[0].any():
        return grown, 0
    rows = np.flatnonzero((inside & in_box).any(1))
    if not len(rows):
        raise InputError(f"{view.clamp.told}: nothing of the object lies straight in front of it; move it onto the held face")
    short, uneven = int(rows[0]), max(tolerance, round(RAGGED * int((inside & in_box).any(0).sum())))
    return np.where(in_box, reaching_clamp(inside, np.zeros_like(inside), reach=short + uneven, tolerance=short + uneven), inside), short


def _with_straight_root(view: FrontView, inside: np.ndarray, *, parallel: bool) -> tuple[np.ndarray, int]:
    """The silhouette continued straight from the line that was drawn for the clamp, and from the picture's edge, to the clamped plane, with sides that
    draw nearer or apart half as they do beside that edge unless they are to be parallel; and 0 cells. Raises InputError where nothing of it lies at that line."""
    assert view.clamp is not None
    first = min(round((view.behind_m + BESIDE_LINE_PX * view.footprint_m) / view.raster.pitch_m), len(inside) - 1)
    if not inside[first].any():
        raise InputError(f"{view.clamp.told}: nothing of the object lies at this line in its reference frame; draw it across the held end, or along the picture's edge")
    root = np.broadcast_to(inside[first], (first, inside.shape[1])) if parallel else _continued(inside, first)
    return np.concatenate([root, inside[first:]]), 0


def _continued(inside: np.ndarray, first: int) -> np.ndarray:
    """Rows 0 .. first - 1 of a silhouette (nx, ny): row `first`, stretched about its middle half as its width changes along the rows after it."""
    width = inside[first:].sum(1)
    width = width[: max(min(first, np.count_nonzero(width) // 2), round(SIDES * width[0]), 2)]
    slope, begin = np.polyfit(np.arange(len(width)), width, 1) if len(width) > 1 else (0.0, float(width[0]))
    if abs(slope) * len(width) < SLANT * begin:
        slope = 0.0
    stretch = np.clip(1 - LEANS_ON * slope / begin * np.arange(first, 0, -1), *HIDDEN_WIDTHS)
    column = np.arange(inside.shape[1])
    middle = column[inside[first]].mean()
    place = np.rint(middle + (column - middle) / stretch[:, None]).astype(int)
    return inside[first][np.clip(place, 0, len(column) - 1)] & (place >= 0) & (place < len(column))


def _occluded(view: FrontView, inside: np.ndarray) -> np.ndarray:
    """Cells (nx, ny) of the front before which something else stands; where no depth can tell, all that lie behind the end of the silhouette:
    behind its sides, which a bent body turns to the clamp as well, and behind its shoulders the scene is seen."""
    if view.measured is None:
        return np.broadcast_to(ending(inside), inside.shape)
    pixels, depth = view.front_pixels()
    measured = nearest(view.measured, pixels)
    return (measured > 0) & (measured < (1 - IN_FRONT) * depth)


def _where_depth_is_lost(view: FrontView, height: np.ndarray, inside: np.ndarray, thickness_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Height [m] and silhouette (nx, ny) with what the picture says of cells without measured depth."""
    assert view.measured is not None
    pixels, _ = view.front_pixels()
    lost = nearest(view.measured, pixels) == 0
    if not lost.any():
        return height, inside
    unseen = nearest(_off_measured(view), pixels) > UNSEEN_PX
    told = inside & (distance_transform_edt(~lost) > CLEAR_PX * CELLS_PER_PIXEL)
    if unseen.any() and told.any():
        height = np.where(unseen, _gone_on(height, told), height)
        inside = np.where(unseen, sample(view.soft, view.pixels_at(height)[0]) >= 0.5, inside)
    return height, inside & ~(lost & _seen_past(view, np.minimum(height, view.front), thickness_m))


def _off_measured(view: FrontView) -> np.ndarray:
    """How far the object's pixels (H, W) are from the nearest whose depth was measured [px]: too near for the camera, or beside what hides them from its
    other eye; 0 off the object, and everywhere where none was measured."""
    assert view.measured is not None
    on_object = view.surface > 0
    measured = on_object & (view.measured > 0)
    return np.asarray(distance_transform_edt(~measured) * on_object) if measured.any() else np.zeros(on_object.shape)


def _gone_on(height: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Heights (nx, ny) as those of the cells that are `told` go on: with the plane nearest to these, as far off it as the nearest of them."""
    basis = np.stack([np.ones(height.shape), *np.indices(height.shape)], -1)
    plane = basis @ np.linalg.lstsq(basis[told], height[told], rcond=None)[0]
    return np.asarray(plane + nearest_known(height - plane, told))


def _seen_past(view: FrontView, height: np.ndarray, thickness_m: float) -> np.ndarray:
    """Cells (nx, ny) at whose back, which mirrors their front's `height` [m] in the mid-plane, what lies farther away is seen: nothing of the object is there,
    and what seemed its front is a side of it whose depth was lost. Measured depth tells a side by itself, and more finely than the mask does."""
    assert view.measured is not None
    elsewhere = view.measured * (view.surface == 0)
    if not elsewhere.any():
        return np.zeros(height.shape, bool)
    pixels, depth = view.pixels_at(2 * view.front - thickness_m - height)
    farther = nearest(nearest_known(elsewhere, elsewhere > 0), pixels) * (1 - IN_FRONT) > depth
    return np.asarray(farther & (sample(view.soft, pixels) < 0.5) & ~_behind_clamp(view, pixels))


def _behind_clamp(view: FrontView, pixels: np.ndarray) -> np.ndarray:
    """Which rays through pixels (nx, ny, 2) meet the front's plane behind the clamped one, or within the outline's tolerance of it: what holds the object
    hides what is seen there of its back, and its own depth may be lost."""
    if view.clamp is None:
        return np.zeros(pixels.shape[:2], bool)
    along, up, centre = view.pose[:3, 0], view.pose[:3, 2], view.pose[:3, 3]
    met = on_plane(view.camera, pixels, centre + view.front * up, up)
    return np.asarray((met - centre) @ along < ROOT_TOLERANCE_PX * view.footprint_m)


def local_half_width(inside: np.ndarray) -> np.ndarray:
    """Radius of the largest disc inside the silhouette that covers each cell [cells], shape (nx, ny) (local thickness)."""
    radius = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    ridge = (radius >= cv2.dilate(radius, np.ones((3, 3), np.uint8)) - 1e-6) & inside
    width = radius.copy()
    centres = np.argwhere(ridge)
    for i, j in centres[np.argsort(radius[ridge], kind="stable")]:
        cv2.circle(width, (int(j), int(i)), int(radius[i, j]), float(radius[i, j]), -1)
    return np.where(inside, width, 0.0)
