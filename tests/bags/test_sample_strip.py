"""What the bundled strip promises, from its own files."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.types import Clip

Truth = dict[str, np.ndarray]
LENGTH_M = 0.3


@pytest.fixture(scope="module")
def clip() -> Clip:
    return read_clip(sample_folder("strip") / "clip.mcap", config.Settings())


@pytest.fixture(scope="module")
def truth() -> Truth:
    with np.load(sample_folder("strip") / "truth.npz") as arrays:
        return dict(arrays)


def net_force(truth: Truth) -> np.ndarray:
    return np.linalg.norm(truth["force"].sum(1), axis=1)


def test_the_folder_is_small_and_the_bag_has_colour_depth_and_pose(clip: Clip) -> None:
    assert sum(file.stat().st_size for file in sample_folder("strip").iterdir()) < 1.5e6
    assert 36 <= len(clip) <= 48
    assert clip.depth is not None
    assert clip.camera.pose_known


def test_it_hangs_under_gravity_and_rests_until_the_gust(truth: Truth) -> None:
    assert truth["gravity"][2] < -9
    sag = truth["positions"][0] - truth["rest_vertices"]
    assert sag[:, 2].min() < -5e-4
    assert np.abs(sag[:, :2]).max() < 5e-4
    assert np.abs(truth["positions"][:4] - truth["positions"][0]).max() < 5e-5


def test_its_tip_swings_beyond_a_third_of_its_length_and_then_freely(truth: Truth) -> None:
    tip = truth["rest_vertices"][:, 2] < truth["rest_vertices"][:, 2].min() + 1e-6
    swing = truth["positions"][:, tip].mean(1) - truth["positions"][0, tip].mean(0)
    assert np.linalg.norm(swing, axis=1).max() > LENGTH_M / 3
    forced = np.flatnonzero(net_force(truth))
    assert forced.tolist() == [*range(forced[0], forced[-1] + 1)]
    assert forced[0] >= 3
    tail = swing[forced[-1] + 1 :, 0]
    assert (np.diff(np.sign(tail)) != 0).sum() >= 3
    assert np.abs(tail).max() > LENGTH_M / 4


def test_what_a_user_is_told_is_true(truth: Truth) -> None:
    given = config.layered([sample_folder("strip") / "given.yaml"]).scene
    assert given.mass_kg == pytest.approx(truth["vertex_mass"].sum(), rel=1e-3)
    assert given.gravity_m_s2 is not None
    np.testing.assert_allclose(given.gravity_m_s2, truth["gravity"], atol=0.01)
    low, high = np.reshape(given.clamp_box_m, (2, 3))
    inside = ((truth["rest_vertices"] >= low) & (truth["rest_vertices"] <= high)).all(1)
    np.testing.assert_array_equal(inside, truth["clamped"])
    assert given.at_rest
