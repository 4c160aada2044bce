"""Claims about pictures, dense depth, lens distortion, the object among the points and its thickness."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.bags.write import write_recording
from diffphys_ros.capture.gaussians import part_of_object
from diffphys_ros.capture.pictures import pictures_of, resized
from diffphys_ros.capture.sweep import swept_depth
from diffphys_ros.capture.thickness import thickness_along
from diffphys_ros.capture.views import Shot, shot_of
from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera

from . import room


def surface_points(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points all over the box [m]."""
    points = rng.uniform(room.LOW, room.HIGH, (count, 3))
    axis, side = rng.integers(0, 3, count), rng.integers(0, 2, count)
    points[np.arange(count), axis] = np.where(side, room.HIGH[axis], room.LOW[axis])
    return points


def shot_at(camera: Camera, points: np.ndarray) -> Shot:
    image, _, _ = room.picture(camera)
    pixels, depth = camera.project(points)
    visible = np.flatnonzero(np.abs(room.trace(camera, pixels)[1] - depth) < 1e-3)
    return Shot("", image, np.ones(image.shape[:2], bool), camera, visible)


def test_depth_of_a_picture_is_read_from_its_neighbours() -> None:
    points = surface_points(np.random.default_rng(0), 300)
    here, *others = (shot_at(room.camera_from(a, e), points) for a, e in ((0, 20), (-14, 16), (13, 25), (4, 34), (-6, 8)))
    _, true, mask = room.picture(here.camera)
    depth = swept_depth(here, others, points, mask)
    known = depth > 0
    assert known[mask].mean() > 0.8
    assert not known[~mask].any()
    assert np.median(np.abs(depth - true)[known]) < 0.001
    assert np.quantile(np.abs(depth - true)[known], 0.95) < 0.008


def test_without_a_neighbour_at_a_useful_angle_no_depth_is_told() -> None:
    points = surface_points(np.random.default_rng(0), 300)
    here, same = (shot_at(room.camera_from(a, 20), points) for a in (0, 0.5))
    assert not swept_depth(here, [same], points, room.picture(here.camera)[2]).any()


def test_distortion_is_removed_and_what_the_lens_did_not_see_is_marked() -> None:
    camera, distortion = room.camera_from(0, 20), np.array([-0.25, 0.05, 0.002, -0.001])
    grid = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(np.float32)
    matrix = camera.pixel_from_camera
    ideal = cv2.undistortPoints(grid.reshape(-1, 1, 2), matrix, distortion, P=matrix).reshape(*grid.shape)
    taken = np.round(room.trace(camera, ideal.astype(float))[0]).astype(np.uint8)
    shot = shot_of("", taken, camera, distortion, np.zeros(0, int))
    straight = room.trace(camera, grid.astype(float))[0]
    difference = np.abs(shot.image - straight)[shot.valid]
    assert np.median(difference) < 0.25 * np.median(np.abs(taken - straight)[shot.valid])
    assert shot.valid.mean() > 0.5
    barrel = shot_of("", taken, camera, -distortion, np.zeros(0, int))
    assert not barrel.valid.all()


def test_the_sides_and_the_back_belong_to_the_object_and_what_stands_behind_does_not() -> None:
    camera = room.camera_from(8, 18)
    _, depth, mask = room.picture(camera)
    box = surface_points(np.random.default_rng(1), 1500)
    wall = np.random.default_rng(2).uniform((-0.4, room.WALL_Y, -0.06), (0.4, room.WALL_Y, 0.3), (800, 3))
    chosen = part_of_object(np.concatenate([box, wall]), camera, mask, np.where(mask, depth, 0))
    assert chosen[:1500].mean() > 0.93  # the rest falls onto pixels beside the mask
    assert not chosen[1500:].any()


