"""From a recording with known geometry to a clip with the same: lenses, depth cameras, transforms, gravity, encodings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip
from tests import encoded
from tests.filmed import (
    COLOUR_FRAME,
    DEPTH_FRAME,
    FRAMES,
    HEIGHT,
    POINTS,
    WIDTH,
    K,
    colour,
    depth,
    found,
    imu,
    info,
    link,
    pose,
    seen_by_opencv,
    stamp_of,
    tree,
)
from tests.filmed_cases import (
    BLOCK_M,
    CAMERA_IN_WORLD,
    CASES,
    GRAVITY,
    LEFT_TOP,
    LENSES,
    MOUNTED,
    NOT_YET,
    REFUSED,
    WALL_M,
    Case,
    P,
    depth_camera,
    in_world,
    on_moving_arm,
    plain,
    surface,
    with_imu,
)

SUB_PIXEL = 0.15  # px: pictures have 8 bits
IN_BOTH = np.zeros((HEIGHT, WIDTH), bool)  # what the depth camera sees too
IN_BOTH[20:-20, 30:-30] = True


def clip_of(case: Case, folder: Path, **more: Any) -> Clip:
    messages, settings = case()
    path = write_recording(folder / "clip.mcap", messages)
    return read_clip(path, config.build(settings | {name.replace("__", "."): value for name, value in more.items()}))


def assert_points_are_seen_where_the_camera_says(clip: Clip, frame: int = 1, points: np.ndarray = POINTS) -> None:
    """By the clip's pinhole camera, from points in the camera of frame 0."""
    in_world = points @ clip.camera.world_from_camera[:3, :3].T + clip.camera.position
    expected = clip.camera.project(in_world)[0]
    inside = ((expected > 8) & (expected < np.array(clip.frames.shape[2:0:-1]) - 8)).all(1)
    assert inside.sum() >= 3
    apart = np.linalg.norm(found(clip.frames[frame], expected[inside]) - expected[inside], axis=1)
    assert apart.max() < SUB_PIXEL


@pytest.mark.parametrize("name", LENSES)
def test_points_behind_a_lens_come_to_where_the_pinhole_camera_sees_them(name: str, tmp_path: Path) -> None:
    model, d = LENSES[name]
    bent = seen_by_opencv(POINTS, K, d, model) - seen_by_opencv(POINTS, K, [0.0] * 5, "plumb_bob")
    assert np.linalg.norm(bent, axis=1).max() > 1  # or the claim is empty
    clip = clip_of(CASES[f"lens: {name}"], tmp_path)
    np.testing.assert_array_equal(clip.camera.pixel_from_camera, K)
    assert_points_are_seen_where_the_camera_says(clip)


def test_rectified_images_are_left_alone_and_their_camera_is_p(tmp_path: Path) -> None:
    clip = clip_of(CASES["rectified"], tmp_path)
    np.testing.assert_array_equal(clip.camera.pixel_from_camera, P[:, :3])
    assert_points_are_seen_where_the_camera_says(clip)
    assert not [note for note in clip.notes if "distortion" in note]


def test_raw_images_are_turned_by_the_rectification_of_their_camera_info(tmp_path: Path) -> None:
    clip = clip_of(CASES["turned by R"], tmp_path)
    assert_points_are_seen_where_the_camera_says(clip)
    assert any("rectification R" in note for note in clip.notes)


@pytest.mark.parametrize(("name", "bins"), [("region of interest", 1), ("region of interest, binned", 2)])
def test_a_region_of_interest_and_bins_move_and_scale_the_camera(name: str, bins: int, tmp_path: Path) -> None:
    clip = clip_of(CASES[name], tmp_path)
    assert clip.camera.pixel_from_camera[0, 0] == K[0, 0] / bins
    assert clip.camera.pixel_from_camera[1, 2] == (K[1, 2] - LEFT_TOP[1] + 0.5) / bins - 0.5
    assert_points_are_seen_where_the_camera_says(clip)


