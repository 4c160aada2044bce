"""From pixels to points where geometry leaves them open."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.tracks.lift import points_on_planes

CAMERA = camera_from_fov(60.0, 64, 48)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("normal", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1.0, 0, 1e-9]])
def test_a_ray_along_its_points_plane_holds_no_track_and_is_finite(normal: list[float]) -> None:
    pixels = np.stack(np.meshgrid(np.arange(64.0), np.arange(48.0)), -1).reshape(-1, 2)
    moved = np.stack([pixels, pixels[::-1]])
    points, valid = points_on_planes(CAMERA, moved, np.ones(moved.shape[:2], bool), np.full((48, 64), 0.5, np.float32), np.array(normal))
    assert np.isfinite(points).all()
    depth = CAMERA.project(points)[1]
    assert (depth[valid] > 0).all()
    np.testing.assert_allclose(points[1][valid[1]] @ normal, points[0][valid[1]] @ normal, atol=1e-9)
    if normal == [0, 0, 1.0]:
        assert valid.all()
