"""First Gaussians: the masked pixels of frame 0, gathered into blocks and lifted onto the surface as flat discs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, median_filter

from ..errors import InputError
from ..inpaint import nearest_known
from ..types import Camera

COARSEST_PX = 4  # side of the largest block where the count allows it; a power of two
BLOCKS_DB = 32.0  # nearness of the first blocks' flat colours to the picture, where the count is chosen
MOST = 100_000  # Gaussians of a chosen count, for memory and time
FLAT = 1e-9  # blocks that deviate less are never split: the rest is rounding
FILTER_PX = 5  # median of the depths, against their noise
SLOPE_SIGMA_PX = 2.0  # smoothing of the slope, against quantised depths
MAX_STRETCH = 2.5  # largest length of a disc over its width as seen (a tilt of 66 degrees)


@dataclass(frozen=True)
class Blocks:
    """B square blocks of pixels that cover a mask."""

    centre: np.ndarray  # centroid of the masked pixels [px], shape (B, 2)
    side: np.ndarray  # of a square of as many pixels as the block has in the mask [px], shape (B,)
    color: np.ndarray  # mean of the masked pixels, 0..1, shape (B, 3)


@dataclass(frozen=True)
class Surface:
    """The seen surface at B pixels."""

    depth: np.ndarray  # [m], shape (B,)
    axes: np.ndarray  # rotation, columns: longest and shortest axis of a pixel's footprint, normal; world frame, (B, 3, 3)
    footprint: np.ndarray  # of a pixel along the first two axes [m], shape (B, 2)
    pixel_from_plane: np.ndarray  # pixels per displacement along the first two axes [px/m], shape (B, 2, 2)


def gather_blocks(image: np.ndarray, mask: np.ndarray, count: int) -> Blocks:
    """At most `count` blocks: small where image (H, W, 3) of 0..1 has detail or mask (H, W) an edge, large elsewhere.

    A quadtree: a block is split where the squared deviation from its mean exceeds one bound for all, the lowest that
    keeps the count.
    """
    rows, columns, values, owners, errors = _tree(image, mask, count)
    sizes = [np.bincount(owner)[owner] for owner in owners]
    level = next(_levels(errors, lambda level: _number(level, sizes) <= count))
    leaf = np.choose(level, owners) + level * (max(o.max() for o in owners) + 1)
    _, leaf, number = np.unique(leaf, return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(leaf, v) for v in (columns, rows, *values.T)], -1) / number[:, None]
    return Blocks(mean[:, :2], np.sqrt(number), mean[:, 2:])


def count_blocks(image: np.ndarray, mask: np.ndarray, psnr_db: float, most: int) -> int:
    """The fewest blocks of at most COARSEST_PX, but no more than `most`, whose flat colours are as near as psnr_db to image (H, W, 3)
    of 0..1 on mask (H, W)."""
    _, _, values, owners, errors = _tree(image, mask, most)
    numbers = [np.bincount(owner) for owner in owners]
    sizes = [n[o] for n, o in zip(numbers, owners, strict=True)]
    deviation = [(_color_deviation(o, values, n) / n)[o] for o, n in zip(owners, numbers, strict=True)]
    allowed = 10 ** (-psnr_db / 10) * values.size

    def wrong(level: np.ndarray) -> bool:
        return float(np.choose(level, deviation).sum()) > allowed

    coarse, fine = _levels(errors, wrong)
    return min(_number(fine if wrong(coarse) else coarse, sizes), most)


def _number(level: np.ndarray, sizes: list[np.ndarray]) -> int:
    """Of blocks, from the level of each pixel and, per level, how many pixels its block there has."""
    return round(float((1 / np.choose(level, sizes)).sum()))


def _tree(image: np.ndarray, mask: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Row, column and colour of every masked pixel; per level, finest first, its block and that block's deviation. The coarsest
    level has fewer blocks than `count`."""
    rows, columns = np.nonzero(mask)
    values, width = image[rows, columns], mask.shape[1]
    sides = _sides(rows, columns, width, count)
    owners = [_owner(rows, columns, side, width) for side in sides]
    return rows, columns, values, owners, [_deviation(owner, values, side) for owner, side in zip(owners, sides, strict=True)]


def _sides(rows: np.ndarray, columns: np.ndarray, width: int, count: int) -> list[int]:
    coarsest = COARSEST_PX
    while _owner(rows, columns, coarsest, width).max() >= count:
        coarsest *= 2
    return [2**k for k in range(coarsest.bit_length())]


