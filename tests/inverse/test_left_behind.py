"""Gaussians of the scene that the mask of frame 0 takes for the object: round a sheet of known Gaussians that moves before a patterned wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffphys_ros.config import build, layered
from diffphys_ros.inverse.answer import nearness
from diffphys_ros.inverse.carried import CarriedGaussians
from diffphys_ros.inverse.left_behind import MOST, scene_in_mask
from diffphys_ros.inverse.refine import riding
from diffphys_ros.inverse.uncovered import uncover
from diffphys_ros.types import Clip, Splats

from .test_paper import FILE
from .test_refine import FRAMES, camera
from .test_solve import drive
from .test_uncovered import GREY, wall

PUBLISHED = layered([FILE], {})


def shifted(points: np.ndarray, k: int) -> np.ndarray:
    """Points (N, 3) in frame k: to the right and back, by three pixels at most."""
    return points + np.array([0.011 * np.sin(np.pi * k / (FRAMES - 1)), 0, 0])


def sheet() -> Splats:
    """In the plane z = 0, with an outline as sharp as a fit draws it."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.06, 0.06, 61), np.linspace(-0.045, 0.045, 46)))
    return _discs(np.stack([x, y, 0 * x], 1), np.random.default_rng(0).uniform(0.1, 0.9, (len(x) // 23, 3)).repeat(23, 0))


def _discs(mean: np.ndarray, color: np.ndarray) -> Splats:
    count = len(mean)
    arrays = (mean, np.tile([1.0, 0, 0, 0], (count, 1)), np.tile([0.002, 0.002, 0.0004], (count, 1)), np.full(count, 0.9), color)
    return Splats(*(np.asarray(a, np.float32) for a in arrays))


def rim() -> Splats:
    """The wall as frame 0 shows it within three pixels of the sheet, as Gaussians; so few that the mask may be wrong and not the motion."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.075, 0.075, 42), np.linspace(-0.055, 0.055, 31)))
    beside = (np.abs(x) > 0.064) | (np.abs(y) > 0.049)
    mean = np.stack([x, y, 0 * x], 1)[beside]
    u, v = np.rint(camera().project(mean)[0]).astype(int).T
    return _discs(mean, wall()[v, u] / 255)


def both() -> Splats:
    return Splats(*(np.concatenate(pair) for pair in zip(vars(sheet()).values(), vars(rim()).values(), strict=True)))


@pytest.fixture(scope="module")
def filmed():
    """Clip of the sheet alone before the wall, and trajectory (T, N, 3) of a block of particles around both."""
    particles = np.stack(np.meshgrid(*(np.linspace(-e, e, n) for e, n in ((0.08, 11), (0.06, 9), (0.01, 3))), indexing="ij"), -1).reshape(-1, 3)
    trajectory = np.stack([shifted(particles, k) for k in range(FRAMES)]).astype(np.float32)
    carried, x = CarriedGaussians.of(sheet(), trajectory[0].astype(float), camera(), wall(), device="cpu"), torch.as_tensor(trajectory)
    with torch.no_grad():
        labels = (carried.render(x, x[0], None, None)[1].numpy() > 0.5).astype(np.uint8)
    return Clip(carried.clip(trajectory), 0, 1 / 30, camera(), labels=labels), trajectory


@pytest.fixture
def case(filmed, prepared, made_recovery):
    """Prepared, a recovery whose frames are those of sheet and rim over a scene that is wrong behind them, and that scene."""
    clip, trajectory = filmed
    behind = np.where(clip.labels[0, ..., None] > 0, np.uint8(GREY), wall())
    recovery = replace(made_recovery, points=trajectory[0], trajectory=trajectory)
    frames = riding(both(), recovery, clip, behind, device="cpu").clip(trajectory)
    return replace(prepared, clip=clip), replace(recovery, frames=frames, metrics=nearness(clip, frames)), behind


def stays(case, splats: Splats, trajectory: np.ndarray | None = None) -> np.ndarray:
    prepared, recovery, behind = case
    x = recovery.trajectory if trajectory is None else trajectory
    carried = CarriedGaussians.of(splats, x[0].astype(float), camera(), behind, device="cpu")
    return scene_in_mask(splats, carried, x, carried.clip(x), prepared.clip)[0]


def test_what_stands_still_round_a_moving_sheet_is_the_scenes_and_the_sheet_is_not(case) -> None:
    found, own = stays(case, both()), len(sheet().mean)
    sides = np.abs(rim().mean[:, 0]) > 0.064  # where the sheet moves over the wall, and the rim with it
    assert found[own:][sides].mean() > 0.4
    assert found[:own].mean() < 0.03


def test_a_sheet_that_moves_as_the_clip_shows_it_keeps_all_its_gaussians(case) -> None:
    assert not stays(case, sheet()).any()


def test_a_body_that_does_not_move_tells_nothing(case) -> None:
    assert not stays(case, both(), np.repeat(case[1].trajectory[:1], FRAMES, 0)).any()


def test_where_much_stands_still_the_motion_is_wrong_and_not_the_mask(case) -> None:
    still = replace(case[0].clip, frames=np.repeat(case[0].clip.frames[:1], FRAMES, 0))
    found = stays((replace(case[0], clip=still), *case[1:]), sheet())
    assert MOST < 0.5
    assert not found.any()


def test_under_the_published_schedule_they_are_left_behind_and_the_video_comes_nearer(case) -> None:
    prepared, recovery, behind = case
    splats = both()
    kept, _, alone = drive(uncover(prepared, splats, recovery, build({}), behind=behind))[1]
    fewer, scene, found = drive(uncover(prepared, splats, recovery, PUBLISHED, behind=behind))[1]
    assert kept is splats
    assert len(fewer.mean) == len(splats.mean) - found.metrics["gaussians_left_behind"]
    error = [np.square(each.frames[1:].astype(float) - prepared.clip.frames[1:]).mean() for each in (recovery, alone, found)]
    assert error[2] < 0.7 * error[1] < 0.7 * error[0]
    assert found.metrics["psnr_masked"] == nearness(prepared.clip, found.frames)["psnr_masked"]
    np.testing.assert_array_equal(found.frames, riding(fewer, found, prepared.clip, scene, device="cpu").clip(found.trajectory))
