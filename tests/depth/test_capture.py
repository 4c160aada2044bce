"""Depth and camera of frame 0 from a capture's folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.config import Scene
from diffphys_ros.depth import placed, registered, source_of, surface_depth
from diffphys_ros.depth.capture import FILE, ClipView, read_clip_view
from diffphys_ros.errors import InputError
from diffphys_ros.measured import scene_of
from diffphys_ros.types import Camera, Clip
from tests.boxes import bar, bar_settings, box_clip, oblique_camera

DISTORTION = np.array([-0.45, 0.1, 0.001, -0.002])


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(), [np.eye(4)] * 2, oblique_camera())


def write(folder: Path, clip: Clip, **changes: object) -> ClipView:
    """A capture's file that knows the clip's own depth and camera."""
    view = ClipView(
        frame=clip.frames[0],
        camera=clip.camera,
        distortion=np.zeros(4),
        depth=np.where(clip.labels[0] > 0, clip.depth[0], 0).astype(np.float32),
        surface="other pictures",
        scale="depth topic",
        thickness_m=0.05,
        thickness_axis=np.array([0.0, 1.0, 0.0]),
    )
    view = replace(view, **changes)
    np.savez_compressed(folder / FILE, **view.arrays())
    return view


def unposed(clip: Clip) -> Clip:
    """The clip as a bare video: a guessed camera, no pose, no depth."""
    guessed = Camera(np.array([[200.0, 0, 119.5], [0, 200, 79.5], [0, 0, 1]]), np.eye(4), 240, 160)
    return replace(clip, camera=guessed, depth=None)


def of(folder: Path, **values: object):
    return bar_settings(depth__capture=str(folder), **values)


def test_what_is_written_is_read(clip: Clip, tmp_path: Path) -> None:
    view, again = write(tmp_path, clip), read_clip_view(tmp_path)
    assert np.array_equal(view.depth, again.depth)
    assert np.array_equal(view.camera.world_from_camera, again.camera.world_from_camera)
    assert (again.camera.width, again.camera.world_frame_id, again.scale) == (240, "world", "depth topic")


def test_depth_comes_from_the_capture_with_its_holes_filled(clip: Clip, tmp_path: Path) -> None:
    on = clip.labels[0] > 0
    holed = np.where(on & (np.arange(240) % 7 > 0), clip.depth[0], 0).astype(np.float32)
    write(tmp_path, clip, depth=holed)
    settings = of(tmp_path)
    assert source_of(unposed(clip), settings) == "capture"
    depth, source = surface_depth(unposed(clip), settings)
    assert ((depth > 0) == on).all()
    assert np.quantile(np.abs(depth - clip.depth[0])[on], 0.95) < 3e-3
    assert source.words == "other pictures; scale: depth topic"


def test_a_depth_topic_goes_first_unless_the_capture_is_asked_for(clip: Clip, tmp_path: Path) -> None:
    assert source_of(clip, of(tmp_path)) == "topic"
    assert source_of(clip, of(tmp_path, depth__source="capture")) == "capture"


def test_a_clip_is_placed_by_the_capture_only_where_that_is_the_depth_source(clip: Clip, tmp_path: Path) -> None:
    write(tmp_path, clip)
    settings = of(tmp_path, scene__thickness_m=None)
    assert placed(clip, settings) is clip
    asked = of(tmp_path, scene__thickness_m=None, depth__source="capture")
    assert placed(clip, asked).thickness.extent_m == registered(clip, asked).thickness.extent_m == 0.05


def test_a_bare_video_gets_camera_pose_and_thickness(clip: Clip, tmp_path: Path) -> None:
    write(tmp_path, clip)
    found = registered(unposed(clip), of(tmp_path, scene__thickness_m=None, scene__thickness_axis=None))
    assert np.array_equal(found.camera.world_from_camera, clip.camera.world_from_camera)
    assert found.camera.pose_known
    scene = scene_of(found, Scene())
    assert (scene.thickness_m, scene.thickness_axis) == (0.05, [0.0, 1.0, 0.0])
    assert any("thickness 50 mm" in note for note in found.notes)


def test_a_given_thickness_stays_and_one_that_was_not_measured_is_none(clip: Clip, tmp_path: Path) -> None:
    write(tmp_path, clip, thickness_m=np.nan)
    settings = of(tmp_path, scene__thickness_m=0.07)
    assert registered(clip, settings).thickness is None
    write(tmp_path, clip)
    assert scene_of(registered(clip, settings), settings.scene).thickness_m == 0.07


def test_the_lens_distortion_that_the_capture_found_is_removed_from_every_frame(clip: Clip, tmp_path: Path) -> None:
    matrix = clip.camera.pixel_from_camera
    grid = np.stack(np.meshgrid(np.arange(240), np.arange(160)), -1).astype(np.float32)
    ideal = cv2.undistortPoints(grid.reshape(-1, 1, 2), matrix, DISTORTION, P=matrix).reshape(*grid.shape)
    bent = np.stack([cv2.remap(frame, ideal, None, cv2.INTER_LINEAR) for frame in clip.frames])
    write(tmp_path, clip, frame=bent[0], distortion=DISTORTION)
    found = registered(replace(clip, frames=bent), of(tmp_path))
    inner = np.s_[:, 30:-30, 40:-40]
    before, after = (np.abs(frames.astype(float) - clip.frames)[inner].mean() for frames in (bent, found.frames))
    assert after < 0.4 * before  # what is left is the blur of two interpolations


def test_the_capture_of_another_clip_is_refused(clip: Clip, tmp_path: Path) -> None:
    write(tmp_path, clip)
    other = replace(clip, frames=255 - clip.frames)
    with pytest.raises(InputError, match="was made with another clip"):
        registered(other, of(tmp_path))
    smaller = replace(clip, frames=clip.frames[:, :100], labels=clip.labels[:, :100], depth=None)
    with pytest.raises(InputError, match="was made with another clip"):
        surface_depth(smaller, of(tmp_path))


def test_a_folder_without_a_capture_and_one_that_knows_nothing_of_the_object_are_refused(clip: Clip, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"depth\.capture is not set"):
        surface_depth(clip, bar_settings(depth__source="capture"))
    with pytest.raises(InputError, match=r"diffphys capture IMAGES --clip"):
        surface_depth(clip, of(tmp_path, depth__source="capture"))
    (tmp_path / FILE).write_bytes(b"PK\x03\x04 torn")
    with pytest.raises(InputError, match=r"not a readable \.npz .*; make the capture again"):
        surface_depth(clip, of(tmp_path, depth__source="capture"))
    write(tmp_path, clip, depth=np.zeros((160, 240), np.float32))
    with pytest.raises(InputError, match="knows no depth on the object"):
        surface_depth(clip, of(tmp_path, depth__source="capture"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depth": np.ones((3, 4), np.float32)}, "depth is of shape"),
        ({"depth": None}, "depth is missing"),
        ({"distortion": np.array([np.nan] * 4)}, "distortion must be finite"),
        ({"camera_width": np.array(7)}, "images are not of the camera's 7 x 160 pixels"),
        ({"camera_pixel_from_camera": np.zeros((3, 3))}, "the camera's matrix is that of no pinhole"),
        ({"thickness_m": np.array(-1.0)}, "thickness_m must be > 0"),
        ({"surface": np.zeros(3)}, "surface is of shape"),
    ],
)
def test_a_capture_whose_arrays_do_not_fit_each_other_is_refused(clip: Clip, tmp_path: Path, change: dict, said: str) -> None:
    arrays = write(tmp_path, clip).arrays() | change
    np.savez_compressed(tmp_path / FILE, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(InputError, match=f"depth.capture .*{said}.*; make the capture again"):
        read_clip_view(tmp_path)
