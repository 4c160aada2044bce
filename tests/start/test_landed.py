"""What the bounces and the rest of a thrown block tell of it: dropped by the material points, which share nothing with the elements that read it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros.elements.standing import Standing
from diffphys_ros.particles import fill, fit_grid
from diffphys_ros.simulate import Plane, Simulator
from diffphys_ros.start import landed_values
from diffphys_ros.start.landed import SINKS_M, Contact, lies_from, stiffer_than, told_apart
from diffphys_ros.types import Body, Floor, StartValues, Tracks
from diffphys_ros.vibration.ring import Ring
from tests.made_bar import bar, settings

YOUNG, DENSITY, POISSON = 3.0e4, 900.0, 0.3
PERIOD_S, SECONDS, CELL_M = 1 / 60, 2.0, 0.02
FLOOR = Floor(np.array([1.0, 0.0, 0.0]), -0.05)
NOISE_M = 1e-4


@pytest.fixture(scope="module")
def block() -> Body:
    return bar(length=0.14, height=0.1, thickness=0.08, edges=(), density=DENSITY, poisson=POISSON, gravity=(-9.81, 0.0, 0.0), clamped=False, pitch=2e-3)


@pytest.fixture(scope="module")
def dropped(block: Body) -> Tracks:
    """Points of its front that fall onto the floor, bounce and come to rest."""
    particles = fill(block, CELL_M, 2)
    grid = fit_grid(particles, dx=CELL_M, reach_m=0.09, clamped=False)
    plane = Plane(FLOOR.up, FLOOR.height_m, "separate", 0.5)
    simulator = Simulator(particles, grid, substeps=20, period_s=PERIOD_S, gravity=block.gravity, planes=[plane])
    count, frames = len(particles.x_rest), round(SECONDS / PERIOD_S)
    young, poisson, silent = (simulator.tensor(each) for each in (np.full(count, YOUNG), np.full(count, POISSON), np.zeros((frames - 1, count, 3))))
    with torch.no_grad():
        path = simulator.rollout(simulator.rest(), young, poisson, silent, 2.0).x.numpy().astype(float)
    seen = path[:, particles.x_rest[:, 2] > particles.x_rest[:, 2].max() - 1e-6]
    seen[1:] += NOISE_M * np.random.default_rng(0).standard_normal(seen[1:].shape)
    return Tracks(1e3 * seen[..., :2], seen, np.ones(seen.shape[:2], bool), True, NOISE_M)


@pytest.fixture(scope="module")
def first(block: Body, dropped: Tracks) -> StartValues:
    return answer(block, dropped)


def answer(body: Body, tracks: Tracks, period_s: float = PERIOD_S) -> StartValues:
    return landed_values(body, tracks, period_s, settings(density_kg_m3=[DENSITY] * body.parts, at_rest=False), FLOOR)[0]


def off(start: StartValues) -> float:
    return float(np.log10(start.young[0] / YOUNG))


def test_the_modulus_of_a_dropped_block_is_read_from_how_it_rings_where_it_lies(first: StartValues) -> None:
    assert first.identified.all()
    assert abs(off(first)) < 0.05
    assert abs(off(first)) < 2 * first.log10_young_sd[0]
    gives = np.log10(1 + (2 * np.pi * 10.4) ** 2 * SINKS_M / 9.81)
    assert 0.9 * gives < first.log10_young_sd[0] < 0.05, "a floor that gives is in it"
    assert "rings at" in first.reasons[0]
    assert np.isnan(first.young_lower).all()


def test_where_it_does_not_ring_long_enough_the_contact_says_the_least_modulus(block: Body, dropped: Tracks) -> None:
    bounces = replace(dropped, **{name: getattr(dropped, name)[:40] for name in ("pixels", "points", "valid")})
    start = answer(block, bounces)
    assert not start.identified.any()
    assert 0.1 < start.young_lower[0] / YOUNG < 1.0
    assert "at least" in start.reasons[0]


def test_a_block_that_is_still_bouncing_when_the_clip_ends_does_not_lie(block: Body, dropped: Tracks) -> None:
    start = answer(block, replace(dropped, **{name: getattr(dropped, name)[:14] for name in ("pixels", "points", "valid")}))
    assert not start.identified.any()
    assert "does not come to lie" in start.reasons[0]
    assert start.young_lower[0] < YOUNG


def test_frames_too_few_a_second_leave_two_frequencies_of_which_neither_is_told(block: Body, dropped: Tracks) -> None:
    """Every second frame: 10.4 Hz looks like 19.6."""
    half = replace(dropped, **{name: getattr(dropped, name)[::2] for name in ("pixels", "points", "valid")})
    start = answer(block, half, 2 * PERIOD_S)
    assert not start.identified.any()
    assert "look alike" in start.reasons[0]


def test_a_block_of_two_materials_and_an_outline_tell_no_modulus(block: Body, dropped: Tracks) -> None:
    part = np.where(block.front.points[:, 0] < 0.07, 1, 2)
    two = answer(block.with_parts(part, np.full(2, DENSITY), np.full(2, POISSON)), dropped)
    assert not two.identified.any()
    assert "one material" in two.reasons[0]
    outline = answer(block, replace(dropped, normals=np.tile([0.0, 1.0, 0.0], (dropped.points.shape[1], 1))))
    assert not outline.identified.any()
    assert "texture" in outline.reasons[0]


def test_a_contact_lasts_from_where_the_lowest_point_passes_the_floor_to_where_it_leaves_it() -> None:
    """Half a frame after the first, and half a frame before the last."""
    lowest = np.array([0.03, 0.01, -0.01, -0.02, -0.01, 0.01, 0.02])
    contact = Contact.of(lowest[:, None] + np.array([0.0, 0.14]), 0.02)
    assert contact is not None
    assert contact.seconds == pytest.approx(3 * 0.02)
    assert contact.height_m == pytest.approx(0.14)
    assert contact.young(DENSITY) == pytest.approx(DENSITY * (2 * 0.14 / 0.06) ** 2)
    assert contact.least_young(DENSITY, POISSON) < contact.young(DENSITY)
    assert Contact.of(lowest[:4, None], 0.02) is None, "it is not seen to leave"
    assert Contact.of(-lowest[:, None], 0.02) is None, "it begins on the floor"


def test_a_body_lies_from_where_it_neither_turns_nor_swings_by_more_than_its_weight_presses_it() -> None:
    def turn(degrees: float) -> np.ndarray:
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    degrees, centre = [20.0, 12.0, 6.0, 1.0, 0.5, 0.2, 0.0, 0.0], np.array([0.2, 0.1, 0.07, 0.071, 0.08, 0.071, 0.07, 0.07])
    turns = np.stack([turn(d) for d in degrees])
    assert lies_from(turns, centre, 0.02) == 3
    assert lies_from(turns, centre, 0.005) == 5


def test_a_floor_that_gives_makes_a_body_slower_which_is_not_taken_for_softness() -> None:
    """Two springs, one upon the other: the body's, and one that its weight presses by so much."""
    model = Standing(10.0, 10.0, np.zeros((1, 3)), np.zeros((1, 3, 0)))
    seen_hz = 1 / (2 * np.pi * np.sqrt(1 / (2 * np.pi * 10.0) ** 2 + SINKS_M / 9.81))
    log10, sd = stiffer_than(model, seen_hz, 9.81)
    assert abs(log10) < 0.005
    assert 0.02 < sd < 0.03
    assert stiffer_than(replace(model, stuck_hz=11.0), seen_hz, 9.81)[1] > 1.5 * sd, "a foot that sticks or slides"


