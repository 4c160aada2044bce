"""Free Gaussians: from points, pruned, doubled."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros.errors import InputError
from diffphys_ros.splats import from_points
from diffphys_ros.splats.ellipsoids import ellipsoids_of, product, rotated, to_splats
from diffphys_ros.splats.growth import prune_and_grow
from diffphys_ros.types import Splats


@pytest.fixture
def some():
    rng = np.random.default_rng(3)
    rotation = rng.standard_normal((12, 4))
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    arrays = (rng.normal(0, 1, (12, 3)), rotation, rng.uniform(0.01, 0.1, (12, 3)), rng.uniform(0.3, 0.9, 12), rng.uniform(0, 1, (12, 3)))
    return ellipsoids_of(Splats(*(a.astype(np.float32) for a in arrays)), "cpu")


def grow(e, count, error=None, cover=None, spread=None):
    ones, zeros = torch.ones(len(e)), torch.zeros(len(e))
    return prune_and_grow(e, *(d if g is None else g for g, d in ((error, ones), (cover, ones), (spread, zeros))), count=count)


def test_a_point_becomes_as_large_as_its_three_neighbours_are_far():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 2], [9, 0, 0]])
    splats = from_points(points, np.full((5, 3), 255, np.uint8))
    assert splats.scale[0] == pytest.approx([np.sqrt((1 + 4 + 4) / 3)] * 3)
    assert splats.color.max() == 1


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.full((4, 3), np.nan)])
def test_a_cloud_of_one_point_or_of_no_numbers_is_refused(points):
    with pytest.raises(InputError, match="points: "):
        from_points(points, np.zeros_like(points))


def test_points_that_coincide_keep_a_size():
    assert (from_points(np.array([[0.0, 0, 0]] * 5 + [[1, 0, 0]]), np.zeros((6, 3))).scale > 0).all()


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


def test_anchors_follow_their_gaussians(some):
    with torch.no_grad():
        some.offset.add_(0.5)
    again = some.leaves()
    np.testing.assert_allclose(to_splats(again).mean, to_splats(some).mean, atol=1e-6)
    assert not again.offset.any()


def test_quaternions_turn_as_rotations_do():
    a, b = Rotation.random(5, random_state=0), Rotation.random(5, random_state=1)
    qa, qb = (torch.tensor(r.as_quat()[:, [3, 0, 1, 2]]) for r in (a, b))
    vector = np.random.default_rng(0).standard_normal((5, 3))
    np.testing.assert_allclose(rotated(qa, torch.tensor(vector)), a.apply(vector), atol=1e-12)
    np.testing.assert_allclose(rotated(product(qa, qb), torch.tensor(vector)), (a * b).apply(vector), atol=1e-12)
