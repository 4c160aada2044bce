"""The cameras of a clip, made of what was received beside its images: for recordings, and for live topics image by image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from diffphys_ros.bags.camera import camera_from_fov, camera_from_info
from diffphys_ros.bags.gravity import Imu, gravity_of
from diffphys_ros.bags.lens import Lens, calibration, image_size, is_rectified, lens_of
from diffphys_ros.bags.registration import Registration
from diffphys_ros.bags.transforms import Transforms
from diffphys_ros.bags.world import NotYetError, Stand, stand, standing, turned
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError, named
from diffphys_ros.types import Camera

FRAME = "camera_optical_frame"  # of images that name none
LATE_S = 0.1  # after the first image, from which on a camera_info is said to be late
Size = tuple[int, int]  # width, height [px]


@dataclass(frozen=True)
class Channel:
    """What is known of the images of one topic beside their pixels."""

    topic: str  # resolved
    size: Size
    frame_id: str = ""
    infos: Sequence[tuple[int, Any]] = ()  # stamp [ns], sensor_msgs/CameraInfo; in the order of their stamps
    info_topic: str = "camera_info"


@dataclass(frozen=True)
class Received:
    """What a clip's rig is made of."""

    source: str  # error messages name it
    stamps: Sequence[int]  # of the colour images [ns]
    colour: Channel
    depth: Channel | None = None
    transforms: Transforms = field(default_factory=Transforms)
    imu: Imu | None = None


class Rig:
    """Brings images to the undistorted colour camera of frame 0.

    Settings used: camera.fov_deg, scene.target_frame and what of scene.* speaks of the world. Raises InputError for geometry that
    would be wrong, NotYetError where a camera_info or transforms that come later may help.

    Attributes:
        camera: in the world of frame 0. gravity: measured [m/s^2] (3,), or None. notes: what was done and assumed.
    """

    def __init__(self, received: Received, settings: Settings) -> None:
        colour, self._stamps = received.colour, np.sort(np.asarray(received.stamps, np.int64))
        first, last = int(self._stamps[0]), int(self._stamps[-1])
        info, notes = in_force(colour, first, last)
        frame_id = colour.frame_id or (info.header.frame_id if info else "") or FRAME
        where = stand(received.transforms, frame_id, self._stamps.tolist(), settings.scene, received.source)
        self._lens, self.camera, found = _seen_through(colour, info, frame_id, where, settings, received.source)
        self._turns, moved = standing(where, self.camera, received.source)
        self._depth_undistort, self._register, registered = _depth_camera(received, self._lens, frame_id, first, last)
        self.gravity, felt = gravity_of(received.imu, where, frame_id, first, received.transforms, settings.scene)
        self.notes = [*notes, *where.notes, *found, *moved, *registered, *felt]

    def colour(self, stamp: int, image: np.ndarray) -> np.ndarray:
        """RGB (H, W, 3) uint8 of the image of a stamp [ns]."""
        return turned(_through(self._lens.undistort, image), self._turn(stamp), self.camera)

    def labels(self, image: np.ndarray) -> np.ndarray:
        """A label image (H, W) uint8 of frame 0."""
        return _through(self._lens.undistort, image)

    def depth(self, stamp: int, image: np.ndarray) -> np.ndarray:
        """Depth [m] (H, W) float32, 0 where unknown, of the depth image of a stamp [ns]."""
        image = _through(self._depth_undistort, image)
        return turned(self._register(image) if self._register else image, self._turn(stamp), self.camera)

    def _turn(self, stamp: int) -> np.ndarray | None:
        return self._turns[int(np.abs(self._stamps - stamp).argmin())]


