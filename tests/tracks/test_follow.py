"""Surface points followed through a clip of exactly known motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.depth import surface_depth
from diffphys_ros.errors import InputError
from diffphys_ros.tracks import follow
from diffphys_ros.tracks.noise import displacement_noise
from diffphys_ros.types import Clip, Tracks
from tests.boxes import bar, bar_settings, box_clip, oblique_camera, turned

FRAMES = 10


def swinging() -> list[np.ndarray]:
    return [turned(0.12 * np.sin(0.7 * k)) @ turned(0.05 * np.sin(0.5 * k), 2) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(), swinging(), oblique_camera())


@pytest.fixture(scope="module")
def tracks(clip: Clip) -> Tracks:
    return follow(clip, surface_depth(clip, bar_settings())[0], bar_settings())


def errors(tracks: Tracks) -> np.ndarray:
    """Displacement errors [m], (T, M, 3)."""
    true = np.stack([tracks.points[0] @ pose[:3, :3].T + pose[:3, 3] for pose in swinging()])
    return tracks.points - true


def test_displacements_are_true_to_a_fraction_of_a_pixel(tracks: Tracks) -> None:
    error = errors(tracks)[tracks.valid]
    assert tracks.has_depth
    assert tracks.points.shape[1] > 80
    assert np.sqrt((error**2).mean()) < 4e-4  # a pixel is 1.6 mm
    assert np.linalg.norm(error.mean(0)) < 1e-4


def test_points_stay_on_the_same_material_without_drift(tracks: Tracks, clip: Clip) -> None:
    true = np.stack([clip.camera.project(tracks.points[0] @ pose[:3, :3].T + pose[:3, 3])[0] for pose in swinging()])
    miss = np.linalg.norm(tracks.pixels - true, axis=-1)
    assert np.median(miss[-1][tracks.valid[-1]]) < 0.1
    assert np.median(miss[-1][tracks.valid[-1]]) < 2.5 * np.median(miss[2][tracks.valid[2]]) + 0.05


def test_the_stated_noise_is_that_of_the_tracks(tracks: Tracks) -> None:
    true = np.sqrt((errors(tracks)[tracks.valid] ** 2).mean())
    assert 0.5 < tracks.noise_m / true < 2


def test_frame_zero_is_finite_valid_and_spread_over_the_object(tracks: Tracks, clip: Clip) -> None:
    assert np.isfinite(tracks.points).all()
    assert tracks.valid[0].all()
    assert (tracks.valid.mean(0) > 0.5).all()
    assert tracks.points.shape[1] <= 600
    inside = tracks.points[0]
    for low in np.linspace(0, 0.22, 6):
        assert ((inside[:, 0] > low) & (inside[:, 0] < low + 0.04)).sum() >= 4


def test_frames_that_were_lost_hold_no_tracks(clip: Clip) -> None:
    seen = np.ones(FRAMES, bool)
    seen[[3, 4]] = False
    frames, depth = clip.frames.copy(), clip.depth.copy()
    frames[3:5], depth[3:5] = frames[2], depth[2]
    lost = replace(clip, frames=frames, depth=depth, observed=seen)
    tracks = follow(lost, surface_depth(lost, bar_settings())[0], bar_settings())
    assert not tracks.valid[[3, 4]].any()
    assert tracks.valid[5].mean() > 0.8
    assert np.sqrt((errors(tracks)[tracks.valid] ** 2).mean()) < 5e-4


def test_without_depth_points_move_across_the_line_of_sight_only(clip: Clip) -> None:
    flat = replace(clip, depth=None)
    tracks = follow(flat, surface_depth(flat, bar_settings())[0], bar_settings())
    assert not tracks.has_depth
    error = errors(tracks)
    ray = tracks.points - clip.camera.position
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    across = error - (error * ray).sum(-1, keepdims=True) * ray
    assert np.sqrt((across[tracks.valid] ** 2).mean()) < 6e-4
    assert np.allclose(tracks.points[..., 1], tracks.points[0, :, 1], atol=1e-9)  # across the thickness axis


def test_points_whose_depth_jumps_to_the_wall_are_dropped(clip: Clip) -> None:
    depth = clip.depth.copy()
    depth[5, 60:90, 60:120] = 1.1
    broken = replace(clip, depth=depth)
    tracks = follow(broken, surface_depth(broken, bar_settings())[0], bar_settings())
    assert np.abs(errors(tracks)[tracks.valid]).max() < 0.01
    assert not tracks.valid[5].all()


def test_an_object_without_texture_is_refused(clip: Clip) -> None:
    plain = replace(clip, frames=np.random.default_rng(0).integers(0, 255, clip.frames.shape).astype(np.uint8))
    with pytest.raises(InputError, match=r"surface points could be followed.*textured"):
        follow(plain, surface_depth(plain, bar_settings())[0], bar_settings())


def test_an_object_of_a_few_pixels_is_refused(clip: Clip) -> None:
    labels = np.zeros_like(clip.labels)
    labels[:, 80:84, 100:104] = clip.labels[:, 80:84, 100:104]
    small = replace(clip, labels=labels)
    with pytest.raises(InputError, match=r"0 surface points could be followed, at least 8"):
        follow(small, surface_depth(small, bar_settings())[0], bar_settings())


def test_following_twice_gives_the_same_bytes(clip: Clip, tracks: Tracks) -> None:
    again = follow(clip, surface_depth(clip, bar_settings())[0], bar_settings())
    assert np.array_equal(again.points, tracks.points)
    assert np.array_equal(again.valid, tracks.valid)


@pytest.mark.parametrize("sigma", [1e-4, 1e-3])
def test_white_noise_on_a_bending_sheet_is_measured(sigma: float) -> None:
    rng = np.random.default_rng(0)
    start = np.stack([*np.meshgrid(np.linspace(0, 0.3, 25), np.linspace(0, 0.1, 9)), np.zeros((9, 25))], -1).reshape(-1, 3)
    bend = np.sin(0.4 * np.arange(40))[:, None] * start[:, 0] ** 2  # 5 mm at the end
    points = start + np.stack([0 * bend, 0 * bend, 0.06 * bend], -1)
    points[1:] += sigma * rng.normal(size=points[1:].shape)
    assert displacement_noise(points, np.ones(points.shape[:2], bool)) == pytest.approx(sigma, rel=0.2)


@pytest.mark.parametrize("name", ["beam_gust", "beam_two_part", "plant_poke"])
def test_tracks_of_a_truth_scene_follow_its_vertices(name: str, scenes: Path) -> None:
    from scipy.interpolate import RBFInterpolator

    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.config import layered
    from diffphys_ros.segment.given import given_mask

    settings = layered([scenes / name / "given.yaml"])
    clip = read_clip(scenes / name / "clip.mcap", settings)
    clip = clip.with_labels(given_mask(clip, settings)[None].repeat(len(clip), 0))
    tracks = follow(clip, surface_depth(clip, settings)[0], settings)
    with np.load(scenes / name / "truth.npz") as truth:
        motion = truth["positions"] - truth["positions"][0]
        frames = range(5, len(clip), 9)
        true = [RBFInterpolator(truth["positions"][0], motion[k], neighbors=30, degree=1)(tracks.points[0]) for k in frames]
    error = np.stack([(tracks.points[k] - tracks.points[0] - u)[tracks.valid[k]].mean(0) for k, u in zip(frames, true, strict=True)])
    assert np.abs(error).max() < 2e-4  # the part that all tracks share
    rms = np.sqrt(np.mean([((tracks.points[k] - tracks.points[0] - u)[tracks.valid[k]] ** 2).mean() for k, u in zip(frames, true, strict=True)]))
    assert rms < 2e-4
    assert 0.5 < tracks.noise_m / rms < 2


def test_an_object_that_leaps_is_found_where_it_has_gone() -> None:
    """By more than half its own width between two frames, nearer to the camera."""
    leap = turned(0.0)
    leap[:3, 3] = [0.05, 0.0, 0.05]
    poses = [turned(0.0), turned(0.01), leap, leap @ turned(0.02)]
    clip = box_clip(bar(), poses, oblique_camera())
    tracks = follow(clip, surface_depth(clip, bar_settings())[0], bar_settings())
    true = np.stack([tracks.points[0] @ pose[:3, :3].T + pose[:3, 3] for pose in poses])
    assert tracks.valid[2:].mean() > 0.8
    assert np.sqrt(((tracks.points - true)[tracks.valid] ** 2).mean()) < 6e-4