def _owner(rows: np.ndarray, columns: np.ndarray, side: int, width: int) -> np.ndarray:
    """Number 0.. of the block of every pixel."""
    return np.unique(rows // side * width + columns // side, return_inverse=True)[1]


def _deviation(owner: np.ndarray, values: np.ndarray, side: int) -> np.ndarray:
    """Per pixel: sum over its block of the squared deviation of colour and of the mask itself from their means."""
    number = np.bincount(owner)
    edge = number * (1 - number / side**2)
    return (_color_deviation(owner, values, number) + edge)[owner]


def _color_deviation(owner: np.ndarray, values: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Per block: sum of the squared deviation of colour from its mean."""
    return sum(np.bincount(owner, v * v) - np.bincount(owner, v) ** 2 / number for v in values.T)


def _levels(errors: list[np.ndarray], fits: Callable[[np.ndarray], bool]) -> Iterator[np.ndarray]:
    """Per pixel the level of its block, level k having side 2^k: under the lowest bound on the blocks' errors at which `fits` holds
    (it then holds for all higher ones; where for none, under the highest, which splits nothing), then under the bound before it."""
    bounds = np.unique(np.concatenate([*(np.maximum(e, FLAT) for e in errors[1:]), [FLAT, np.inf]]))
    low, high = 0, len(bounds) - 1
    while low < high:
        middle = (low + high) // 2
        if fits(_split(errors, bounds[middle])):
            high = middle
        else:
            low = middle + 1
    yield _split(errors, bounds[high])
    yield _split(errors, bounds[max(high - 1, 0)])


def _split(errors: list[np.ndarray], bound: float) -> np.ndarray:
    level = np.full(len(errors[0]), len(errors) - 1)
    for k in range(len(errors) - 1, 0, -1):
        level[(level == k) & (errors[k] > bound)] = k - 1
    return level


def surface_at(pixels: np.ndarray, depth0: np.ndarray, mask: np.ndarray, camera: Camera) -> Surface:
    """The surface at pixels (B, 2) from the depths (H, W) [m] of the masked pixels; unknown ones (0 or not finite) take the
    nearest known. Raises InputError where no masked pixel has a depth."""
    depth = median_filter(_fill(depth0, mask), FILTER_PX, mode="nearest")
    slope_y, slope_x = np.gradient(gaussian_filter(depth, SLOPE_SIGMA_PX, mode="nearest"))
    column, row = np.rint(pixels.T).astype(int)
    z = depth[row, column][:, None]
    rays = camera.rays(pixels)
    step_x, step_y = (camera.rays(pixels + step) - rays for step in np.eye(2))
    along_x, along_y = step_x * z + rays * slope_x[row, column, None], step_y * z + rays * slope_y[row, column, None]
    normal = _facing(np.cross(along_x, along_y), rays)
    tangents = _tangents(normal, step_x)
    along = [z * (step - rays * _dot(normal, step) / _dot(normal, rays)) for step in (step_x, step_y)]
    turn, footprint, across = np.linalg.svd(np.einsum("bci,abc->bia", tangents, np.stack(along)))
    flip = np.linalg.det(turn)[:, None]  # makes the turn a rotation where it is a reflection
    turn[:, :, 1] *= flip
    across[:, 1] *= flip
    axes = np.concatenate([tangents @ turn, normal[..., None]], -1)
    return Surface(z[:, 0], axes, footprint, np.swapaxes(across, 1, 2) / footprint[:, None])


def _fill(depth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    known = mask & np.isfinite(depth) & (depth > 0)
    if not known.any():
        raise InputError("depth: is 0 or not finite on the whole mask; give depths [m] for at least a part of the object")
    return nearest_known(depth, known).astype(float)


def _facing(normal: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Unit normals towards the camera, tilted no further than MAX_STRETCH allows."""
    view = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal * np.where(_dot(normal, view) < 0, -1, 1)
    cosine = np.maximum(_dot(normal, view), 1 / MAX_STRETCH)
    side = normal - view * _dot(normal, view)
    length = np.linalg.norm(side, axis=1, keepdims=True)
    return view * cosine + side / np.maximum(length, 1e-12) * np.where(length > 0, np.sqrt(1 - cosine**2), 0)


def _tangents(normal: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Two unit vectors (B, 3, 2) that complete the normals to right-handed frames; the first lies nearest to `along`."""
    first = along - normal * _dot(normal, along)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first)], -1)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(1, keepdims=True)
