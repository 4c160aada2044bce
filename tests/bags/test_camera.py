"""Cameras, lens distortion and transforms as matrices."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from diffphys_ros.bags.camera import camera_from_fov, camera_from_info, matrix_from_transform, undistorter
from diffphys_ros.errors import InputError

K = [200.0, 0, 79.5, 0, 210.0, 59.5, 0, 0, 1]


def test_a_camera_without_a_transform_is_its_own_world() -> None:
    camera = camera_from_info(K, [], 160, 120, "optical")
    assert not camera.pose_known
    np.testing.assert_array_equal(camera.world_from_camera, np.eye(4))


def test_half_the_image_spans_half_the_field_of_view() -> None:
    camera = camera_from_fov(90.0, 100, 50)
    pixel, _ = camera.project(np.array([1.0, 0.0, 1.0]))  # 45 degrees to the right: the outer edge of the last pixel
    assert pixel[0] == pytest.approx(99.5)


@pytest.mark.parametrize(("k", "reason"), [([0.0] * 9, r"K\[0\] = 0, must be above 0"), ([np.nan] * 9, "not finite")])
def test_an_uncalibrated_camera_is_refused(k: list[float], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        camera_from_info(k, [], 160, 120, "optical")


def test_no_distortion_needs_no_map() -> None:
    assert undistorter(K, [0.0] * 5, "plumb_bob", 160, 120) is None


@pytest.mark.parametrize(("model", "d"), [("plumb_bob", [-0.3, 0.1, 0.001, -0.002, 0.0]), ("equidistant", [0.05, 0.02, 0.0, 0.0])])
def test_undistorted_points_lie_where_the_pinhole_camera_sees_them(model: str, d: list[float]) -> None:
    point, matrix = np.array([0.25, -0.15, 1.0]), np.reshape(K, (3, 3))
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    seen = project(point[None, None], np.zeros(3), np.zeros(3), matrix, np.array(d))[0].ravel()
    pinhole, _ = camera_from_info(K, d, 160, 120, "optical").project(point)
    assert np.linalg.norm(seen - pinhole) > 1  # or the claim is empty
    y, x = np.mgrid[:120, :160]
    spot = np.exp(-((x - seen[0]) ** 2 + (y - seen[1]) ** 2) / 8)
    undistort = undistorter(K, d, model, 160, 120)
    assert undistort is not None
    found = undistort(np.repeat((255 * spot)[..., None], 3, 2).astype(np.uint8))[..., 0].astype(float)
    centre = np.array([(found * x).sum(), (found * y).sum()]) / found.sum()
    np.testing.assert_allclose(centre, pinhole, atol=0.25)


def test_undistorting_depth_invents_no_distance() -> None:
    depth = np.where(np.arange(160) < 90, 1.0, 3.0).astype(np.float32) * np.ones((120, 1), np.float32)
    undistort = undistorter(K, [-0.3, 0.1, 0, 0, 0], "plumb_bob", 160, 120)
    assert undistort is not None
    assert set(np.unique(undistort(depth))) <= {0.0, 1.0, 3.0}


def test_an_unknown_distortion_model_is_refused() -> None:
    with pytest.raises(InputError, match="distortion_model 'mine', must be plumb_bob"):
        undistorter(K, [0.1], "mine", 160, 120)


def test_quaternions_need_no_unit_length_and_follow_the_ros_order() -> None:
    quaternion = np.array([0.1, -0.4, 0.3, 0.7])
    matrix = matrix_from_transform((1, 2, 3), 2 * quaternion)
    np.testing.assert_allclose(matrix[:3, :3], Rotation.from_quat(quaternion).as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(matrix[:3, 3], [1, 2, 3])


@pytest.mark.parametrize("rotation", [(0, 0, 0, 0), (0, 0, 0, np.nan)])
def test_a_transform_without_a_rotation_is_refused(rotation: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="must be a unit quaternion"):
        matrix_from_transform((0, 0, 0), rotation)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({8: 7.0}, r"K\[1, 3, 6, 7, 8\] = 0, 0, 0, 0, 7, must be 0, 0, 0, 0, 1"),
        ({8: 0.0}, r"must be 0, 0, 0, 0, 1"),
        ({1: 200.0}, r"K\[1, 3, 6, 7, 8\] = 200, .*a camera without skew"),
        ({3: 5.0}, r"must be 0, 0, 0, 0, 1"),
        ({4: 0.0}, r"K\[4\] = 0, must be above 0"),
        ({0: 1e-9}, r"K\[0\] = 1e-09 px at a width of 160 px, must be between"),
        ({4: 1e12}, r"K\[4\] = 1e\+12 px at a height of 120 px, must be between"),
        ({2: 1e9}, r"optical axis at K\[2\] = 1e\+09 px"),
    ],
)
def test_a_matrix_that_is_no_pinhole_camera_is_refused_with_its_entry(changed: dict[int, float], reason: str) -> None:
    k = [changed.get(i, value) for i, value in enumerate(K)]
    with pytest.raises(InputError, match=reason):
        camera_from_info(k, [], 160, 120, "optical")


def test_unequal_focal_lengths_are_used() -> None:
    camera = camera_from_info([200.0, 0, 79.5, 0, 100.0, 59.5, 0, 0, 1], [], 160, 120, "optical")
    np.testing.assert_allclose(camera.project(np.array([0.1, 0.1, 1.0]))[0], [99.5, 69.5])
    np.testing.assert_allclose(camera.backproject(np.array([99.5, 69.5]), np.array(1.0)), [0.1, 0.1, 1.0])


def test_a_rounding_errors_skew_is_taken_as_none() -> None:
    assert camera_from_info([200.0, 1e-9, 79.5, 0, 210.0, 59.5, 0, 0, 1], [], 160, 120, "optical").pixel_from_camera[0, 1] == 0


@pytest.mark.parametrize(("model", "count"), [("plumb_bob", 3), ("plumb_bob", 8), ("rational_polynomial", 7), ("equidistant", 2), ("equidistant", 5), ("", 1)])
def test_a_number_of_coefficients_that_the_model_does_not_have_is_refused(model: str, count: int) -> None:
    with pytest.raises(InputError, match=rf"{count} distortion coefficients for .*, must be [\d, ]+; calibrate"):
        undistorter(K, [0.01] * count, model, 160, 120)


@pytest.mark.parametrize("d", [[30.0, 500.0, 0, 0, 0], [1e300, 0, 0, 0, 0]])
def test_a_distortion_that_no_lens_has_is_refused(d: list[float]) -> None:
    with pytest.raises(InputError, match=r"puts \d+% of the undistorted picture outside"):
        undistorter(K, d, "plumb_bob", 160, 120)


@pytest.mark.parametrize("absurd", [1e300, np.inf])
def test_a_transform_of_absurd_numbers_is_refused_without_a_warning(absurd: float, recwarn: pytest.WarningsRecorder) -> None:
    for translation, rotation in (((absurd, 0, 0), (0, 0, 0, 1)), ((0, 0, 0), (0, absurd, 0, 1))):
        with pytest.raises(InputError, match="must be a unit quaternion xyzw and a place within"):
            matrix_from_transform(translation, rotation)
    assert not recwarn.list


def test_a_fisheye_lens_bends_rays_with_coefficients_of_zero_too() -> None:
    assert undistorter(K, [0.0] * 4, "equidistant", 160, 120) is not None
    assert undistorter(K, [], "equidistant", 160, 120) is None
