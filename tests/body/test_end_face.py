"""A body that is clamped askew is held where its outline ends, not at a face of its box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.body import build_body
from diffphys_ros.body.end_face import lean_of_end
from diffphys_ros.depth import surface_depth
from diffphys_ros.types import Body
from tests.boxes import Box, bar, bar_settings, box_clip, oblique_camera, turned

PIXEL_M = 0.0016
HALF_WIDTH_M = 0.045
BEFORE_IT = np.stack([np.full(40, -0.02), np.linspace(0.012, HALF_WIDTH_M, 40)], -1)  # below one side of an end that leans by 20 degrees
BOX = [-0.02, -0.03, -0.045, 0.005, 0.03, 0.045]  # around an end of the bar that leans, up to 5 mm beyond its centre


def askew(degrees: float, *, depth: bool = True, mount: Box | None = None) -> Body:
    """The solid of a bar that leaves its clamp at an angle in the picture."""
    clip = box_clip(bar(), [turned(np.deg2rad(degrees))], oblique_camera(), mount=mount)
    settings = bar_settings(scene__clamp_box_m=BOX)
    clip = clip if depth else replace(clip, depth=None)
    return build_body(clip, surface_depth(clip, settings)[0], settings)


def direction(body: Body) -> float:
    """Angle of the body's x axis in the picture's plane [deg]."""
    x = body.world_from_body[:3, 0]
    return float(np.rad2deg(np.arctan2(-x[2], x[0])))


@pytest.mark.parametrize("degrees", [-25.0, -12.0, 8.0, 20.0])
def test_the_body_leaves_a_clamp_that_leans_at_a_right_angle(degrees: float) -> None:
    body = askew(degrees)
    assert direction(body) == pytest.approx(degrees, abs=1.0)
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.015)
    assert "degrees off the box face" in body.sources["clamp"]


def test_all_of_a_leaning_end_lies_on_the_clamped_plane() -> None:
    root = askew(20.0).inside[1]
    assert root.sum() * askew(20.0).pitch_m == pytest.approx(0.06, abs=2 * PIXEL_M)


def test_a_lean_is_seen_without_depth() -> None:
    assert direction(askew(20.0, depth=False)) == pytest.approx(20.0, abs=1.5)


def test_a_level_end_stays_on_its_box() -> None:
    body = askew(0.0)
    assert direction(body) == 0.0
    assert "clamp" not in body.sources


def test_a_leaning_bar_that_a_mount_hides_is_held_where_it_was_told() -> None:
    """A stem that grows askew out of level ground is held at the ground."""
    mount = Box(np.array([-0.06, -0.06, -0.09]), np.array([0.005, 0.06, 0.09]))
    assert direction(askew(15.0, mount=mount)) == 0.0


def bar_points(degrees: float, *, wave_m: float = 0.0, shift_m: float = 0.0, width_m: float = 0.06) -> np.ndarray:
    """Pixels (P, 2) on a bar that leaves x = 0 at an angle; its end may be wavy, or lie elsewhere."""
    along, across = np.meshgrid(np.arange(0, 0.2, PIXEL_M / 2), np.arange(-width_m / 2, width_m / 2, PIXEL_M / 2))
    along = along + shift_m + wave_m * np.sin(2 * across / width_m * np.pi)
    lean = np.deg2rad(degrees)
    return np.stack([along * np.cos(lean) + across * np.sin(lean), across * np.cos(lean) - along * np.sin(lean)], -1).reshape(-1, 2)


@pytest.mark.parametrize("degrees", [-30.0, -5.0, 5.0, 30.0])
def test_the_lean_of_an_end_is_read_to_half_a_degree(degrees: float) -> None:
    assert np.rad2deg(lean_of_end(bar_points(degrees), PIXEL_M, HALF_WIDTH_M)) == pytest.approx(degrees, abs=0.7)


@pytest.mark.parametrize("degrees", [-30.0, -17.0, 17.0, 30.0])
def test_the_sides_of_a_narrow_bar_over_a_wide_box_are_no_part_of_its_end(degrees: float) -> None:
    points = bar_points(degrees, width_m=0.04)
    assert np.rad2deg(lean_of_end(points, PIXEL_M, 2 * HALF_WIDTH_M)) == pytest.approx(degrees, abs=1.5)


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (bar_points(0.0), "level"),
        (bar_points(1.0), "within what pixels make of a level end"),
        (bar_points(20.0, wave_m=0.012), "on no line"),
        (bar_points(20.0, wave_m=0.012, width_m=0.04), "on no line, of a narrow bar"),
        (np.concatenate([bar_points(20.0), BEFORE_IT]), "what lies before a part of it"),
        (bar_points(20.0, shift_m=0.02), "beyond the told face"),
        (bar_points(20.0)[:0], "nothing seen"),
        (bar_points(55.0), "more than a clamp leans"),
    ],
    ids=lambda value: value.replace(" ", "_") if isinstance(value, str) else "",
)
def test_an_end_that_says_nothing_of_the_clamp_leans_by_nothing(points: np.ndarray, why: str) -> None:
    assert lean_of_end(points, PIXEL_M, HALF_WIDTH_M) == 0.0, why
