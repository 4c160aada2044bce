"""What tracks claim about their own error."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import store
from diffphys_ros.depth import surface_depth
from diffphys_ros.tracks import follow
from diffphys_ros.tracks.noise import position_sd
from diffphys_ros.types import Clip, Tracks
from tests.boxes import bar, bar_settings, box_clip, oblique_camera, turned

FRAMES = 12
EYE = np.array([0.0, 0.0, -2.0])


def poses() -> list[np.ndarray]:
    return [turned(0.12 * np.sin(0.5 * k)) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def clip() -> Clip:
    """Frames under a sensor's noise, one half of the bar worse lit than the other; depth with a noise of 0.8 mm."""
    rng, clean = np.random.default_rng(3), box_clip(bar(), poses(), oblique_camera())
    dim = np.where(np.arange(240) < 120, 0.25, 1.0)[:, None]
    frames = np.clip(clean.frames * dim + rng.normal(0, 3, clean.frames.shape), 0, 255).astype(np.uint8)
    depth = clean.depth + rng.normal(0, 8e-4, clean.depth.shape).astype(np.float32)
    return Clip(frames, 0, clean.period_s, clean.camera, depth, clean.labels)


def test_the_claimed_deviations_are_those_of_the_true_errors_for_sure_and_for_vague_tracks(clip: Clip) -> None:
    tracks = follow(clip, surface_depth(clip, bar_settings())[0], bar_settings())
    true = np.stack([tracks.points[0] @ pose[:3, :3].T + pose[:3, 3] for pose in poses()])
    error, sight = tracks.points - true, tracks.points[0] - clip.camera.position
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    along = (error * sight).sum(-1)
    across = np.sqrt(((error - along[..., None] * sight) ** 2).sum(-1) / 2)
    holds = tracks.valid & (np.arange(FRAMES) > 0)[:, None]
    for found, claimed in ((across[holds], tracks.sd_m[holds, 0]), (along[holds], tracks.sd_m[holds, 1])):
        order = np.array_split(np.argsort(claimed, kind="stable"), 4)
        ratio = [np.sqrt((found[q] ** 2).mean() / (claimed[q] ** 2).mean()) for q in order]
        assert min(ratio) > 0.5
        assert max(ratio) < 1.7
    sure, vague = (np.array_split(np.argsort(tracks.sd_m[holds, 0]), 4)[i] for i in (0, -1))
    assert np.sqrt((across[holds][vague] ** 2).mean()) > 1.8 * np.sqrt((across[holds][sure] ** 2).mean())


def sheet(across_m: np.ndarray, along_m: np.ndarray, *, frames: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """A bending sheet that looks at a camera far away, tracked with Gaussian errors per track: (T, M, 3) and the patches' word (T, M)."""
    rng = np.random.default_rng(0)
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, 0.2, 18), np.linspace(0, 0.1, 12)))
    k = np.arange(frames)[:, None]
    bend = 0.02 * np.sin(0.3 * k) * u**2 / 0.04
    points = np.stack([u + 0 * bend, v + bend, 0 * bend + 0 * u], -1)
    points[1:] += rng.normal(size=points[1:].shape) * np.stack([across_m, across_m, along_m], -1)
    return points, np.broadcast_to(7 * across_m, (frames, len(u))).copy()


def test_each_track_is_given_its_own_deviation_and_each_direction() -> None:
    rng = np.random.default_rng(1)
    across, along = rng.choice([1e-4, 4e-4], 216), rng.choice([3e-4, 9e-4], 216)
    points, by_patch = sheet(across, along)
    sd = position_sd(points, np.ones(points.shape[:2], bool), by_patch, EYE, along=True)[1:].mean(0)
    assert np.median(sd[:, 0] / across) == pytest.approx(1.0, abs=0.25)
    assert np.median(sd[:, 1] / along) == pytest.approx(1.0, abs=0.25)
    assert np.corrcoef(sd[:, 1], along)[0, 1] > 0.8


def test_what_does_not_hold_or_is_not_seen_is_infinitely_vague_and_frame_zero_is_sure() -> None:
    points, by_patch = sheet(np.full(216, 1e-4), np.full(216, 1e-4))
    valid = np.ones(points.shape[:2], bool)
    valid[5, 7] = False
    sd = position_sd(points, valid, by_patch, EYE, along=False)
    assert np.isinf(sd[5, 7]).all()
    assert np.isinf(sd[1:, :, 1]).all()
    assert np.isfinite(sd[6, :, 0]).all()
    assert not sd[0].any()


def test_tracks_written_before_there_were_deviations_are_read(tmp_path: Path) -> None:
    tracks = Tracks(np.zeros((2, 3, 2)), np.ones((2, 3, 3)), np.ones((2, 3), bool), True, 1e-4, np.ones((2, 3, 2)))
    arrays = store.read_arrays(store.save(tmp_path / "clip.npz", tracks), "clip")
    outline = json.loads(str(arrays["outline"]))
    del outline["fields"]["sd_m"]
    older = store.write_arrays(tmp_path / "older.npz", arrays | {"outline": np.array(json.dumps(outline))})
    assert store.load(older, [Tracks]).sd_m is None
    assert store.load(tmp_path / "clip.npz", [Tracks]).sd_m.all()
