"""Frame 0 of the clip among the pictures of its still object: camera, metric scale, depth of the surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..config import Settings
from ..depth.capture import undistorted
from ..depth.inflate import inflated_depth
from ..depth.scale import DEPTH_TOPIC
from ..surface_plane import plane_depth
from ..types import Camera, Clip, object_mask
from .align import LEAST_DEPTHS, onto_camera, onto_positions, scale_of
from .structure import Placed, Structure
from .sweep import swept_depth
from .views import Shot, moved, shot_of

SURFACE = "a plane sweep over the capture's pictures"
POSITIONS = "positions of {count} cameras, met to {left:.2g} mm"


@dataclass(frozen=True)
class World:
    """Where a reconstruction stands."""

    similarity: np.ndarray  # world [m] from the reconstruction, shape (4, 4)
    scale: str  # what fixed the metric scale, in words
    frame_id: str  # of the world


def place_clip(placed: Placed, clip: Clip) -> tuple[Shot, Clip]:
    """Frame 0 in the frame and unit of the reconstruction; and the clip with the intrinsics found there. Both undistorted."""
    shot = shot_of(placed.name, clip.frames[0], placed.camera, placed.distortion, placed.seen)
    known = replace(clip.camera, pixel_from_camera=placed.camera.pixel_from_camera)
    return shot, replace(clip, camera=known, frames=undistorted(clip.frames, known, placed.distortion))


def object_depth(shot: Shot, others: list[Shot], structure: Structure, labels: np.ndarray) -> np.ndarray:
    """Depth of the object in frame 0 (H, W), in the unit of the reconstruction, 0 where unknown."""
    return swept_depth(shot, others, structure.points, object_mask(labels))


def world_of(structure: Structure, shot: Shot, depth: np.ndarray, clip: Clip, settings: Settings) -> World:
    """The clip's world. Its scale is that of the depth topic at sparse points, on the object where it shows enough of them; without
    a topic that of the clamp or the known size (`depth.inflate`) where the object's depth (H, W) is known."""
    if clip.depth is not None:
        measured, found = _at_points(structure, shot, clip)
        scale, spread = scale_of(measured, found)
        words = f"{DEPTH_TOPIC} at {int((measured > 0).sum())} points that agree to {100 * spread:.2g} %"
    else:
        assert clip.labels is not None
        reference, source = inflated_depth(clip, object_mask(clip.labels[0]), settings)
        scale, words = scale_of(reference[depth > 0], depth[depth > 0])[0], source.scale
    return World(onto_camera(shot.camera, clip.camera, scale), words, clip.camera.world_frame_id)


def world_of_positions(structure: Structure, positions: dict[str, np.ndarray], source: str) -> World:
    """The world in which the cameras' positions are known."""
    similarity, left = onto_positions(structure, positions, source)
    return World(similarity, POSITIONS.format(count=len(positions), left=1e3 * left), "capture")


def unknown_world(structure: Structure) -> World:
    """The first camera's frame, in which the points lie one unit away at the median; nothing says how large that is."""
    first = structure.placed[0]
    depth = first.camera.project(structure.points[first.seen])[1]
    home = Camera(first.camera.pixel_from_camera, np.eye(4), first.camera.width, first.camera.height)
    return World(onto_camera(first.camera, home, 1 / float(np.median(depth))), "unknown: the points are assumed 1 m away", "capture")


def in_world(shot: Shot, clip: Clip, world: World) -> Camera:
    """The clip's camera in the world: where the clip has its pose, that."""
    if world.frame_id == clip.camera.world_frame_id:
        return clip.camera
    found = moved(shot.camera, world.similarity, world.frame_id)
    return replace(found, frame_id=clip.camera.frame_id)


def _at_points(structure: Structure, shot: Shot, clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Depth [m] of the topic and of the reconstruction (P,) at sparse points of frame 0, on the object where there are enough."""
    assert clip.depth is not None
    assert clip.labels is not None
    pixels, depth = shot.camera.project(structure.points[shot.seen])
    height, width = clip.labels[0].shape
    index = np.clip(np.rint(pixels).astype(int), 0, (width - 1, height - 1))
    measured = plane_depth(clip.depth[0], pixels)[0]
    on = object_mask(clip.labels[0])[index[:, 1], index[:, 0]] & (measured > 0)
    chosen = on if on.sum() >= LEAST_DEPTHS else np.ones(len(on), bool)
    return measured[chosen], depth[chosen]
