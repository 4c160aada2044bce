"""Gaussians that ride on particles: a sheet of them in a block that bends and turns."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros.inverse import carried as module
from diffphys_ros.inverse.carried import CarriedGaussians

from .test_refine import camera, sheet

FRAMES = 10
BACKGROUND = np.full((48, 64, 3), 77, np.uint8)


@pytest.fixture(scope="module")
def trajectory():
    """Particles (T, P, 3) [m], world."""
    block = np.stack(np.meshgrid(*(np.linspace(-e, e, n) for e, n in ((0.07, 8), (0.05, 6), (0.01, 3))), indexing="ij"), -1).reshape(-1, 3)
    block += np.random.default_rng(0).normal(0, 1e-3, block.shape)  # no two particles are equally near to a Gaussian
    bent = [block + [0, 0, 1] * (0.3 * k * block[:, :1] ** 2) for k in range(FRAMES)]
    return np.stack([Rotation.from_rotvec([0, 0.04 * k, 0.02 * k]).apply(x) for k, x in enumerate(bent)])


@pytest.fixture(scope="module")
def carried(trajectory):
    return CarriedGaussians.of(sheet(), trajectory[0], camera(), BACKGROUND, device="cpu")


def test_a_clip_is_the_same_in_whatever_frame_its_particles_are_given(carried, trajectory):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec([0.3, 0.2, -0.4]).as_matrix(), [0.1, 0.05, 0.02]
    body = (trajectory - pose[:3, 3]) @ pose[:3, :3]
    own = CarriedGaussians.of(sheet(), body[0], camera(), BACKGROUND, world_from_particles=pose, device="cpu")
    world, placed = carried.clip(trajectory).astype(float), own.clip(body).astype(float)
    assert world.shape == (FRAMES, 48, 64, 3)
    assert np.abs(world - world[0]).mean() > 5
    assert np.abs(world - placed).mean() < 0.3  # grey levels; which of two Gaussians of a flat sheet covers the other is rounding


@pytest.mark.parametrize("frames", [1, 3])
def test_a_frame_does_not_depend_on_those_that_are_rendered_with_it(carried, trajectory, monkeypatch, frames):
    whole = carried.clip(trajectory)
    monkeypatch.setitem(module.AT_ONCE, "cpu", frames * len(carried.mean))
    assert carried.spans(FRAMES) == [slice(first, first + frames) for first in range(0, FRAMES, frames)]
    np.testing.assert_array_equal(carried.clip(trajectory), whole)


def test_the_motion_for_a_fit_leads_to_where_the_gaussians_are_drawn(carried, trajectory):
    x = torch.as_tensor(trajectory, dtype=torch.float32)
    mean, rotation = carried.moved(x[[4]], x[0], None)
    shift, turn = carried.motion(trajectory[4], trajectory[0])(carried.mean)
    np.testing.assert_allclose(carried.mean + shift, mean[0], atol=1e-7)
    np.testing.assert_allclose(turn, rotation[0], atol=1e-6)  # those of the sheet stand upright in frame 0


def test_gaussians_turn_as_the_particles_that_carry_them_are_turned(carried, trajectory):
    x0 = torch.as_tensor(trajectory[0], dtype=torch.float32)
    turn = torch.as_tensor(Rotation.from_rotvec([0.2, 0.5, -0.3]).as_matrix(), dtype=torch.float32)
    _, rotation = carried.moved((x0 @ turn.T)[None], x0, turn.expand(1, len(x0), 3, 3))
    before, after = (Rotation.from_quat(q[:, [1, 2, 3, 0]].numpy()) for q in (carried.rotation, rotation[0]))
    np.testing.assert_allclose(after.as_matrix(), turn.numpy() @ before.as_matrix(), atol=1e-5)


def test_the_motion_of_other_gaussians_is_refused(carried, trajectory):
    with pytest.raises(AssertionError, match="other Gaussians"):
        carried.motion(trajectory[4], trajectory[0])(carried.mean + 0.01)
