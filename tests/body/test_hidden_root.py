"""What of a body lies beyond the picture's border goes on half way between parallel sides and as its sides lean there."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.body import build_body
from diffphys_ros.body.solid import BESIDE_LINE_PX, LEANS_ON, _continued
from diffphys_ros.outline import covered
from diffphys_ros.types import Body, Camera, Clip

PIXEL_M, LENGTH_PX, BEHIND_PX = 0.001, 120.0, 24.0


def hung(border_px: float, end_px: float, *, row: float = 0.0, parallel: bool = False) -> Body:
    """Of an object that is so wide at the picture's upper border and at its free end, with straight sides, held BEHIND_PX beyond a line along a row."""
    corners = 80 + np.array([[-border_px, -161.0], [border_px, -161.0], [end_px, 2 * LENGTH_PX - 160], [-end_px, 2 * LENGTH_PX - 160]]) / 2
    share = covered(corners, (160, 160))
    frame = np.rint(60 + 140 * share[..., None] * np.ones(3)).astype(np.uint8)
    camera = Camera(np.array([[1 / PIXEL_M, 0, 80], [0, 1 / PIXEL_M, 80], [0, 0, 1]]), np.eye(4), 160, 160)
    clip = Clip(frame[None], 0, 1 / 30, camera, labels=(share[None] > 0.5).astype(np.uint8))
    told = {"scene.clamp_px": [0, row, 159, row], "scene.thickness_m": PIXEL_M, "scene.density_kg_m3": [1000.0]}
    return build_body(clip, (share > 0.5).astype(np.float32), config.layered([], told), behind_px=BEHIND_PX, soft=share, parallel=parallel)


def held_px(body: Body) -> float:
    """Width of the held face."""
    return float(body.inside[0].sum() * body.pitch_m / PIXEL_M)


@pytest.mark.parametrize(("border_px", "end_px"), [(30.0, 50.0), (50.0, 30.0), (40.0, 50.0)])
def test_sides_that_lean_at_the_border_lean_half_as_much_behind_it(border_px: float, end_px: float) -> None:
    """A simulated strip of 24 mm in its middle and 14 at its clamp, held as wide as it is at the border, came out .09 too soft in log10 E at a stated .02."""
    lean = (end_px - border_px) / LENGTH_PX
    begin_px = border_px + BESIDE_LINE_PX * lean
    assert held_px(hung(border_px, end_px)) == pytest.approx(begin_px - LEANS_ON * lean * (BEHIND_PX + BESIDE_LINE_PX), abs=0.8)


def test_sides_that_are_parallel_but_for_noise_stay_so() -> None:
    assert np.array_equal(hung(30.0, 30.8).inside, hung(30.0, 30.8, parallel=True).inside)


def test_a_bump_beside_the_border_as_large_as_moulded_strips_have_is_no_lean() -> None:
    """A film of a straight strip has one of 4 px in 47, half of a width below the border: its E was .013 off where the slope up to it counted."""
    rows = np.arange(400)
    width = 141 + 12 * np.exp(-0.5 * ((rows - 162) / 25) ** 2)
    inside = np.abs(np.arange(400) - 200) < width[:, None] / 2
    first = inside[90]
    np.testing.assert_array_equal(_continued(inside, 90), np.broadcast_to(first, (90, 400)))


def test_sides_may_be_told_to_be_parallel_where_they_are_not_seen() -> None:
    assert held_px(hung(30.0, 50.0, parallel=True)) == pytest.approx(31.3, abs=0.8)


def test_what_is_hidden_does_not_draw_to_a_point() -> None:
    body = hung(10.0, 110.0)
    assert 0.4 < held_px(body) / 16.7 < 0.6


def test_a_line_in_the_picture_shows_the_held_end_itself() -> None:
    """What is seen behind it is no part of the body, and what stands beside it may be the clamp."""
    assert np.array_equal(hung(30.0, 50.0, row=20.0).inside, hung(30.0, 50.0, row=20.0, parallel=True).inside)
