"""Poses of a handle between frames."""

from __future__ import annotations

import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.simulate.handle import node_motion, se3_log, substep_poses, twist_matrix

SUBSTEPS = 40


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def exp(twist: torch.Tensor) -> torch.Tensor:
    return torch.linalg.matrix_exp(twist_matrix(twist))


def wandering(frames: int = 6, *, size: float = 0.15) -> torch.Tensor:
    """Poses (frames, 4, 4) of a smooth random motion."""
    time = torch.linspace(0, 1, frames).double()[:, None]
    first, second = size * draw(2, 6)
    return exp(torch.sin(4 * time) * first + time**2 * second)


def test_the_logarithm_undoes_the_exponential_and_is_differentiable_also_at_rest():
    twist = 0.6 * draw(5, 6)
    torch.testing.assert_close(se3_log(exp(twist)), twist, rtol=0, atol=1e-14)
    for start in (twist, torch.zeros(1, 6).double()):
        assert torch.autograd.gradcheck(lambda t: se3_log(exp(t)), start.clone().requires_grad_())


def test_a_motion_of_constant_twist_is_kept():
    twist = 0.5 * draw(6)
    frames = torch.stack([exp(k * twist) for k in range(4)])
    expected = torch.stack([torch.stack([exp((k + n / SUBSTEPS) * twist) for n in range(SUBSTEPS + 1)]) for k in range(3)])
    torch.testing.assert_close(substep_poses(frames, SUBSTEPS), expected, rtol=0, atol=1e-10)


def test_substep_poses_pass_through_the_frames_without_a_jump_in_velocity():
    poses = wandering()
    fine = substep_poses(poses, SUBSTEPS)
    torch.testing.assert_close(fine[:, 0], poses[:-1], rtol=0, atol=1e-14)
    torch.testing.assert_close(fine[:, -1], poses[1:], rtol=0, atol=1e-14)
    velocity = torch.stack([node_motion(frame, 1 / SUBSTEPS)[0] for frame in fine])
    jumps = (velocity[1:, 0] - velocity[:-1, -1]).abs().amax((1, 2))
    inside = (velocity[:, 1:] - velocity[:, :-1]).abs().amax((1, 2, 3)).max()
    assert jumps.max() < 1.5 * inside, "the step from frame to frame must be one of the steps inside frames"
    assert jumps.max() < 0.1 * velocity.abs().max()


def test_a_substep_of_node_motion_is_the_rigid_motion_itself():
    fine = substep_poses(wandering(), SUBSTEPS)[2]
    dt = 1e-3
    velocity, handle_from_body = node_motion(fine, dt)
    held = draw(9, 3, seed=1)  # in the handle's frame
    for n in (0, 17, SUBSTEPS - 1):
        now, then = (held @ fine[i, :3, :3].T + fine[i, :3, 3] for i in (n, n + 1))
        torch.testing.assert_close(now + dt * (now @ velocity[n, :, :3].T + velocity[n, :, 3]), then, rtol=0, atol=1e-13)
        torch.testing.assert_close(now @ handle_from_body[n, :, :3].T + handle_from_body[n, :, 3], held, rtol=0, atol=1e-13)


def test_a_handle_that_stands_makes_nothing_creep_though_its_pose_is_rounded():
    pose = exp(0.7 * draw(6)).float()
    fine = substep_poses(pose.expand(4, 4, 4), SUBSTEPS)
    assert (fine - pose).abs().max() < 1e-12
    assert node_motion(fine[1], 1e-4)[0].abs().max() < 1e-10


def test_node_motion_is_differentiable_in_the_twists_between_frames():
    weight = draw(3, 3, 4, seed=2)

    def total(twists: torch.Tensor) -> torch.Tensor:
        poses = [torch.eye(4).double()]
        for twist in twists:
            poses.append(poses[-1] @ exp(twist))
        frames = substep_poses(torch.stack(poses), 3)
        return torch.stack([(node_motion(frame, 0.1)[0] * weight).sum() for frame in frames])

    assert torch.autograd.gradcheck(total, (0.2 * draw(3, 6)).requires_grad_())


@pytest.mark.parametrize(("poses", "words"), [
    (torch.eye(4), "two or more frames"),
    (torch.stack([torch.eye(4), 2 * torch.eye(4)]), "not a rigid transform"),
    (torch.stack([torch.eye(4), torch.diag(torch.tensor([-1.0, -1, 1, 1]))]), "154 degrees"),
])  # fmt: skip
def test_poses_that_say_nothing_are_refused_in_a_sentence(poses, words):
    with pytest.raises(InputError, match=words):
        substep_poses(poses, SUBSTEPS)