def test_depth_of_another_camera_is_brought_to_the_colour_camera_nearest_first(tmp_path: Path) -> None:
    clip = clip_of(CASES["depth camera"], tmp_path)
    assert clip.depth is not None
    true, seen = surface(K, (WIDTH, HEIGHT), np.eye(4)), clip.depth[0]
    block = np.abs(true - BLOCK_M) < 1e-3
    inside = ndimage.binary_erosion(block, iterations=3)
    assert inside.sum() > 300
    np.testing.assert_allclose(seen[inside], BLOCK_M, atol=2e-3)  # no hole, and nothing of the wall behind
    around = ~ndimage.binary_dilation(block, np.ones((3, 3)), iterations=9) & IN_BOTH
    assert (seen[around] > 0).mean() > 0.98
    np.testing.assert_allclose(seen[around & (seen > 0)], WALL_M, atol=5e-3)
    assert any("(104x78 px, 5.1 cm from the colour camera) was brought to the colour images" in note for note in clip.notes)


def test_depth_of_another_size_in_the_same_frame_fills_the_colour_image(tmp_path: Path) -> None:
    clip = clip_of(CASES["depth of another size"], tmp_path)
    assert clip.depth is not None
    true = surface(K, (WIDTH, HEIGHT), np.eye(4))
    away = IN_BOTH & ~(ndimage.grey_dilation(true, 5) > ndimage.grey_erosion(true, 5) + 1e-3)  # the edges are of coarser pixels
    assert away.sum() > 5000
    np.testing.assert_allclose(clip.depth[0][away], true[away], atol=2e-3)


def test_registered_depth_with_its_own_equal_camera_info_is_left_as_it_is(tmp_path: Path) -> None:
    metres = np.random.default_rng(0).uniform(0.5, 2, (HEIGHT, WIDTH)).astype(np.float32)
    messages = [*colour(plain()), *depth(metres), info(), info(topic="/depth/camera_info")]
    clip = clip_of(lambda: (messages, {}), tmp_path)
    assert clip.depth is not None
    np.testing.assert_array_equal(clip.depth[2], metres)


def test_the_camera_info_of_the_depth_is_not_taken_for_that_of_the_colour(tmp_path: Path) -> None:
    messages = [message for message in depth_camera() if message[0] != "/color/camera_info"]
    with pytest.raises(InputError, match="has no camera_info"):
        clip_of(lambda: (messages, {}), tmp_path)


def test_depth_of_another_moment_is_paired_with_the_nearest_colour_and_said(tmp_path: Path) -> None:
    clip = clip_of(CASES["depth 20 ms late"], tmp_path)
    assert any("depth and colour are 13.3 ms apart (median of 5 pairs, at most 13.3 ms)" in note for note in clip.notes)
    assert any("1 of 6 frames have no depth image within 16.7 ms (sync.slop_s)" in note for note in clip.notes)
    wide = clip_of(lambda: (CASES["depth 20 ms late"]()[0], {"sync.slop_s": 0.02}), tmp_path)
    assert wide.depth is not None
    assert wide.depth[:, 0, 0].tolist() == [1, 1, 2, 3, 4, 5]


def test_the_world_is_the_root_of_the_cameras_tree_through_moving_links(tmp_path: Path) -> None:
    clip = clip_of(CASES["world over a moving link"], tmp_path)
    expected = pose(0.2, 0, 1.0, turn_deg=(0, 30, 0)) @ MOUNTED
    np.testing.assert_allclose(clip.camera.world_from_camera, expected, atol=1e-9)
    assert (clip.camera.world_frame_id, clip.notes) == ("world", ())


def test_target_frame_names_the_world(tmp_path: Path) -> None:
    clip = clip_of(CASES["target_frame"], tmp_path)
    np.testing.assert_allclose(clip.camera.world_from_camera, MOUNTED, atol=1e-9)
    assert clip.camera.world_frame_id == "wrist"