def in_force(channel: Channel, first: int, last: int) -> tuple[Any, list[str]]:
    """The camera_info of the first image, None where there is none, and notes where it came late or changed until the last [ns]."""
    infos = [item for item in channel.infos if image_size(item[1]) == channel.size] or list(channel.infos)
    if not infos:
        return None, []
    chosen = max((index for index, (stamp, _) in enumerate(infos) if stamp <= first), default=0)
    stamp, info = infos[chosen]
    topic, notes = named(channel.info_topic), []
    if stamp > first + LATE_S * 1e9:
        notes.append(f"{topic} came {(stamp - first) * 1e-9:.2f} s after the first image and is taken for all of them")
    others = [s for s, other in infos[chosen + 1 :] if s <= last and calibration(other) != calibration(info)]
    if others:
        notes.append(f"{topic} changes {(others[0] - first) * 1e-9:.2f} s after the first image; the one before is taken for all of them, so do not zoom or refocus")
    return info, notes


def _through(change: Any, image: np.ndarray) -> np.ndarray:
    return change(image) if change else image


def _seen_through(colour: Channel, info: Any, frame_id: str, where: Stand, settings: Settings, source: str) -> tuple[Lens, Camera, list[str]]:
    """Lens and camera of the colour images, and notes. Raises InputError where nothing tells them."""
    fov = settings.camera.fov_deg
    if info is None or (info.k[0] == 0 and fov):
        if fov is None:
            raise NotYetError(f"{source}: has no camera_info; record the camera_info topic or set camera.fov_deg")
        camera = camera_from_fov(fov, *colour.size, frame_id, where.first, where.frame)
        note = f"no usable camera_info: camera.fov_deg {fov:g} and no lens distortion are taken"
        return Lens(camera.pixel_from_camera, None, colour.size), camera, [note]
    lens = _lens(colour, info, source)
    return lens, camera_from_info(lens.matrix, [], *colour.size, frame_id, where.first, where.frame), list(lens.notes)


def _lens(channel: Channel, info: Any, source: str) -> Lens:
    try:
        return lens_of(info, channel.size, channel.topic)
    except InputError as error:
        words = str(error)
        about = f"{named(channel.info_topic)} {words}" if words.startswith("is for ") else f"topic {named(channel.info_topic)}: {words}"
        raise InputError(f"{source}: {about}") from error


def _depth_camera(received: Received, lens: Lens, frame_id: str, first: int, last: int) -> tuple[Any, Registration | None, list[str]]:
    """What removes the distortion of depth images, what brings them to the colour camera, and notes; None where there is nothing to do."""
    depth, source = received.depth, received.source
    if depth is None:
        return None, None, []
    together = not depth.frame_id or depth.frame_id.removeprefix("/") == frame_id.removeprefix("/")
    info, notes = in_force(depth, first, last)
    if info is None:
        if not together:
            raise NotYetError(
                f"{source}: depth of {named(depth.topic)} is in frame {named(depth.frame_id)}, colour in {named(frame_id)}, and there is no camera_info of the depth; "
                "record the one beside it (live: depth_camera_info), record depth registered to the colour camera, or set topics.depth to 'none'"
            )
        if depth.size != lens.size:
            raise InputError(
                f"{source}: a depth image has {depth.size[0]}x{depth.size[1]} px, must have the camera's {lens.size[0]}x{lens.size[1]} px; "
                "record depth registered to the colour camera or with its own camera_info, or set topics.depth to 'none'"
            )
        return (lens.undistort if is_rectified(depth.topic) == is_rectified(received.colour.topic) else None), None, []
    own = _lens(depth, info, source)
    pose = np.eye(4) if together else received.transforms.between(frame_id, depth.frame_id, first)
    if pose is None:
        raise NotYetError(
            f"{source}: no transform from the colour camera's {named(frame_id)} to the depth camera's {named(depth.frame_id)} is known (frames known: {received.transforms.frames()}); "
            "record or publish /tf_static (or camera_pose), or set topics.depth to 'none'"
        )
    if together and own.sees_like(lens):
        return own.undistort, None, notes
    apart = "" if together else f", {100 * float(np.linalg.norm(pose[:3, 3])):.2g} cm from the colour camera"
    note = f"depth of {named(depth.topic)} ({own.size[0]}x{own.size[1]} px{apart}) was brought to the colour images"
    return own.undistort, Registration(own, lens, pose), [*notes, note]
