"""Depth without a depth topic, and what fixes its scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.depth import SOURCES, surface_depth
from diffphys_ros.depth.network import metric_depth, scaled_inverse
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip
from tests.boxes import bar, bar_settings, box_clip, camera_at, oblique_camera


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(), [np.eye(4)], oblique_camera())


@pytest.fixture(scope="module")
def square_on() -> Clip:
    """The bar's front, 0.24 x 0.06 m, 0.575 m before the camera."""
    return box_clip(bar(), [np.eye(4)], camera_at((0.12, -0.6, 0.0), (0.12, 0, 0)), depth=False)


def without_scale(**values: object):
    return bar_settings(scene__clamp_box_m=None, **values)


@pytest.mark.parametrize("source", ["inflate", "plane"])
def test_a_known_size_puts_the_object_where_it_is(square_on: Clip, source: str) -> None:
    diagonal = float(np.hypot(0.24, 0.06))
    depth, found = surface_depth(square_on, without_scale(depth__source=source, scene__size_m=diagonal))
    assert np.allclose(depth[depth > 0], 0.575, rtol=0.02)  # to a pixel of the silhouette
    assert found.scale.startswith("size_m")


@pytest.mark.parametrize("source", ["inflate", "plane"])
def test_a_scale_that_nothing_fixes_is_stated_as_unknown(square_on: Clip, source: str) -> None:
    assert surface_depth(square_on, without_scale(depth__source=source))[1].scale.startswith("unknown")


def test_inverse_depth_of_any_factor_and_offset_is_fitted_to_the_depth_topic(clip: Clip) -> None:
    """A network right up to factor and offset, with a tenth of the object wrong."""
    mask = clip.labels[0] > 0
    relative = np.where(clip.depth[0] > 0, 7 / np.maximum(clip.depth[0], 0.1) - 3, 0.0)
    wrong = relative.copy()
    wrong[mask & (np.arange(mask.shape[1]) > 200)] += 2.0
    depth, scale = scaled_inverse(wrong, clip, mask, bar_settings())
    good = mask & (wrong == relative)
    assert scale == "depth topic"
    assert np.abs(depth - clip.depth[0])[good].max() < 2e-3


def test_relative_depth_without_a_topic_keeps_order_distance_and_half_the_thickness(clip: Clip) -> None:
    flat = replace(clip, depth=None)
    mask = clip.labels[0] > 0
    depth, scale = scaled_inverse(1 / np.maximum(clip.depth[0], 0.1), flat, mask, bar_settings())
    assert "clamp_box_m" in scale
    assert np.median(depth[mask]) == pytest.approx(np.median(clip.depth[0][mask]), rel=0.02)
    assert np.ptp(np.quantile(depth[mask], (0.05, 0.95))) == pytest.approx(0.025, rel=0.05)
    assert np.corrcoef(depth[mask], clip.depth[0][mask])[0, 1] > 0.99


def test_a_networks_metres_are_kept_unless_the_scene_says_more(square_on: Clip) -> None:
    mask = square_on.labels[0] > 0
    said = np.full(mask.shape, 2.0)
    depth, scale = metric_depth(said, square_on, mask, without_scale())
    assert "unchecked" in scale
    assert np.array_equal(depth, said)
    assert np.allclose(metric_depth(said, square_on, mask, bar_settings())[0], 0.575, rtol=0.01)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [({"depth__source": "topic"}, "has no depth images"), ({"depth__source": "network"}, "depth.model is not set")],
)
def test_a_source_that_the_clip_does_not_allow_is_refused(square_on: Clip, values: dict[str, str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        surface_depth(square_on, bar_settings(**values))


def test_a_depth_topic_can_be_set_aside(clip: Clip) -> None:
    assert surface_depth(clip, bar_settings(depth__source="plane"))[1].surface.startswith("a plane")


def test_every_source_has_a_choice_in_the_settings() -> None:
    from diffphys_ros.config import leaves

    assert {"auto", *SOURCES} == set(leaves()["depth.source"].choices)
