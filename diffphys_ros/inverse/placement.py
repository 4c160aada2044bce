"""A clip that begins in motion: the body is built in its pose at rest, and the answer lies where frame 0 has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import map_coordinates

from ..inpaint import nearest_known
from ..particles.skinning import bind
from ..types import Clip, Tracks
from ..vibration.rest import Rest

BACK_STEPS = 4  # of the search for the pixel that a pixel at rest comes from [numerical]


def at_rest(tracks: Tracks, rest: Rest) -> Tracks:
    """The points that hold in the frame nearest to rest, where they lie on the body at rest; how they move from frame 0 on stays."""
    kept = tracks.valid[rest.frame]
    pixels, points, valid = (array[:, kept] for array in (tracks.pixels, tracks.points, tracks.valid))
    sd = None if tracks.sd_m is None else tracks.sd_m[:, kept]
    shift = points[rest.frame] + rest.offset - points[0]
    return replace(tracks, pixels=pixels, points=points + shift, valid=valid, sd_m=sd, first=points[0])


def shown_at_rest(clip: Clip, depth0: np.ndarray, tracks: Tracks, rest: Rest) -> tuple[Clip, np.ndarray]:
    """A clip whose frame 0, of which `depth0` (H, W) [m] is the object's surface, shows it near rest, with the picture, the labels and the depths of
    that frame as they are at rest; and that surface. `tracks` are those of `at_rest`."""
    assert clip.labels is not None
    assert clip.depth is not None
    pixels = np.argwhere(depth0 > 0)[:, ::-1]
    u, v = pixels.T
    points = clip.camera.backproject(pixels.astype(float), depth0[v, u].astype(float))
    moved, depth = clip.camera.project(points + bind(points, tracks.points[0] - rest.offset).apply(rest.offset))
    flow = np.zeros((*depth0.shape, 3))
    flow[v, u] = np.column_stack([moved - pixels, depth - depth0[v, u]])
    flow = nearest_known(flow, depth0 > 0)
    came_from = _came_from(flow[..., :2])
    deeper = _at(flow[..., 2], came_from, 1)

    def farther(image: np.ndarray) -> np.ndarray:
        read = _at(image, came_from, 0)
        return np.where(read > 0, read + deeper, 0).astype(np.float32)

    frame = np.stack([_at(channel, came_from, 1) for channel in np.moveaxis(clip.frames[0].astype(float), -1, 0)], -1)
    first = {"frames": np.rint(frame).astype(np.uint8), "labels": _at(clip.labels[0], came_from, 0), "depth": farther(clip.depth[0])}
    return replace(clip, **{name: np.concatenate([image[None], getattr(clip, name)[1:]]) for name, image in first.items()}), farther(depth0)  # type: ignore[arg-type]


def _came_from(flow: np.ndarray) -> np.ndarray:
    """Where (2, H, W) [px, row and column] what a flow (H, W, 2) [px] brings to each pixel was before."""
    here = np.indices(flow.shape[:2]).astype(float)
    there = here
    for _ in range(BACK_STEPS):
        there = here - np.stack([_at(flow[..., 1], there, 1), _at(flow[..., 0], there, 1)])
    return there


def _at(image: np.ndarray, places: np.ndarray, order: int) -> np.ndarray:
    """An image (H, W) at places (2, H, W) [px, row and column]: bilinear, or with `order` 0 of the nearest pixel."""
    return map_coordinates(image, places, order=order, mode="nearest")


def in_body_pose(tracks: Tracks, points: np.ndarray) -> np.ndarray:
    """World points (N, 3) [m] of frame 0 where they are in the pose in which the body was built."""
    if tracks.first is None or not len(points):
        return points
    return points + bind(points, tracks.first).apply(tracks.points[0] - tracks.first)


def offset_of_first(tracks: Tracks, points: np.ndarray) -> np.ndarray:
    """From world points (N, 3) [m] of the pose in which the body was built to where these are in frame 0 [m], (N, 3)."""
    if tracks.first is None:
        return np.zeros_like(points)
    return bind(points, tracks.points[0]).apply(tracks.first - tracks.points[0])
