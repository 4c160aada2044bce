"""Pruning and doubling, of discs and of free Gaussians."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros.splats.density import Shown, prune_and_double
from diffphys_ros.splats.discs import discs_of, gaussians
from diffphys_ros.splats.ellipsoids import to_splats
from diffphys_ros.splats.seed import gather_blocks, surface_at

from . import made


@pytest.fixture
def discs():
    blocks = gather_blocks(made.image() / 255, made.mask(), 60)
    return discs_of(blocks, surface_at(blocks.centre, made.depth(), made.mask(), made.camera()), "cpu")


def grow(what, count, error=None, cover=None, spread=None):
    ones, zeros = torch.ones(len(what)), torch.zeros(len(what))
    return prune_and_double(what, Shown(*(d if g is None else g for g, d in ((error, ones), (cover, ones), (spread, zeros)))), count)


def test_the_discs_with_the_largest_error_are_split_until_the_count(discs):
    error = torch.arange(len(discs), dtype=torch.float32)
    grown = grow(discs, len(discs) + 5, error)
    assert len(grown) == len(discs) + 5
    assert torch.equal(grown.pixel[: len(discs) - 5], discs.pixel[:-5])


def test_the_halves_lie_either_side_of_their_disc_along_its_longer_axis(discs):
    camera, one = made.camera(), discs.pick(torch.tensor([7]))
    one.log_scale[0, 1] += 1.0
    one.angle[0] = 0.6
    halves = grow(one, 2)
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
    left = grow(discs, len(discs) - 2, cover=cover)
    kept = [i for i in range(len(discs)) if i not in (3, 8)]
    assert torch.equal(left.pixel, discs.pixel[kept])


def test_faint_hidden_and_oversized_gaussians_go(some):
    with torch.no_grad():
        some.logit[2] = -5
    cover, spread = torch.ones(12), torch.zeros(12)
    cover[5], spread[7] = 0, 0.5
    left = grow(some, 9, cover=cover, spread=spread)
    assert torch.equal(left.anchor, some.anchor[[i for i in range(12) if i not in (2, 5, 7)]])


def test_those_under_the_largest_error_are_doubled_until_the_count(some):
    grown = grow(some, 15, error=torch.arange(12.0))
    assert len(grown) == 15
    assert torch.equal(grown.anchor[:9], some.anchor[:9])


def test_a_large_one_becomes_halves_and_a_small_one_two_that_hide_as_much(some):
    order = some.log_scale.amax(1).argsort()
    error = torch.zeros(12)
    error[order[[0, -1]]] = torch.tensor([1.0, 2.0])
    before, after = to_splats(some), to_splats(grow(some, 14, error=error))
    for place, number in enumerate(sorted((int(order[0]), int(order[-1]))), 10):
        pair, axis = [place, place + 2], int(before.scale[number].argmax())
        direction = Rotation.from_quat(before.rotation[number][[1, 2, 3, 0]]).as_matrix()[:, axis]
        apart = after.mean[pair[0]] - after.mean[pair[1]]
        assert abs(apart @ direction) == pytest.approx(np.linalg.norm(apart), rel=1e-4)
        np.testing.assert_allclose(after.mean[pair].mean(0), before.mean[number], atol=1e-6)
        halved = number == int(order[-1])
        assert after.scale[place, axis] == pytest.approx(before.scale[number, axis] / (1.6 if halved else 1), rel=1e-5)
        passed = (1 - after.opacity[place]) ** (1 if halved else 2)
        assert passed == pytest.approx(1 - before.opacity[number], abs=1e-5)


def test_nothing_goes_where_nothing_shows(some):
    assert len(grow(some, 20, cover=torch.zeros(12))) == 12
