"""Zones of a body along its limbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from diffphys_ros.start.zone_layout import MOST_STEPS, SLENDER, Division, path_length
from diffphys_ros.types import Body
from tests.made_bar import bar


def tee() -> Body:
    """A stalk of 0.2 x 0.04 m under a cross bar of 0.04 x 0.24 m."""
    body = bar(length=0.24, height=0.24, thickness=0.04, edges=(), pitch=2e-3)
    inside = np.zeros_like(body.inside)
    inside[:100, 50:70], inside[100:] = True, True
    return replace(body, inside=inside)


@pytest.fixture(scope="module")
def slender() -> Body:
    return bar(length=0.3, height=0.04, thickness=0.05, edges=(0.11,), pitch=1e-3)


def test_a_slender_bar_has_slices_of_equal_length_in_order_from_the_clamp():
    body = bar(length=0.3, height=0.04, thickness=0.05, edges=(), pitch=1e-3)
    division = Division.of(body)
    assert division.count == MOST_STEPS
    assert (np.diff(division.zone[:, 20].astype(int)) >= 0).all()
    assert np.ptp(np.bincount(division.zone[body.inside])[1:]) <= 2 * 40
    np.testing.assert_array_equal(division.neighbours, [(k, k + 1) for k in range(MOST_STEPS - 1)])


def test_a_thick_bar_has_no_zone_shorter_than_half_its_width():
    body = bar(edges=(), pitch=2e-3)
    division = Division.of(body)
    assert division.count == int(0.3 / (SLENDER * 0.1))


def test_a_zone_lies_in_one_part_and_is_connected(slender):
    division = Division.of(slender)
    for k in range(division.count):
        here = division.zone == k + 1
        assert ndimage.label(here, np.ones((3, 3)))[1] == 1
        assert set(slender.part[here]) == {division.part[k]}
    assert set(division.part) == {1, 2}


def test_both_arms_of_a_tee_have_zones_of_their_own():
    body = tee()
    division = Division.of(body)
    left, right = division.zone[110, 5], division.zone[110, 115]
    assert left != right
    assert division.zone[20, 60] < min(left, right)
    pairs = {tuple(pair) for pair in division.neighbours}
    assert (left - 1, right - 1) not in pairs


def test_the_way_round_a_corner_is_longer_than_the_straight_line():
    inside = np.zeros((40, 40), bool)
    inside[:, :5], inside[35:] = True, True
    length = path_length(inside)
    assert length[37, 39] > 65
    assert length[0, :5].max() == 0
    assert not length[~inside].any()


def test_a_divided_body_keeps_the_density_of_its_parts(slender):
    body = replace(slender, density=np.array([300.0, 900.0]))
    divided = Division.of(body).divide(body)
    mass = [(b.density[b.part - 1] * b.half_thickness * b.inside).sum() for b in (body, divided)]
    assert mass[0] == pytest.approx(mass[1])
    assert divided.parts == Division.of(body).count
