"""Free Gaussians: from points, anchored where they are."""

import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.splats import from_points
from diffphys_ros.splats.ellipsoids import to_splats


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


def test_anchors_follow_their_gaussians(some):
    with torch.no_grad():
        some.offset.add_(0.5)
    again = some.leaves()
    np.testing.assert_allclose(to_splats(again).mean, to_splats(some).mean, atol=1e-6)
    assert not again.offset.any()
