"""Motion of a handle between video frames: poses at frames -> poses at substeps -> velocities of the nodes it holds.

Poses are rigid transforms body_from_handle; everything here is torch in double precision and differentiable, so a
handle's path can be learnt. Twists are (angular, linear) in the handle's own frame.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import InputError

MOST_TURN_COSINE = -0.9  # frames further apart than 154 degrees do not say which way the handle turned


def substep_poses(poses: Tensor, substeps: int) -> Tensor:
    """Poses (T - 1, substeps + 1, 4, 4) at the substep boundaries of every frame, from poses (T, 4, 4) at the frames.

    Cubic Hermite interpolation in the logarithm of the motion since the frame's start, with the mean of the neighbouring
    twists as slope at each frame: a handle's velocity does not jump at frames, so shaking it does not ring the body. A
    motion of constant twist is kept exactly. Raises InputError.
    """
    _check(poses)
    poses = poses.double()
    along = se3_log(torch.linalg.solve(poses[:-1], poses[1:]))
    slope = torch.cat([along[:1], (along[:-1] + along[1:]) / 2, along[-1:]])
    arrive = _slope_of_log(along, slope[1:])
    s = torch.linspace(0, 1, substeps + 1, dtype=torch.float64, device=poses.device)[:, None]
    a, b, c = s * (1 - s) ** 2, s**2 * (3 - 2 * s), s**2 * (s - 1)
    path = a * slope[:-1, None] + b * along[:, None] + c * arrive[:, None]
    return poses[:-1, None] @ torch.linalg.matrix_exp(twist_matrix(path))


def node_motion(poses: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    """What the kernels need of poses (K + 1, ..., 4, 4) at substep boundaries `dt` [s] apart: affine velocities (K, ..., 3, 4) such
    that x + dt v(x) is the rigid motion itself (v + omega x r to first order; held material neither drifts nor
    strains), and handle_from_body (K, ..., 3, 4), which says what is held and carries no gradient."""
    poses = poses.double()
    there, _ = torch.linalg.inv_ex(poses[:-1])  # not the transpose: a rounded pose must not make what stands still creep
    step = poses[1:] @ there - torch.eye(4, dtype=torch.float64, device=poses.device)
    return step[..., :3, :] / dt, there[..., :3, :].detach()


def twist_matrix(twist: Tensor) -> Tensor:
    """Matrices (..., 4, 4) whose exponential is the motion along the twists (..., 6)."""
    upper = torch.cat([cross_matrix(twist[..., :3]), twist[..., 3:, None]], -1)
    return torch.cat([upper, torch.zeros_like(upper[..., :1, :])], -2)


def cross_matrix(a: Tensor) -> Tensor:
    """Matrices (..., 3, 3) with cross_matrix(a) b = a x b."""
    x, y, z = a.unbind(-1)
    o = torch.zeros_like(x)
    return torch.stack([o, -z, y, z, o, -x, -y, x, o], -1).unflatten(-1, (3, 3))


def se3_log(motion: Tensor) -> Tensor:
    """Twists (..., 6) whose exponential is the rigid motion (..., 4, 4), for turns below 154 degrees. Raises InputError."""
    turn = motion[..., :3, :3]
    skew, cosine = (turn - turn.mT) / 2, (turn.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
    if cosine.min() < MOST_TURN_COSINE:
        raise InputError("handle: it turns by more than 154 degrees between two frames; give its poses at more frames")
    axis = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)  # times the sine
    angular = axis * _angle_over_sine(axis.square().sum(-1), cosine)[..., None]
    zero = torch.zeros_like(turn)
    block = torch.cat([torch.cat([cross_matrix(angular), torch.eye(3).to(turn).expand_as(turn)], -1), torch.cat([zero, zero], -1)], -2)
    mean_turn = torch.linalg.matrix_exp(block)[..., :3, 3:]  # integral of the rotation along the way
    return torch.cat([angular, torch.linalg.solve(mean_turn, motion[..., :3, 3])], -1)


def _angle_over_sine(sine_squared: Tensor, cosine: Tensor) -> Tensor:
    small = sine_squared < 1e-8
    sine = torch.sqrt(torch.where(small, torch.ones_like(sine_squared), sine_squared))
    return torch.where(small, 1 + sine_squared / 6, torch.atan2(sine, cosine) / sine)  # the root has no derivative at zero


def _slope_of_log(log: Tensor, twist: Tensor) -> Tensor:
    """Rate of a logarithm (..., 6) that moves with a body twist (..., 6): inverse right Jacobian, to |log|^4 / 720."""
    once = _bracket(log, twist)
    return twist + once / 2 + _bracket(log, once) / 12


def _bracket(a: Tensor, b: Tensor) -> Tensor:
    (w, v), (u, r) = a.split(3, -1), b.split(3, -1)
    cross = torch.linalg.cross
    return torch.cat([cross(w, u), cross(w, r) + cross(v, u)], -1)


def _check(poses: Tensor) -> None:
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or len(poses) < 2:
        raise InputError(f"handle: poses have shape {tuple(poses.shape)}; give one rigid transform (4, 4) for each of two or more frames")
    turn = poses[:, :3, :3].detach().double()
    if not torch.allclose(turn @ turn.mT, torch.eye(3).to(turn).expand_as(turn), atol=1e-3):
        raise InputError("handle: a pose is not a rigid transform (its rotation is more than 1e-3 from orthogonal); normalise the poses")
