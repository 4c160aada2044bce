"""The scene behind the object, read again with the recovered motion: a sheet of known Gaussians that turns before a patterned wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from diffphys_ros.config import build
from diffphys_ros.inverse import Clock
from diffphys_ros.inverse.answer import nearness
from diffphys_ros.inverse.carried import CarriedGaussians
from diffphys_ros.inverse.refine import riding
from diffphys_ros.inverse.uncovered import COVERED, scene_uncovered, uncover
from diffphys_ros.types import Clip

from .test_refine import FRAMES, camera, sheet, turned
from .test_solve import drive

GREY = 128  # what is taken for the scene wherever the sheet stands in frame 0


def wall() -> np.ndarray:
    """Uint8 (48, 64, 3), without edges finer than a pixel."""
    noise = gaussian_filter(np.random.default_rng(2).normal(0, 1, (48, 64, 3)), (2, 2, 0))
    return np.clip(128 + 50 * noise / noise.std(), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def filmed():
    """Clip, trajectory (T, N, 3) of a block of particles around the sheet, and how much of the wall each pixel shows in each frame, (T, H, W)."""
    particles = np.stack(np.meshgrid(*(np.linspace(-e, e, n) for e, n in ((0.07, 10), (0.05, 8), (0.01, 3))), indexing="ij"), -1).reshape(-1, 3)
    trajectory = np.stack([turned(particles, k) for k in range(FRAMES)]).astype(np.float32)
    still = Clip(np.repeat(wall()[None], FRAMES, 0), 0, 1 / 30, camera(), labels=np.ones((FRAMES, 48, 64), np.uint8))
    carried = _carried(trajectory, wall())
    x = torch.as_tensor(trajectory)
    with torch.no_grad():
        alpha = carried.render(x, x[0], None, None)[1].numpy()
    labels = (alpha > 0.5).astype(np.uint8)
    return replace(still, frames=carried.clip(trajectory), labels=labels), trajectory, 1 - alpha


def _carried(trajectory: np.ndarray, behind: np.ndarray) -> CarriedGaussians:
    return CarriedGaussians.of(sheet(), trajectory[0].astype(float), camera(), behind, device="cpu")


@pytest.fixture
def case(filmed, prepared, made_recovery):
    """Prepared, a recovery whose frames are those over the scene that is wrong behind the sheet of frame 0, and that scene."""
    clip, trajectory, through = filmed
    behind = np.where(through[0, ..., None] > 0.98, wall(), np.uint8(GREY))
    recovery = replace(made_recovery, points=trajectory[0], trajectory=trajectory)
    frames = riding(sheet(), recovery, clip, behind, device="cpu").clip(trajectory)
    return replace(prepared, clip=clip), replace(recovery, frames=frames, metrics=nearness(clip, frames)), behind


def reread(case, **changes):
    prepared, recovery, behind = case
    return drive(uncover(replace(prepared, **changes), sheet(), recovery, build({}), behind=behind))[1]


def off(scene: np.ndarray, where: np.ndarray) -> float:
    return float(np.abs(scene.astype(float) - wall())[where].mean())


def test_the_scene_is_what_the_frames_show_that_uncover_it(case, filmed) -> None:
    hidden, shown = filmed[2][0] < 0.1, np.square(filmed[2]).sum(0)
    _, scene, recovery = reread(case)
    uncovered = hidden & (shown > 2)
    assert uncovered.sum() > 50
    assert off(case[2], uncovered) > 25
    assert off(scene, uncovered) < 2.5
    assert recovery.metrics["psnr_masked"] == nearness(case[0].clip, recovery.frames)["psnr_masked"]


def test_pixels_that_a_moving_outline_fills_in_part_come_nearer_to_the_video(case) -> None:
    clip, before, (*_, after) = case[0].clip, case[1], reread(case)
    error = [np.square(frames.astype(float) - clip.frames).mean() for frames in (before.frames, after.frames)]
    assert error[1] < 0.1 * error[0]
    assert after.metrics["psnr_masked_before_uncovering"] == before.metrics["psnr_masked"] < after.metrics["psnr_masked"]


def test_what_no_frame_uncovers_and_what_nothing_covers_stays(case, filmed) -> None:
    """Even where something else goes by that is no part of the object."""
    shown = np.square(filmed[2]).sum(0)
    clear = filmed[2].min(0) > 1 - COVERED
    clip = replace(case[0].clip, frames=np.where(clear[..., None], np.uint8(255), case[0].clip.frames))
    _, scene, _ = reread(case, clip=clip)
    assert clear.sum() > 100
    assert (shown < 1e-3).sum() > 100
    np.testing.assert_array_equal(scene[clear], case[2][clear])
    assert np.abs(scene[shown < 1e-3].astype(int) - GREY).max() <= 10


def test_lost_frames_and_ignored_pixels_tell_nothing_of_the_scene(case) -> None:
    clip = case[0].clip
    frames, labels = clip.frames.copy(), clip.labels.copy()
    frames[4] = 0
    frames[6, :, :32], labels[6, :, :32] = 0, 255
    without = scene_uncovered(riding(sheet(), case[1], clip, case[2], device="cpu"), case[1].trajectory, replace(clip, labels=labels, observed=np.arange(FRAMES) != 4))
    spoilt = scene_uncovered(
        riding(sheet(), case[1], clip, case[2], device="cpu"), case[1].trajectory, replace(clip, frames=frames, labels=labels, observed=np.arange(FRAMES) != 4)
    )
    np.testing.assert_array_equal(spoilt, without)


def test_motion_material_and_force_stay_as_they_are(case) -> None:
    *_, after = reread(case)
    pairs = [(a, b) for (name, a), b in zip(vars(case[1]).items(), vars(after).values(), strict=True) if name not in {"frames", "metrics"}]
    assert all(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f") for a, b in pairs)


def test_a_scene_that_is_right_and_a_clock_that_has_run_out_change_nothing(case, filmed) -> None:
    prepared, recovery, behind = case
    right = replace(recovery, frames=filmed[0].frames, metrics=nearness(filmed[0], filmed[0].frames))
    assert drive(uncover(prepared, sheet(), right, build({}), behind=wall()))[1][2] is right
    late = drive(uncover(prepared, sheet(), recovery, build({}), behind=behind, clock=Clock(1e-9)))[1]
    assert late[1] is behind
    assert late[2] is recovery
