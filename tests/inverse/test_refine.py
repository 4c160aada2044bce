"""Gaussians fitted on to many frames with the recovered motion held: a sheet of known Gaussians that turns in front of the camera."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros.config import build
from diffphys_ros.inverse import Clock
from diffphys_ros.inverse.answer import nearness
from diffphys_ros.inverse.refine import frames_to_fit, mean_psnr, refine_gaussians, riding, unfitted_frames
from diffphys_ros.render import Rasterizer
from diffphys_ros.splats import ply
from diffphys_ros.types import Camera, Clip, Splats

from .test_solve import drive

FRAMES = 9
SETTINGS = build({"experiment.refine_frames": 4})


def camera():
    """Looks along z from 0.4 m."""
    pose = np.eye(4)
    pose[2, 3] = -0.4
    return Camera(np.array([[110.0, 0, 31.5], [0, 110.0, 23.5], [0, 0, 1]]), pose, 64, 48)


def sheet():
    """Gaussians of a sheet in the plane z = 0."""
    rng = np.random.default_rng(0)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.06, 0.06, 21), np.linspace(-0.045, 0.045, 16)))
    count = len(x)
    scale = np.tile([0.004, 0.004, 0.0004], (count, 1))
    color = rng.uniform(0.1, 0.9, (count, 3))
    arrays = (np.stack([x, y, 0 * x], 1), np.tile([1.0, 0, 0, 0], (count, 1)), scale, np.full(count, 0.9), color)
    return ply.canonical(Splats(*(np.asarray(a, np.float32) for a in arrays)))


def turned(points, k):
    """Points (N, 3) in frame k: a turn about the vertical axis."""
    return Rotation.from_rotvec([0, 0.1 * k, 0]).apply(points)


@pytest.fixture(scope="module")
def truth():
    """Clip and trajectory (T, N, 3) of a block of particles around the sheet."""
    particles = np.stack(np.meshgrid(*(np.linspace(-e, e, n) for e, n in ((0.07, 10), (0.05, 8), (0.01, 3))), indexing="ij"), -1).reshape(-1, 3)
    trajectory = np.stack([turned(particles, k) for k in range(FRAMES)])
    splats, rasterizer, frames, labels = sheet(), Rasterizer(camera()), [], []
    for k in range(FRAMES):
        turn = Rotation.from_rotvec([0, 0.1 * k, 0]).as_quat()[[3, 0, 1, 2]]
        mean, rotation = (torch.as_tensor(a, dtype=torch.float32) for a in (turned(splats.mean, k), np.tile(turn, (len(splats.mean), 1))))
        shared = (torch.from_numpy(a) for a in (splats.scale, splats.opacity, splats.color))
        image, alpha, _ = rasterizer.render(mean, rotation, *shared, torch.full((3,), 0.3))
        frames.append((image.clamp(0, 1) * 255).round().to(torch.uint8).numpy())
        labels.append((alpha > 0.5).numpy().astype(np.uint8))
    return Clip(np.stack(frames), 0, 1 / 30, camera(), labels=np.stack(labels)), trajectory


@pytest.fixture
def case(truth, prepared, made_recovery):
    clip, trajectory = truth
    recovery = replace(made_recovery, points=trajectory[0], trajectory=trajectory.astype(np.float32))
    return replace(prepared, clip=clip), recovery


def test_a_clock_that_has_run_out_leaves_the_gaussians_of_frame_0_and_says_so(case):
    prepared, recovery = case
    _, (splats, kept) = drive(refine_gaussians(prepared, sheet(), recovery, SETTINGS, clock=Clock(1e-9)))
    np.testing.assert_array_equal(splats.color, sheet().color)
    assert kept.frames is recovery.frames
    assert kept.metrics["stopped_by_budget"] is True
    assert "the time budget of 0 s is spent" in kept.notes[-1]


def finish(prepared, splats, recovery, settings=SETTINGS):
    """What is returned, with the frames that `splats` show put into the recovery first."""
    background = np.full_like(prepared.clip.frames[0], round(0.3 * 255))
    frames = riding(splats, recovery, prepared.clip, background, device="cpu").clip(recovery.trajectory)
    shown = replace(recovery, frames=frames, metrics=nearness(prepared.clip, frames))
    steps = refine_gaussians(prepared, splats, shown, settings)
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return shown, *stop.value


def discoloured():
    noise = np.random.default_rng(1).normal(0, 0.15, sheet().color.shape)
    return replace(sheet(), color=(sheet().color + noise).clip(0, 1).astype(np.float32))


def test_carried_gaussians_show_the_clip(case):
    prepared, recovery = case
    frames = finish(prepared, sheet(), recovery, build({"experiment.refine_frames": 0}))[0].frames
    assert np.abs(frames.astype(float) - prepared.clip.frames)[prepared.clip.labels > 0].mean() < 2


def test_frames_that_were_not_fitted_come_nearer_too_and_say_so(case):
    prepared, recovery = case
    before, splats, after = finish(prepared, discoloured(), recovery)
    left_out = unfitted_frames(prepared.clip, np.array(after.metrics["gaussians_fitted_frames"]))
    assert after.metrics["gaussians_fitted_frames"] == [0, 3, 5, 8]
    assert left_out.tolist() == [1, 2, 4, 6, 7]
    mask = prepared.clip.labels[left_out] > 0
    error = [np.square(f[left_out].astype(float) - prepared.clip.frames[left_out])[mask].mean() for f in (before.frames, after.frames)]
    assert error[1] < 0.5 * error[0]
    assert not np.array_equal(splats.color, discoloured().color)
    assert after.metrics["psnr_masked"] > before.metrics["psnr_masked"] == after.metrics["psnr_masked_before_refinement"]
    assert after.metrics["psnr_masked_unfitted_frames"] == pytest.approx(mean_psnr(prepared.clip, after.frames, left_out))


def test_motion_material_and_force_stay_as_they_are(case):
    prepared, recovery = case
    before, _, after = finish(prepared, discoloured(), recovery)
    changed = {"frames", "metrics"}
    pairs = [(a, b) for (name, a), b in zip(vars(before).items(), vars(after).values(), strict=True) if name not in changed]
    assert all(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f") for a, b in pairs)


def test_gaussians_that_cannot_get_better_are_kept(case):
    prepared, recovery = case
    before, splats, after = finish(prepared, sheet(), recovery)
    assert np.array_equal(splats.mean, sheet().mean)
    assert np.array_equal(before.frames, after.frames)
    assert "gaussians_fitted_frames" not in after.metrics


def test_without_frames_to_fit_nothing_is_done(case):
    prepared, recovery = case
    before, _, after = finish(prepared, discoloured(), recovery, build({"experiment.refine_frames": 0}))
    assert after is before


def test_only_received_frames_that_show_the_object_are_fitted(truth):
    clip, _ = truth
    labels = clip.labels.copy()
    labels[4] = 0
    partly = replace(clip, labels=labels, observed=np.arange(FRAMES) != 2)
    assert frames_to_fit(partly, 100).tolist() == [0, 1, 3, 5, 6, 7, 8]
    assert frames_to_fit(partly, 3).tolist() == [0, 5, 8]
    assert unfitted_frames(partly, frames_to_fit(partly, 3)).tolist() == [1, 3, 6, 7]
