"""Pruning and splitting."""

import numpy as np
import pytest
import torch

from diffphys_ros.splats.density import prune_and_split
from diffphys_ros.splats.discs import discs_of, gaussians
from diffphys_ros.splats.seed import gather_blocks, surface_at

from . import made


@pytest.fixture
def discs():
    blocks = gather_blocks(made.image() / 255, made.mask(), 60)
    return discs_of(blocks, surface_at(blocks.centre, made.depth(), made.mask(), made.camera()), "cpu")


def test_the_discs_with_the_largest_error_are_split_until_the_count(discs):
    error = torch.arange(len(discs), dtype=torch.float32)
    grown = prune_and_split(discs, error, torch.ones(len(discs)), len(discs) + 5)
    assert len(grown) == len(discs) + 5
    assert torch.equal(grown.pixel[: len(discs) - 5], discs.pixel[:-5])


def test_the_halves_lie_either_side_of_their_disc_along_its_longer_axis(discs):
    camera, one = made.camera(), discs.pick(torch.tensor([7]))
    one.log_scale[0, 1] += 1.0
    one.angle[0] = 0.6
    halves = prune_and_split(one, torch.ones(1), torch.ones(1), 2)
    np.testing.assert_allclose(halves.pixel.mean(0), one.pixel[0], rtol=1e-5)
    mean, rotation, scale, _, _ = gaussians(one, camera)
    w, x, y, z = rotation[0].tolist()
    second_axis = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    ends = camera.project(mean.numpy() + np.array([[1], [-1]]) * 1e-4 * second_axis)[0]
    along, split = ends[0] - ends[1], (halves.pixel[0] - halves.pixel[1]).numpy()
    assert abs(along @ split) / np.linalg.norm(along) / np.linalg.norm(split) == pytest.approx(1, abs=1e-3)
    assert float(halves.log_scale[0, 1].exp()) == pytest.approx(float(scale[0, 1]) / 1.6, rel=1e-5)


def test_transparent_and_hidden_discs_go(discs):
    discs.logit[3] = -5
    cover = torch.ones(len(discs))
    cover[8] = 0
    left = prune_and_split(discs, torch.ones(len(discs)), cover, len(discs) - 2)
    kept = [i for i in range(len(discs)) if i not in (3, 8)]
    assert torch.equal(left.pixel, discs.pixel[kept])