def test_the_body_begins_with_the_velocity_that_brings_it_to_where_frame_1_shows_it(block: Body) -> None:
    """Thrown down and aside with a spin; its weight has its share of the first frame's way."""
    velocity, spin = np.array([-0.4, 0.3, 0.1]), np.array([0.0, 0.2, 1.5])
    rest = block.front.points[::7]
    times = np.arange(12)[:, None, None] * PERIOD_S
    turned = Rotation.from_rotvec(times[:, 0] * spin).as_matrix()
    points = np.einsum("tij,nj->tni", turned, rest) + times * velocity + 0.5 * times**2 * block.gravity
    start, modal = landed_values(block, Tracks(1e3 * points[..., :2], points, np.ones(points.shape[:2], bool), True, 1e-5), PERIOD_S, settings(density_kg_m3=[DENSITY], at_rest=False), Floor(FLOOR.up, -5.0))
    expected = np.cross(spin, modal.nodes) + velocity
    np.testing.assert_allclose(modal.basis @ start.initial_velocity, expected, atol=0.01 * np.abs(expected).max())
    assert not start.forced.any()
    assert not start.force.any()


def test_of_a_ring_and_its_mirror_the_one_is_told_that_the_contact_leaves_likely(block: Body) -> None:
    ring, model = Ring(9.4, 0.02, 1.0, 0.1), Standing(10.0, 9.7, np.zeros((1, 3)), np.zeros((1, 3, 0)))
    assert told_apart(ring, 1 / 30, model) == pytest.approx(9.4)
    faster = replace(model, stuck_hz=21.0, sliding_hz=20.5)
    assert told_apart(ring, 1 / 30, faster) == pytest.approx(20.6)
    between = replace(model, stuck_hz=14.0, sliding_hz=13.8)
    assert told_apart(ring, 1 / 30, between) is None
