"""Small random scenes for the renderer's tests."""

import numpy as np
import torch

from diffphys_ros.types import Camera

NAMES = ("mean", "rotation", "scale", "opacity", "color")


def oblique_camera(width=40, height=30):
    """A camera with skew, unequal focal lengths and a general pose."""
    angle = 0.4
    pose = np.eye(4)
    pose[:3, :3] = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]) @ np.array(
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    )
    pose[:3, 3] = [0.3, -0.2, 0.5]
    intrinsics = np.array([[1.2 * width, 0.7, width / 2 - 0.3], [0, 1.3 * width, height / 2 + 0.4], [0, 0, 1]])
    return Camera(intrinsics, pose, width, height)


def random_gaussians(camera, count, seed=0, opacity=(0.2, 0.95), size_px=(0.5, 4.0)):
    """Float64 tensors: overlapping anisotropic Gaussians over the whole image and beyond its border."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([-4, -4], [camera.width + 4, camera.height + 4], (count, 2))
    depth = rng.uniform(0.8, 1.4, count)
    values = (
        camera.backproject(pixels, depth),
        rng.normal(size=(count, 4)),
        rng.uniform(*size_px, (count, 3)) / camera.focal_px,
        rng.uniform(*opacity, count),
        rng.random((count, 3)),
    )
    return [torch.tensor(v, requires_grad=True) for v in values]


def random_coefficients(count, degree, seed=0):
    """Float64 coefficients of spherical harmonics (count, K, 3); some of their colours fall below 0."""
    return torch.tensor(np.random.default_rng(seed).normal(0, 0.4, (count, (degree + 1) ** 2, 3)), requires_grad=True)


def to_float32(tensors):
    """Leaves for the renderer under test."""
    return [t.detach().float().requires_grad_() for t in tensors]
