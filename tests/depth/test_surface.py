"""Depth of the object's surface in frame 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.depth import surface_depth
from diffphys_ros.errors import InputError
from diffphys_ros.surface_plane import plane_depth
from diffphys_ros.types import Clip
from tests.boxes import bar, bar_settings, box_clip, camera_at, oblique_camera


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(), [np.eye(4)], oblique_camera())


def exact_depth(clip: Clip) -> np.ndarray:
    """Depth of the unquantised scene (H, W)."""
    from tests.boxes import _trace

    pixels = np.stack(np.meshgrid(np.arange(clip.camera.width), np.arange(clip.camera.height)), -1).astype(float)
    return _trace(bar(), np.eye(4), clip.camera, None, pixels)[2]


def test_a_plane_is_read_exactly_between_pixels() -> None:
    u, v = np.meshgrid(np.arange(40.0), np.arange(30.0))
    depth = 1 / (1.1 + 0.004 * u - 0.007 * v)
    at = np.random.default_rng(0).uniform((4, 4), (35, 25), (50, 2))
    found, share = plane_depth(depth, at)
    assert np.allclose(found, 1 / (1.1 + 0.004 * at[:, 0] - 0.007 * at[:, 1]), rtol=1e-6)
    assert (share == 1).all()


def test_a_step_in_depth_is_not_averaged() -> None:
    depth = np.full((40, 40), 1.0)
    depth[:, 20:] = 1.5
    found, share = plane_depth(depth, np.array([[18.0, 20.0], [21.0, 20.0], [5.0, 5.0]]))
    assert np.allclose(found, [1.0, 1.5, 1.0])
    assert share[0] < share[2] == 1


def test_unknown_centres_and_masked_pixels_have_no_depth() -> None:
    depth = np.full((20, 20), 2.0)
    depth[10, 10] = 0
    mask = np.ones((20, 20), bool)
    mask[5, 5] = False
    found, share = plane_depth(depth, np.array([[10.0, 10.0], [5.0, 5.0], [-3.0, 4.0], [15.0, 15.0]]), mask=mask)
    assert np.allclose(found, [0, 0, 0, 2.0])
    assert (share[:3] == 0).all()


def test_the_quantisation_of_a_depth_topic_is_smoothed(clip: Clip) -> None:
    depth, source = surface_depth(clip, bar_settings())
    on = clip.labels[0] > 0
    raw, smooth = (np.abs(d[on] - exact_depth(clip)[on]) for d in (clip.depth[0], depth))
    assert source.words == "depth topic"
    assert smooth.mean() < 0.5 * raw.mean()
    assert (depth[~on] == 0).all()
    assert depth.dtype == np.float32


def test_holes_of_the_depth_image_are_filled_on_the_object(clip: Clip) -> None:
    holed = clip.depth.copy()
    on = np.argwhere(clip.labels[0] > 0)
    for v, u in on[::257]:
        holed[0, v - 2 : v + 3, u - 2 : u + 3] = 0
    depth, _ = surface_depth(replace(clip, depth=holed), bar_settings())
    inside = clip.labels[0] > 0
    assert (depth[inside] > 0).all()
    assert np.quantile(np.abs(depth - exact_depth(clip))[inside], 0.98) < 3e-3


def test_a_depth_image_that_misses_the_object_is_refused(clip: Clip) -> None:
    empty = np.where(clip.labels > 0, 0, clip.depth)
    with pytest.raises(InputError, match=r"no value on the object.*topics\.depth"):
        surface_depth(replace(clip, depth=empty), bar_settings())


def test_without_depth_the_slab_stands_where_the_clamp_puts_it(clip: Clip) -> None:
    depth, source = surface_depth(replace(clip, depth=None), bar_settings())
    on = clip.labels[0] > 0
    error = np.abs(depth - exact_depth(clip))[on]
    assert "clamp" in source.surface
    assert "clamp_box_m" in source.scale
    assert np.quantile(error, 0.9) < 2.5e-3  # front, top and end face alike
    assert np.median(error) < 2e-4


def test_without_depth_and_clamp_the_distance_is_assumed_and_said(clip: Clip) -> None:
    depth, source = surface_depth(replace(clip, depth=None), bar_settings(scene__clamp_box_m=None))
    assert source.scale.startswith("unknown")
    assert "1 m away" in source.words
    assert np.array_equal(depth > 0, clip.labels[0] > 0)
    assert set(np.unique(depth)) == {0.0, 1.0}


def test_ignored_pixels_get_no_depth(clip: Clip) -> None:
    labels = clip.labels.copy()
    labels[0, :60] = 255
    depth, _ = surface_depth(replace(clip, labels=labels), bar_settings())
    assert (depth[:60] == 0).all()


def test_a_front_seen_squarely_is_flat_without_depth() -> None:
    clip = box_clip(bar(), [np.eye(4)], camera_at((0.12, -0.6, 0.0), (0.12, 0, 0)), depth=False)
    depth, _ = surface_depth(clip, bar_settings())
    assert np.allclose(depth[depth > 0], 0.575, atol=1e-3)
