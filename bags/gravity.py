"""Gravity in the world frame, where something measured with the clip tells it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from diffphys_ros.bags.transforms import Transforms
from diffphys_ros.bags.world import Stand
from diffphys_ros.config import Scene
from diffphys_ros.errors import named

STANDARD_M_S2 = 9.80665
OFF_M_S2 = 0.8  # by which the mean of an accelerometer at rest may miss it: bias and scale of those in cameras
REST_M_S2 = 0.5  # standard deviation of an accelerometer that rests
LEAST_SAMPLES = 10
DISAGREE_DEG = 10.0  # between what is told and what is measured, from which on it is said
NOT_MEASURED = -1  # first entry of a covariance, of a quantity that an Imu does not measure (REP-145)


class Imu(NamedTuple):
    """What was heard of a topic of sensor_msgs/Imu: specific force, which at rest points up."""

    topic: str
    messages: Sequence[Any]


def gravity_of(imu: Imu | None, stand: Stand, camera_frame: str, stamp: int, transforms: Transforms, scene: Scene) -> tuple[np.ndarray | None, list[str]]:
    """Gravity [m/s^2] (3,) in the world for a scene that does not tell it, and notes; None where nothing measures it.

    An Imu at rest goes before the z axis of scene.target_frame, which points up by REP-103 unless the frame is the camera's.
    """
    measured, notes = (None, []) if imu is None else _of_imu(imu, stand, camera_frame, stamp, transforms)
    if scene.gravity_m_s2 is not None:
        return None, [*notes, *_disagreement(np.array(scene.gravity_m_s2, float), measured)]
    if measured is not None:
        return measured, [*notes, f"gravity is ({', '.join(f'{v:.2f}' for v in measured)}) m/s^2 in {named(stand.frame)}, as the IMU of {named(imu.topic if imu else '')} has it"]
    if scene.target_frame and stand.frame.removeprefix("/") != camera_frame.removeprefix("/"):
        return np.array([0.0, 0.0, -STANDARD_M_S2]), [*notes, f"gravity is {STANDARD_M_S2:.2f} m/s^2 against the z axis of scene.target_frame {named(stand.frame)}"]
    return None, [*notes, "gravity is not known from an IMU or scene.target_frame; without scene.gravity_m_s2 none is assumed"]


def _of_imu(imu: Imu, stand: Stand, camera_frame: str, stamp: int, transforms: Transforms) -> tuple[np.ndarray | None, list[str]]:
    frame, force = _specific_force(imu.messages)
    where = f"gravity is not taken from the IMU of {named(imu.topic)}: "
    if len(force) < LEAST_SAMPLES:
        return None, [f"{where}{len(force)} messages with a linear acceleration came, at least {LEAST_SAMPLES} are needed"]
    mean, sd = force.mean(0), float(np.linalg.norm(force.std(0)))
    if sd > REST_M_S2:
        return None, [f"{where}it does not rest (its acceleration varies by {sd:.2g} m/s^2, at most {REST_M_S2:g} may be)"]
    if abs(np.linalg.norm(mean) - STANDARD_M_S2) > OFF_M_S2:
        return None, [f"{where}it measures {np.linalg.norm(mean):.3g} m/s^2 at rest, must be within {OFF_M_S2:g} of {STANDARD_M_S2:.2f}; calibrate it, or have it keep gravity"]
    camera_from_imu = transforms.between(camera_frame, frame, stamp) if frame else np.eye(4)
    if camera_from_imu is None:
        return None, [f"{where}no transform from the camera's {named(camera_frame)} to its {named(frame)} is known"]
    down = -mean / np.linalg.norm(mean)  # its direction alone: the scale of such sensors is off by percents
    return STANDARD_M_S2 * stand.first[:3, :3] @ camera_from_imu[:3, :3] @ down, []


def _specific_force(messages: Sequence[Any]) -> tuple[str, np.ndarray]:
    """Frame and linear accelerations (N, 3) [m/s^2] of the messages that have finite ones."""
    some = [m for m in messages if m.linear_acceleration_covariance[0] != NOT_MEASURED]
    force = np.array([(m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z) for m in some], float).reshape(-1, 3)
    return (some[0].header.frame_id if some else ""), force[np.isfinite(force).all(1)]


def _disagreement(told: np.ndarray, measured: np.ndarray | None) -> list[str]:
    if measured is None or not told.any():
        return []
    angle = np.degrees(np.arccos(np.clip(told @ measured / np.linalg.norm(told) / np.linalg.norm(measured), -1, 1)))
    return [f"scene.gravity_m_s2 points {angle:.0f} degrees away from what the IMU measures; the setting is used"] if angle > DISAGREE_DEG else []
