"""Camera and pictures of the sample."""

from __future__ import annotations

import math

import cv2
import mujoco
import numpy as np

from diffphys_ros.types import Camera
from tools.sample_maker.body import IMAGE_SIZE, Body
from tools.sample_maker.messages import FRAME_ID, WORLD


def aim(body: Body, positions: np.ndarray) -> Camera:
    """Camera in the drawn direction from which the whole motion (T, N, 3) [m] fills the wanted share of the image."""
    points, bar = positions.reshape(-1, 3), body.bar
    target, distance, size = (points.min(0) + points.max(0)) / 2, 1.0, np.array(IMAGE_SIZE)
    for _ in range(30):
        camera = _look(bar.camera_direction, target, distance, bar.fovy)
        pixels, _ = camera.project(points)
        extent = (np.ptp(pixels, axis=0) / size).max()
        off = (pixels.max(0) + pixels.min(0)) / 2 - (size - 1) / 2
        target = target + camera.world_from_camera[:3, :2] @ off * distance / camera.focal_px
        distance *= extent / bar.fill
    return camera


def _look(back: np.ndarray, target: np.ndarray, distance: float, fovy: float) -> Camera:
    right = np.cross(-back, [0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(-back, right), -back], 1)
    pose[:3, 3] = target + distance * back
    width, height = IMAGE_SIZE
    focal = height / 2 / math.tan(math.radians(fovy) / 2)
    intrinsics = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    return Camera(intrinsics, pose, width, height, FRAME_ID, WORLD)


def film(body: Body, camera: Camera, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour (T, H, W, 3) uint8, depth (T, H, W) [m] and object mask (T, H, W) of simulator states."""
    model, data = body.model, body.data
    rotation = np.zeros(4)
    mujoco.mju_mat2Quat(rotation, (camera.world_from_camera[:3, :3] * [1, -1, -1]).ravel())  # MuJoCo: y up, z back
    model.cam_pos[0], model.cam_quat[0] = camera.position, rotation
    colour, depth = mujoco.Renderer(model, 2 * camera.height, 2 * camera.width), mujoco.Renderer(model, camera.height, camera.width)
    depth.enable_depth_rendering()
    shown, hidden = mujoco.MjvOption(), mujoco.MjvOption()
    for name in ("VERT", "EDGE", "FACE"):
        shown.flags[getattr(mujoco.mjtVisFlag, f"mjVIS_FLEX{name}")] = 0
    shown.flags[mujoco.mjtVisFlag.mjVIS_FLEXSKIN] = 1
    hidden.flexgroup[:] = 0
    data.qpos[:] = states[0]
    mujoco.mj_forward(model, data)
    depth.update_scene(data, "camera", hidden)
    empty = depth.render().copy()
    images, depths = [], []
    for state in states:
        data.qpos[:], data.qvel[:] = state, 0
        mujoco.mj_forward(model, data)
        colour.update_scene(data, "camera", shown)
        images.append(cv2.resize(colour.render(), (camera.width, camera.height), interpolation=cv2.INTER_AREA))
        depth.update_scene(data, "camera", shown)
        depths.append(depth.render().copy())
    return np.array(images), np.array(depths), np.array(depths) < empty - 2e-4