def test_without_a_transform_the_cameras_frame_is_the_world_and_that_is_said_or_told(tmp_path: Path) -> None:
    clip = clip_of(CASES["no transform"], tmp_path)
    assert clip.camera.world_frame_id == COLOUR_FRAME
    assert any("no transform of color_optical is known: the camera's own frame is the world" in note for note in clip.notes)
    told = clip_of(CASES["no transform"], tmp_path, **GRAVITY, scene__target_frame=COLOUR_FRAME)
    assert (told.camera.world_frame_id, told.notes) == (COLOUR_FRAME, ())


def test_a_static_chain_that_ends_at_a_robots_wrist_is_no_world_in_silence(tmp_path: Path) -> None:
    static = [message for message in in_world() if message[0] != "/tf"]
    clip = clip_of(lambda: (static, GRAVITY), tmp_path)
    assert any("the world is wrist, where the known transforms of the camera end" in note for note in clip.notes)


def test_pictures_of_a_camera_that_turns_are_turned_back(tmp_path: Path) -> None:
    clip = clip_of(CASES["camera that turns"], tmp_path)
    np.testing.assert_allclose(clip.camera.world_from_camera, CAMERA_IN_WORLD, atol=1e-9)
    for frame in range(FRAMES):
        assert_points_are_seen_where_the_camera_says(clip, frame)
    assert any("the camera turns by up to 5.7 degrees during the clip; its images were turned back" in note for note in clip.notes)


def test_depth_of_a_camera_that_turns_lies_on_the_surface_that_frame_0_sees(tmp_path: Path) -> None:
    walls = []
    for k in range(FRAMES):
        now = pose(turn_deg=(0, 4.0 * k / (FRAMES - 1), 4.0 * k / (FRAMES - 1)))
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(K).T
        walls.append(WALL_M / (rays @ now[:3, :3].T)[..., 2])
    clip = clip_of(lambda: ([*on_moving_arm(turn_deg=4.0), *depth(walls)], GRAVITY), tmp_path)
    assert clip.depth is not None
    middle = clip.depth[:, 20:-20, 20:-20]
    np.testing.assert_allclose(middle, WALL_M, rtol=2e-3)


def test_small_noise_of_a_pose_is_no_motion(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    shaken = [tree(link("world", COLOUR_FRAME, CAMERA_IN_WORLD @ pose(*rng.normal(0, 1e-4, 3)), stamp_of(k)), topic="/tf") for k in range(-1, FRAMES + 1)]
    clip = clip_of(lambda: ([*colour(plain()), info(), *shaken], GRAVITY), tmp_path)
    assert clip.notes == ()


def test_gravity_is_measured_by_an_imu_that_rests(tmp_path: Path) -> None:
    clip = clip_of(CASES["imu"], tmp_path)
    np.testing.assert_allclose(clip.gravity, [0, 0, -9.80665], atol=0.02)
    assert any("m/s^2 in world, as the IMU of /imu has it" in note for note in clip.notes)
    own = clip_of(CASES["imu without a world"], tmp_path)
    np.testing.assert_allclose(own.gravity, np.array([0, 9.8, -0.3]) * 9.80665 / np.hypot(9.8, 0.3), atol=0.02)


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        (lambda: with_imu(noise=2.0), "it does not rest"),
        (lambda: with_imu(count=5), "5 messages with a linear acceleration came, at least 10 are needed"),
        (lambda: with_imu(linear_acceleration_covariance=[-1.0] + [0.0] * 8), "0 messages with a linear acceleration came"),
        (lambda: [*colour(plain()), info(), *imu((0, 0, 9.8), "elsewhere")], "no transform from the camera's color_optical to its elsewhere is known"),
        (lambda: [*colour(plain()), info(), *imu((0, 0.1, 0), COLOUR_FRAME)], "m/s^2 at rest, must be within 0.8 of 9.81"),
    ],
)
def test_an_imu_that_tells_no_gravity_is_said_to(messages: Any, reason: str, tmp_path: Path) -> None:
    clip = clip_of(lambda: (messages(), {}), tmp_path)
    assert clip.gravity is None
    assert any(reason in note for note in clip.notes), clip.notes


