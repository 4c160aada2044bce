"""What the tracks say about the motion, in the body frame, and how far a predicted motion is from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ..types import Body, Camera, Tracks


@dataclass(frozen=True)
class TrackTarget:
    """Observed displacements of M surface points from frame 0.

    With depth they are compared in space. Without, a predicted point is projected and compared across the line of sight,
    in metres at its own depth, so that both kinds have one unit.
    """

    points0: torch.Tensor  # body frame at frame 0 [m], (M, 3)
    observed: torch.Tensor  # displacement [m], (T, M, 3), or scaled pixel displacement [m], (T, M, 2)
    weight: torch.Tensor  # 1 where valid, (T, M)
    mean_square: float  # of the observed displacements [m^2]: the misfit of the frozen first frame
    camera_from_body: torch.Tensor | None  # (3, 4), only without depth
    focal: torch.Tensor | None  # depth of frame 0 over the focal length [m/px], (M,)
    pixel_from_camera: torch.Tensor | None  # (3, 3)
    normals: torch.Tensor | None = None  # in the picture, along which alone the points of an outline are seen to move, (M, 2)

    @classmethod
    def of(cls, tracks: Tracks, body: Body, camera: Camera, *, dtype: torch.dtype, device: str) -> TrackTarget:
        """Target of a clip's tracks."""
        as_tensor: dict[str, Any] = {"dtype": dtype, "device": device}
        points = body.to_body(tracks.points)
        weight = tracks.valid.astype(float)
        if tracks.has_depth:
            observed = np.where(tracks.valid[..., None], points - points[:1], 0.0)
            extra: tuple = (None, None, None)
        else:
            _, depth = camera.project(tracks.points[0])
            scale = depth / camera.focal_px
            observed = np.where(tracks.valid[..., None], (tracks.pixels - tracks.pixels[:1]) * scale[:, None], 0.0)
            extra = (_camera_from_body(camera, body), scale, camera.pixel_from_camera)
        mean_square = float((observed**2).sum() / weight.sum())
        extra = (*extra, None if tracks.normals is None else camera.normals_in_picture(tracks.normals))
        tensors = [None if a is None else torch.as_tensor(a, **as_tensor) for a in extra]
        return cls(torch.as_tensor(points[0], **as_tensor), torch.as_tensor(observed, **as_tensor), torch.as_tensor(weight, **as_tensor), mean_square, *tensors)

    @property
    def rest_points(self) -> np.ndarray:
        """points0 in double precision, (M, 3)."""
        return self.points0.cpu().double().numpy()

    def residual(self, displacement: torch.Tensor) -> torch.Tensor:
        """Predicted minus observed [m], (T, M, 3 or 2), of displacements from frame 0 (T, M, 3), body frame; 0 where not valid."""
        return (self._seen(displacement) - self.observed) * self.weight[..., None]

    def loss(self, displacement: torch.Tensor) -> torch.Tensor:
        """Half the mean squared misfit over the mean squared motion: 0.5 for the frozen first frame."""
        return 0.5 * self.residual(displacement).square().sum() / (self.weight.sum() * self.mean_square)

    def rms(self, displacement: torch.Tensor) -> float:
        """Root mean squared misfit of one coordinate [m]."""
        residual = self.residual(displacement)
        return float((residual.square().sum() / (self.weight.sum() * residual.shape[-1])).sqrt())

    def _seen(self, displacement: torch.Tensor) -> torch.Tensor:
        if self.camera_from_body is None or self.pixel_from_camera is None or self.focal is None:
            return displacement
        moved = (self._pixels(self.points0 + displacement) - self._pixels(self.points0)) * self.focal[:, None]
        return moved if self.normals is None else (moved * self.normals).sum(-1, keepdim=True) * self.normals

    def _pixels(self, points: torch.Tensor) -> torch.Tensor:
        assert self.camera_from_body is not None
        assert self.pixel_from_camera is not None
        local = points @ self.camera_from_body[:, :3].T + self.camera_from_body[:, 3]
        homogeneous = local @ self.pixel_from_camera.T
        return homogeneous[..., :2] / homogeneous[..., 2:]


def _camera_from_body(camera: Camera, body: Body) -> np.ndarray:
    camera_from_world = np.linalg.inv(camera.world_from_camera)
    return (camera_from_world @ body.world_from_body)[:3]


def acceleration_scale(tracks: Tracks, period_s: float) -> float:
    """Root mean squared second difference of the tracked displacements over period^2 [m/s^2], noise taken off: the size
    of the accelerations in the clip, unit of the unknown forces."""
    square, held = _squared_second_differences(tracks.points, tracks.valid)
    if not held.any():
        return 1.0
    mean_square = float(square[held].mean()) - 18.0 * tracks.noise_m**2
    return float(np.sqrt(max(mean_square, 1e-12)) / period_s**2)


def displacement_scale(tracks: Tracks) -> float:
    """Root mean square of the tracked displacements from frame 0 [m], noise taken off."""
    moved = (tracks.points - tracks.points[:1])[tracks.valid]
    mean_square = float((moved**2).sum(-1).mean()) - 6.0 * tracks.noise_m**2
    return float(np.sqrt(max(mean_square, 1e-12)))


def liveliest_acceleration(tracks: Tracks, period_s: float) -> float:
    """That of the frame that needs the most, root mean square over the points [m/s^2], of a body at rest until frame 0: a constant one that makes
    up for the second difference of the displacements by the end of the frame in which it begins to act."""
    points, valid = np.concatenate([tracks.points[:1], tracks.points]), np.concatenate([tracks.valid[:1], tracks.valid])
    square, held = _squared_second_differences(points, valid)
    seen = held.sum(1) > 0
    mean = (square * held).sum(1)[seen] / held.sum(1)[seen]
    return 2 * float(np.sqrt(max(mean.max(initial=0.0), 1e-12))) / period_s**2


def _squared_second_differences(points: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared length [m^2] of the second difference of points (T, M, 3) about each frame but the first and the last, (T - 2, M), and where all three are valid."""
    square = ((points[2:] - 2 * points[1:-1] + points[:-2]) ** 2).sum(-1)
    return square, valid[2:] & valid[1:-1] & valid[:-2]
