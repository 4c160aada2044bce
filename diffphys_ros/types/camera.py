"""What sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """An undistorted pinhole camera."""

    pixel_from_camera: np.ndarray  # intrinsic matrix, px, shape (3, 3)
    world_from_camera: np.ndarray  # rigid transform, m, shape (4, 4)
    width: int  # px
    height: int  # px
    frame_id: str = "camera_optical_frame"  # name of the camera frame
    world_frame_id: str = ""  # name of the world frame; equal to frame_id where no transform is known
    lens_told: bool = True  # whether the intrinsic matrix was measured or told; false: assumed

    @property
    def focal_px(self) -> float:
        """Horizontal focal length [px]."""
        return float(self.pixel_from_camera[0, 0])

    @property
    def position(self) -> np.ndarray:
        """Optical centre in the world [m], shape (3,)."""
        return self.world_from_camera[:3, 3]

    @property
    def pose_known(self) -> bool:
        """Whether the world frame is another than the camera's."""
        return bool(self.world_frame_id) and self.world_frame_id != self.frame_id

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) [px] and depths (...) [m] of world points (..., 3) [m]."""
        local = (points - self.position) @ self.world_from_camera[:3, :3]
        homogeneous = local @ self.pixel_from_camera.T
        return homogeneous[..., :2] / homogeneous[..., 2:], local[..., 2]

    def backproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """World points (..., 3) [m] of pixels (..., 2) [px] at depths (...) [m]."""
        return self.position + self.rays(pixels) * depth[..., None]

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """World directions (..., 3) of pixels (..., 2) [px], scaled to unit depth."""
        k = self.pixel_from_camera
        y = (pixels[..., 1] - k[1, 2]) / k[1, 1]
        x = (pixels[..., 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
        return np.stack([x, y, np.ones_like(x)], -1) @ self.world_from_camera[:3, :3].T

    def gradients(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """How far the pixels of world points (..., 3) move along normals (..., 2) in the picture when the points move: gradients (..., 3) [px/m], world.
        Off the optical axis a point that comes nearer moves outwards."""
        local = (points - self.position) @ self.world_from_camera[:3, :3]
        across = normals @ self.pixel_from_camera[:2, :2]
        nearer = -(across * local[..., :2]).sum(-1) / local[..., 2]
        return np.concatenate([across, nearer[..., None]], -1) / local[..., 2:] @ self.world_from_camera[:3, :3].T

    def normals_in_picture(self, gradients: np.ndarray) -> np.ndarray:
        """The unit normals (..., 2) of which gradients (..., 3) were made, whatever their lengths."""
        normals = (gradients @ self.world_from_camera[:3, :2]) @ np.linalg.inv(self.pixel_from_camera[:2, :2])
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12))
