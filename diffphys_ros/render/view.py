"""The camera as the kernels see it, and crop windows."""

import numpy as np
import warp as wp

from ..errors import InputError
from ..types import Camera

FIELD_MARGIN = 0.15  # of the image's width: the projection's derivative is held constant further out (after gsplat)

Window = tuple[int, int, int, int]  # left, top, right, bottom [px], half open


@wp.struct
class View:
    """A pinhole camera over a window of its image."""

    camera_from_world: wp.mat33
    offset: wp.vec3  # camera coordinates of the world's origin [m]
    focal: wp.vec3  # fx, fy, skew [px]
    centre: wp.vec2  # principal point in the window [px]
    low: wp.vec2  # smallest x/z, y/z at which the derivative of the projection is taken
    high: wp.vec2  # largest
    width: int  # of the window [px]
    height: int


def full_window(camera: Camera) -> Window:
    """The whole image."""
    return 0, 0, camera.width, camera.height


def window_around(mask: np.ndarray, margin: int) -> Window:
    """Smallest window over the true pixels of mask (H, W) or (T, H, W), widened by margin [px] and clipped to the image.

    Raises InputError where the mask is empty.
    """
    flat = np.any(mask.reshape(-1, *mask.shape[-2:]), axis=0)
    rows, columns = np.flatnonzero(flat.any(1)), np.flatnonzero(flat.any(0))
    if not len(rows):
        raise InputError("mask: has no pixel to render; give a mask that covers the object")
    height, width = flat.shape
    return (
        max(int(columns[0]) - margin, 0),
        max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + 1 + margin, width),
        min(int(rows[-1]) + 1 + margin, height),
    )


def make_view(camera: Camera, window: Window) -> View:
    """The kernels' view of a window of the camera's image. Raises InputError for a window that is not inside the image."""
    left, top, right, bottom = window
    if not (0 <= left < right <= camera.width and 0 <= top < bottom <= camera.height):
        raise InputError(f"window {window}: must be left, top, right, bottom inside the image of {camera.width} x {camera.height} px")
    k, rotation = camera.pixel_from_camera, camera.world_from_camera[:3, :3].T
    low, high = _field_of_view(camera)
    view = View()
    view.camera_from_world = wp.mat33(*rotation.reshape(-1).tolist())
    view.offset = wp.vec3(*(-rotation @ camera.position).tolist())
    view.focal = wp.vec3(float(k[0, 0]), float(k[1, 1]), float(k[0, 1]))
    view.centre = wp.vec2(float(k[0, 2] - left), float(k[1, 2] - top))
    view.low, view.high = wp.vec2(*low), wp.vec2(*high)
    view.width, view.height = right - left, bottom - top
    return view


def _field_of_view(camera: Camera) -> tuple[list[float], list[float]]:
    k, size = camera.pixel_from_camera, np.array([camera.width, camera.height])
    focal, margin = np.array([k[0, 0], k[1, 1]]), FIELD_MARGIN * size
    return ((-margin - k[:2, 2]) / focal).tolist(), ((size + margin - k[:2, 2]) / focal).tolist()
