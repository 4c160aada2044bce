"""How far depth lets an object reach beyond what moves of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.segment.surroundings import ends_inside, reachable
from diffphys_ros.types import Clip
from tests.boxes import Box, bar, bar_settings, box_clip, oblique_camera

MOUNT = Box(np.array([-0.04, -0.025, -0.03]), np.array([0.0, 0.025, 0.03]))  # goes on flush where the bar ends


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(), [np.eye(4)], oblique_camera(), mount=MOUNT)


def tip(clip: Clip, *, rim: int) -> np.ndarray:
    """The outer half of the bar with so many pixels of the wall around it."""
    true, core = clip.labels[0] > 0, np.zeros(clip.labels.shape[1:], bool)
    v, u = np.nonzero(true)
    core[max(v.min() - rim, 0) : v.max() + 1 + rim, (u.min() + u.max()) // 2 : u.max() + 1 + rim] = True
    return core & (true | (rim > 0))


def test_without_depth_everything_can_be_reached(clip: Clip) -> None:
    assert reachable(replace(clip, depth=None), tip(clip, rim=0), bar_settings()).all()


def test_the_surface_goes_on_to_the_clamped_face_and_no_farther(clip: Clip) -> None:
    true = clip.labels[0] > 0
    found = reachable(clip, tip(clip, rim=0), bar_settings())
    assert found[true].mean() > 0.99
    assert found[~true].mean() < 0.02


def test_without_a_clamp_a_flush_mount_comes_along_but_never_the_wall(clip: Clip) -> None:
    mount = (clip.depth[0] < 0.7) & (clip.labels[0] == 0)
    found = reachable(clip, tip(clip, rim=0), bar_settings(scene__clamp_box_m=None))
    assert found[mount].mean() > 0.9
    assert not found[clip.depth[0] > 0.8].any()


def test_a_rim_of_the_wall_in_what_moves_does_not_bring_the_wall(clip: Clip) -> None:
    core = tip(clip, rim=5)
    found = reachable(clip, core, bar_settings())
    assert not (found & ~core)[clip.depth[0] > 0.8].any()
    assert found[clip.labels[0] > 0].mean() > 0.99


def test_holes_of_the_depth_image_do_not_cut_the_surface(clip: Clip) -> None:
    holed = clip.depth.copy()
    holed[0, :, 100:106] = 0
    assert reachable(replace(clip, depth=holed), tip(clip, rim=0), bar_settings())[clip.labels[0] > 0].mean() > 0.99


def test_a_mount_whose_front_is_flush_with_the_clamped_face_stays_behind() -> None:
    wide = Box(np.array([-0.04, -0.06, -0.07]), np.array([0.0, 0.06, 0.07]))
    clip = box_clip(bar(), [np.eye(4)], oblique_camera(), mount=wide)
    mount = (clip.depth[0] < 0.7) & (clip.labels[0] == 0)
    noise = np.random.default_rng(0).normal(0, 1e-3, clip.depth.shape).astype(np.float32)
    found = reachable(replace(clip, depth=clip.depth + noise), tip(clip, rim=0), bar_settings())
    assert found[mount].mean() < 0.1
    assert found[clip.labels[0] > 0].mean() > 0.97


def test_a_surface_ends_inside_the_picture_where_steps_and_clamp_bound_it(clip: Clip) -> None:
    within = reachable(clip, tip(clip, rim=0), bar_settings())
    assert ends_inside(clip, within, bar_settings())[clip.labels[0] > 0].mean() > 0.99
    assert not ends_inside(clip, np.ones_like(within), bar_settings()).any()  # it goes on beyond the picture
    assert not ends_inside(clip, within, bar_settings(scene__clamp_box_m=None)).any()
    assert not ends_inside(replace(clip, depth=None), within, bar_settings()).any()
