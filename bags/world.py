"""Where the camera stands in the world during a clip, from its transforms; never guessed where a setting speaks of the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from diffphys_ros.bags.transforms import FIXED, Transforms
from diffphys_ros.config import Scene
from diffphys_ros.errors import InputError, listed, named
from diffphys_ros.types import Camera

STILL_M, STILL_PX = 1e-3, 0.5  # by which a camera that stands still may seem to move: noise of encoders and of localisation
LEAST_SHARED = 0.5  # of the picture of frame 0 that a camera which turned must still see


class NotYetError(InputError):
    """A camera_info or a transform is missing; of live topics it may come later."""


@dataclass(frozen=True)
class Stand:
    """The camera's pose in every frame."""

    poses: np.ndarray  # world_from_camera [m], (T, 4, 4)
    frame: str  # name of the world
    notes: tuple[str, ...] = ()

    @property
    def first(self) -> np.ndarray:
        """In frame 0, (4, 4)."""
        return self.poses[0]


def told_of_world(scene: Scene) -> list[str]:
    """Names of the settings that are given and mean nothing without a world frame."""
    told = {
        "gravity_m_s2": scene.gravity_m_s2 is not None and any(scene.gravity_m_s2),
        "thickness_axis": scene.thickness_axis is not None,
        "clamp_box_m": scene.clamp_box_m is not None,
        "floor_z_m": scene.floor_z_m is not None,
    }
    return [f"scene.{name}" for name, given in told.items() if given]


def stand(transforms: Transforms, frame: str, stamps: Sequence[int], scene: Scene, source: str) -> Stand:
    """Pose of the camera `frame` at stamps [ns] in scene.target_frame, without which in the root of its tree.

    Raises NotYetError where no transform leads there: where target_frame is given, or a setting speaks of the world.
    """
    world = scene.target_frame or transforms.root(frame)
    if world.removeprefix("/") == frame.removeprefix("/"):
        return _camera_is_world(frame, stamps, scene, source, transforms)
    poses = [transforms.between(world, frame, int(stamp)) for stamp in stamps]
    if missing := [stamp for stamp, pose in zip(stamps, poses, strict=True) if pose is None]:
        when = f" at {missing[0] * 1e-9:.3f} s ({len(missing)} of {len(stamps)} frames)" if transforms.between(world, frame) is not None else ""
        raise NotYetError(
            f"{source}: no transform from {named(world)} to the camera's {named(frame)} is known{when}, frames known: {transforms.frames()}; "
            "record or publish /tf and /tf_static (or camera_pose), or name another frame with scene.target_frame"
        )
    return Stand(np.stack(poses), world, () if scene.target_frame or world.rsplit("/", 1)[-1] in FIXED else (_unsure(world),))  # type: ignore[arg-type]


def require_world(camera: Camera, scene: Scene, source: str) -> None:
    """Raises InputError where a clip that was made elsewhere is not in the world that the settings here speak of."""
    world = camera.world_frame_id or camera.frame_id
    if scene.target_frame and scene.target_frame.removeprefix("/") != world.removeprefix("/"):
        raise InputError(f"{source}: the clip is in the world {named(world)}, scene.target_frame is {named(scene.target_frame)}; tell it to ingest_node too")
    if not camera.pose_known and not scene.target_frame and (told := told_of_world(scene)):
        raise InputError(
            f"{source}: {listed(told, 4)} is told in the world, but the clip is in the camera's own frame {named(world)}; tell it to ingest_node too, "
            f"which then waits for a transform, or set scene.target_frame to {named(world)} where it is meant in that frame"
        )


def standing(stand: Stand, camera: Camera, source: str) -> tuple[list[np.ndarray | None], list[str]]:
    """What turns the picture of each frame back to that of frame 0, homographies (3, 3) or None, and notes.

    A camera that turns about its optical centre is compensated. Raises InputError for one that moves by more than STILL_M.
    """
    to_first = np.linalg.inv(stand.first) @ stand.poses
    distance = np.linalg.norm(to_first[:, :3, 3], axis=1).max()
    angle = float(np.arccos(np.clip((np.trace(to_first[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1)).max())
    if distance > STILL_M:
        raise InputError(
            f"{source}: the camera moves by up to {distance:.3g} m and turns by up to {np.degrees(angle):.2g} degrees in {named(stand.frame)} during the clip, "
            f"must stay within {1e3 * STILL_M:g} mm; keep it still, cut the clip, or name a frame that it does not move in with scene.target_frame"
        )
    if angle * camera.focal_px <= STILL_PX:
        return [None] * len(to_first), []
    k = camera.pixel_from_camera
    turns: list[np.ndarray | None] = [k @ pose[:3, :3] @ np.linalg.inv(k) for pose in to_first]
    shared = min(_shared(turn, camera) for turn in turns if turn is not None)
    if shared < LEAST_SHARED:
        raise InputError(
            f"{source}: the camera turns by up to {np.degrees(angle):.3g} degrees during the clip and then sees {shared:.0%} of what it saw in frame 0, "
            f"must see {LEAST_SHARED:.0%}; keep it still, or cut the clip"
        )
    return turns, [f"the camera turns by up to {np.degrees(angle):.2g} degrees during the clip; its images were turned back to frame 0"]


def turned(image: np.ndarray, turn: np.ndarray | None, camera: Camera) -> np.ndarray:
    """A colour or depth image as the camera of frame 0 would have seen it; depth [m] is along its axis, 0 where unknown or not seen."""
    if turn is None:
        return image
    size = camera.width, camera.height
    if image.ndim == 3:
        return cv2.warpPerspective(image, turn, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    v, u = np.mgrid[: camera.height, : camera.width]
    # a homography scales homogeneous pixels by the ratio of the depths along both axes
    ratio = turn[2, 0] * u + turn[2, 1] * v + turn[2, 2]
    return cv2.warpPerspective((image * ratio).astype(np.float32), turn, size, flags=cv2.INTER_NEAREST)


def _camera_is_world(frame: str, stamps: Sequence[int], scene: Scene, source: str, transforms: Transforms) -> Stand:
    poses = np.broadcast_to(np.eye(4), (len(stamps), 4, 4))
    if scene.target_frame:
        return Stand(poses, frame)
    if told := told_of_world(scene):
        raise NotYetError(
            f"{source}: {listed(told, 4)} is told in the world, but no transform of the camera's {named(frame)} is known (frames known: {transforms.frames()}); "
            f"record or publish /tf and /tf_static (or camera_pose), or set scene.target_frame to {named(frame)} where it is meant in the camera's own frame"
        )
    return Stand(poses, frame, (f"no transform of {named(frame)} is known: the camera's own frame is the world",))


def _unsure(world: str) -> str:
    return (
        f"the world is {named(world)}, where the known transforms of the camera end; if that frame moves, record the transforms above it "
        "or name a fixed one with scene.target_frame"
    )


def _shared(turn: np.ndarray, camera: Camera) -> float:
    """Share of the picture of frame 0 that a turned camera still sees."""
    everything = np.full((camera.height, camera.width), 255, np.uint8)
    return float((cv2.warpPerspective(everything, turn, (camera.width, camera.height), flags=cv2.INTER_NEAREST) > 0).mean())
