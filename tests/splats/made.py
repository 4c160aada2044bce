"""A textured, tilted slab in front of a plain wall, seen by a camera in a general pose."""

import numpy as np

from diffphys_ros.types import Camera

WIDTH, HEIGHT = 64, 48
NORMAL = np.array([0.4, -0.2, -1.0])  # of the slab, camera frame
DISTANCE = 0.6  # m


def camera():
    pose = np.eye(4)
    pose[:3, :3] = [[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]]
    pose[:3, 3] = [0.2, -0.1, 0.4]
    return Camera(np.array([[70.0, 0, 31.2], [0, 72.0, 23.9], [0, 0, 1]]), pose, WIDTH, HEIGHT)


def mask():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return ((x - 31) / 22) ** 2 + ((y - 24) / 15) ** 2 < 1


def image():
    """uint8 (H, W, 3): stripes with a hard edge and a smooth shade."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    stripes = (x // 7 + y // 9) % 2
    object_color = np.stack([90 + 110 * stripes, 60 + 2 * x, 200 - 3 * y], -1)
    return np.where(mask()[..., None], object_color, (120, 120, 125)).astype(np.uint8)


def depth():
    """Depth of the slab's plane [m] in every pixel of the mask, 0 elsewhere."""
    cam = camera()
    rays = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(float)
    local = cam.rays(rays) @ cam.world_from_camera[:3, :3]
    plane = NORMAL[2] * DISTANCE / (local @ NORMAL)
    return np.where(mask(), plane, 0).astype(np.float32)
