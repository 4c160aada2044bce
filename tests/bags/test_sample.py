"""What the bundled sample promises, from its own files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.types import Clip
from tools.sample_maker.bar import CFL, FPS, GRID_CELLS, wave_speed

Truth = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def clip() -> Clip:
    return read_clip(sample_folder() / "clip.mcap", config.Settings())


@pytest.fixture(scope="module")
def truth() -> Truth:
    with np.load(sample_folder() / "truth.npz") as arrays:
        return dict(arrays)


@pytest.fixture(scope="module")
def given() -> config.Scene:
    return config.layered([sample_folder() / "given.yaml"]).scene


def forced(truth: Truth) -> np.ndarray:
    return np.flatnonzero(np.abs(truth["force"]).max((1, 2)))


def test_the_bag_is_small_and_has_colour_depth_and_pose(clip: Clip) -> None:
    assert (sample_folder() / "clip.mcap").stat().st_size < 1.5e6
    assert 36 <= len(clip) <= 45
    assert clip.frames.shape[1:] == (240, 320, 3)
    assert clip.depth is not None
    assert clip.camera.pose_known
    assert [note for note in clip.notes if "gravity" not in note] == []
    assert clip.period_s == pytest.approx(1 / 30)


def test_depth_lies_on_the_true_surface_in_every_frame(clip: Clip, truth: Truth) -> None:
    assert clip.depth is not None
    for k, positions in enumerate(truth["positions"].astype(float)):
        pixels, depth = clip.camera.project(positions)
        column, row = np.rint(pixels).astype(int).T
        error = np.abs(clip.depth[k, row, column] - depth)
        assert np.median(error[error < 0.006]) < 0.0015
        assert (error < 0.006).sum() > 30


def test_the_force_is_a_uniform_gust_across_the_axis_that_ends(truth: Truth) -> None:
    density, free = truth["force_density"], ~truth["clamped"]
    frames = forced(truth)
    assert frames[0] >= 3
    np.testing.assert_allclose(np.ptp(density[:, free], axis=1), 0, atol=1e-3)
    reach = np.ptp(truth["rest_vertices"], axis=0)
    assert np.abs(density[frames][..., reach.argmax()]).max() < 1e-3


def test_it_rests_until_the_gust_and_swings_freely_after_it(truth: Truth) -> None:
    assert np.abs(truth["positions"][:4] - truth["rest_vertices"]).max() < 5e-5
    tail = truth["positions"][forced(truth)[-1] + 1 :] - truth["rest_vertices"]
    swing = tail.reshape(len(tail), -1) @ np.linalg.svd(tail.reshape(len(tail), -1), full_matrices=False)[2][0]
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    assert len(crossings) >= 2
    period = 2 * np.diff(crossings).mean() / FPS
    assert (len(tail) - 1) / FPS / period >= 1.3


def test_it_is_short_of_two_parts_and_not_square(truth: Truth) -> None:
    length, height, thickness = -np.sort(-np.ptp(truth["rest_vertices"], axis=0))
    assert 2 < length / height < 4
    assert height / thickness > 1.1
    along = np.abs(truth["rest_vertices"][:, np.ptp(truth["rest_vertices"], axis=0).argmax()])
    assert along[truth["interface"]].max() == pytest.approx(length / 3)
    assert truth["part_E"].max() / truth["part_E"].min() > 1.2


def test_an_explicit_solver_needs_at_most_sixty_substeps_a_frame(truth: Truth, given: config.Scene) -> None:
    assert given.thickness_m is not None
    speed = wave_speed(truth["part_E"], truth["part_nu"], float(truth["part_rho"][0]))
    assert speed / FPS / (CFL * given.thickness_m / GRID_CELLS) <= 60


def test_what_a_user_is_told_is_true(clip: Clip, truth: Truth, given: config.Scene) -> None:
    assert given.mass_kg == pytest.approx(truth["vertex_mass"].sum(), rel=1e-3)
    assert given.thickness_axis is not None
    assert given.thickness_m == pytest.approx(np.ptp(truth["rest_vertices"] @ given.thickness_axis))
    low, high = np.reshape(given.clamp_box_m, (2, 3))
    inside = ((truth["rest_vertices"] >= low) & (truth["rest_vertices"] <= high)).all(1)
    np.testing.assert_array_equal(inside, truth["clamped"])
    assert given.at_rest
    assert given.first_mask is not None
    assert Path(given.first_mask).samefile(sample_folder() / "mask0.png")