def test_points_of_nothing_that_frame_0_shows_are_no_object() -> None:
    camera = room.camera_from(8, 18)
    _, depth, mask = room.picture(camera)
    assert not part_of_object(np.array([[0.0, 2.0, 0.0], [0.0, -3.0, 0.0]]), camera, mask, np.where(mask, depth, 0)).any()


def test_the_thickness_is_that_between_points_seen_from_before_and_from_behind() -> None:
    rng = np.random.default_rng(3)
    points = surface_points(rng, 600) + 3e-4 * rng.normal(size=(600, 3))
    cameras = [room.camera_from(a, 15) for a in (0, 40, 140, 180)]
    seen = [np.abs(room.trace(c, c.project(points)[0])[1] - c.project(points)[1]) < 2e-3 for c in cameras]
    surface = np.ones(600, bool)
    extent, words = thickness_along(np.array([0.0, 2.0, 0.0]), points, surface, seen, cameras, cameras[0])
    assert extent == pytest.approx(0.06, abs=0.002)
    assert "seen from behind" in words
    wall = np.random.default_rng(4).uniform((-0.2, 0.2, 0), (0.2, 0.25, 0.1), (200, 3))  # behind the object, seen from both sides
    both, ones = np.concatenate([points, wall]), np.ones(200, bool)
    again, _ = thickness_along(
        np.array([0.0, 2.0, 0.0]), both, np.concatenate([surface, ~ones]), [np.concatenate([s, ones]) for s in seen], cameras, cameras[0]
    )
    assert again == extent
    front, words = thickness_along(np.array([0.0, 1.0, 0.0]), points, surface, seen[:2], cameras[:2], cameras[0])
    assert np.isnan(front)
    assert "not measured" in words


def test_pictures_come_in_the_order_of_their_numbers_and_no_larger_than_asked(tmp_path: Path) -> None:
    for k in (1, 2, 10, 3, 4, 5):
        cv2.imwrite(str(tmp_path / f"view{k}.png"), np.full((300, 400, 3), k, np.uint8))
    pictures, matrix = pictures_of(tmp_path, build({"capture.max_side_px": 200}))
    found = list(pictures)
    assert [p.name for p in found] == [f"view{k}.png" for k in (1, 2, 3, 4, 5, 10)]
    assert {p.image.shape for p in found} == {(150, 200, 3)}
    assert matrix is None


def test_every_nth_frame_of_a_video_is_taken(tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "round.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30, (64, 48))
    for k in range(40):
        writer.write(np.full((48, 64, 3), 6 * k, np.uint8))
    writer.release()
    found = list(pictures_of(tmp_path / "round.mp4", build({"capture.every": 5}))[0])
    assert [p.name for p in found] == [f"frame_{k:05d}.png" for k in range(0, 40, 5)]
    assert abs(float(found[3].image.mean()) - 90) < 8


def test_a_recording_brings_its_intrinsics_along(tmp_path: Path) -> None:
    camera = room.camera_from(0, 20)
    clip = room.write_clip(tmp_path / "clip.mcap", camera, depth=False, frames=8)
    pictures, matrix = pictures_of(clip, build({"capture.every": 1, "capture.max_side_px": 160, "topics.image": "/image"}))
    assert len(list(pictures)) == 8
    assert matrix is not None
    assert np.allclose(matrix, resized(camera.pixel_from_camera, 0.5))
    assert matrix[0, 2] == pytest.approx((160 - 1) / 2)


def test_pictures_of_two_sizes_and_places_without_pictures_are_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((30, 40, 3), np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((40, 30, 3), np.uint8))
    with pytest.raises(InputError, match="b has 30x40 px, the pictures before it 40x30 px"):
        list(pictures_of(tmp_path, build({}))[0])
    with pytest.raises(InputError, match="no such file or folder"):
        pictures_of(tmp_path / "none", build({}))
    write_recording(tmp_path / "empty.mcap", [])
    with pytest.raises(InputError):
        pictures_of(tmp_path / "empty.mcap", build({}))
