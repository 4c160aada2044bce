"""Rotations in torch, differentiable: unit quaternions wxyz and matrices."""

from __future__ import annotations

from typing import Any

import torch

POLAR_STEPS = 8  # of Newton's iteration, quadratic from any stretch below about 3


def product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Product a b (..., 4): the turn b, then the turn a."""
    aw, ax, ay, az = a.unbind(-1)
    bw, bx, by, bz = b.unbind(-1)
    return torch.stack(
        [aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw],
        -1,
    )


def rotated(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """Vectors (..., 3) turned by unit quaternions (..., 4)."""
    twice = 2 * torch.linalg.cross(q[..., 1:], v)
    return v + q[..., :1] * twice + torch.linalg.cross(q[..., 1:], twice)


def quaternion_of(rotation: torch.Tensor) -> torch.Tensor:
    """Unit quaternions (..., 4) of rotations (..., 3, 3): the best conditioned of the four forms, per element."""
    r = rotation
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 1, 0] + r[..., 0, 1], r[..., 0, 2] + r[..., 2, 0], r[..., 2, 1] + r[..., 1, 2]
    square = torch.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], -1)  # 4 q_i^2
    rows = torch.stack(
        [
            torch.stack([square[..., 0], wx, wy, wz], -1),
            torch.stack([wx, square[..., 1], xy, xz], -1),
            torch.stack([wy, xy, square[..., 2], yz], -1),
            torch.stack([wz, xz, yz, square[..., 3]], -1),
        ],
        -2,
    )
    best = square.argmax(-1)[..., None, None].expand(*square.shape[:-1], 1, 4)
    return torch.nn.functional.normalize(rows.gather(-2, best)[..., 0, :], dim=-1)


def polar_rotation(matrix: torch.Tensor) -> torch.Tensor:
    """The rotation of the polar decomposition R S of matrices (..., 3, 3), by Newton's iteration (Higham 1986): smooth where an SVD's
    gradient is not."""
    return _Polar.apply(matrix)


class _Polar(torch.autograd.Function):
    """The derivative is that of R^T dF - dF^T R = Omega S + S Omega, the turn dR = R Omega: no step of the iteration is kept for it."""

    @staticmethod
    def forward(ctx: Any, matrix: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        rotation = matrix.detach()
        for _ in range(POLAR_STEPS):
            rotation = 0.5 * (rotation + torch.linalg.inv(rotation).transpose(-1, -2))
        ctx.save_for_backward(matrix, rotation)
        return rotation

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, cotangent: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        matrix, rotation = (t.detach() for t in ctx.saved_tensors)
        stretch = rotation.transpose(-1, -2) @ matrix
        resists = stretch.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None] * torch.eye(3, dtype=matrix.dtype, device=matrix.device) - stretch
        turn = torch.linalg.solve(resists, _axial(rotation.transpose(-1, -2) @ cotangent))
        return torch.linalg.cross(rotation, turn[..., None, :].expand_as(rotation))


def _axial(matrix: torch.Tensor) -> torch.Tensor:
    """The vector (..., 3) of the skew part of matrices (..., 3, 3), twice."""
    twice = matrix - matrix.transpose(-1, -2)
    return torch.stack([twice[..., 2, 1], twice[..., 0, 2], twice[..., 1, 0]], -1)