def test_told_gravity_goes_before_an_imu_and_a_contradiction_is_said(tmp_path: Path) -> None:
    clip = clip_of(CASES["imu"], tmp_path, scene__gravity_m_s2=[0.0, -9.81, 0.0])
    assert clip.gravity is None
    assert any("scene.gravity_m_s2 points 90 degrees away from what the IMU measures" in note for note in clip.notes)
    assert clip_of(CASES["imu"], tmp_path, topics__imu="none").gravity is None


def test_the_z_axis_of_a_target_frame_is_up_and_unknown_gravity_is_said(tmp_path: Path) -> None:
    clip = clip_of(lambda: (in_world(), {"scene.target_frame": "world"}), tmp_path)
    np.testing.assert_array_equal(clip.gravity, [0, 0, -9.80665])
    unknown = clip_of(lambda: (in_world(), {}), tmp_path)
    assert unknown.gravity is None
    assert any("gravity is not known" in note for note in unknown.notes)


def test_measured_gravity_reaches_the_body(tmp_path: Path) -> None:
    from diffphys_ros.measured import scene_of

    scene = scene_of(clip_of(CASES["imu"], tmp_path), config.Settings().scene)
    np.testing.assert_allclose(scene.gravity_m_s2, [0, 0, -9.80665], atol=0.02)
    told = config.build({"scene.gravity_m_s2": [0.0, 0.0, 0.0]}).scene
    assert scene_of(clip_of(CASES["imu"], tmp_path), told) == told


def test_camera_infos_that_change_or_come_late_are_said(tmp_path: Path) -> None:
    clip = clip_of(CASES["camera_info changes"], tmp_path)
    np.testing.assert_array_equal(clip.camera.pixel_from_camera, K)
    assert any("/color/camera_info changes 0.10 s after the first image" in note for note in clip.notes)
    late = clip_of(lambda: ([*colour(plain()), info(ns=stamp_of(5))], {}), tmp_path)
    assert any("/color/camera_info came 0.17 s after the first image" in note for note in late.notes)


@pytest.mark.parametrize("name", encoded.COLOUR)
def test_every_colour_encoding_gives_its_picture(name: str, tmp_path: Path) -> None:
    expected = encoded.COLOUR[name]()
    clip = clip_of(CASES[f"encoding: {name}"], tmp_path)
    np.testing.assert_allclose(clip.frames[1].astype(int), expected.expected.astype(int), atol=expected.atol)


@pytest.mark.parametrize("name", encoded.DEPTH)
def test_every_depth_encoding_gives_its_distances_and_gaps(name: str, tmp_path: Path) -> None:
    expected = encoded.DEPTH[name]()
    clip = clip_of(CASES[f"depth encoding: {name}"], tmp_path)
    assert clip.depth is not None
    np.testing.assert_allclose(clip.depth[1], expected.expected, atol=max(expected.atol, 1e-7))
    np.testing.assert_array_equal(clip.depth[1] > 0, expected.expected > 0)


@pytest.mark.parametrize("name", [*REFUSED, *NOT_YET])
def test_geometry_that_would_be_wrong_is_refused_with_its_cure(name: str, tmp_path: Path) -> None:
    case, words = (REFUSED | NOT_YET)[name]
    with pytest.raises(InputError, match=words):
        clip_of(case, tmp_path)


def test_a_depth_frame_of_its_own_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=DEPTH_FRAME):
        clip_of(NOT_YET["depth in another frame"][0], tmp_path)
