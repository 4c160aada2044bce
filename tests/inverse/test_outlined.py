"""A plain strip that hangs from a clamp beyond the picture: its modulus, its clamp and its scale from its outline alone."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.inverse import prepare
from diffphys_ros.inverse.prepared import Prepared
from tests.plain_strips import Strip

STRIP = Strip(frames=100)
DENSITY = 1070.0


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    told = {"scene.density_kg_m3": [DENSITY], "scene.size_m": STRIP.length_px / STRIP.px_per_m, "scene.poisson_ratio": [0.3]}
    steps = prepare(STRIP.clip(), config.layered([], told))
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value


def test_the_outline_is_chosen_where_there_is_no_texture(prepared: Prepared) -> None:
    assert prepared.hanging is not None
    assert prepared.tracks.normals is not None
    assert any("by the object's outline" in note for note in prepared.clip.notes)


def test_the_modulus_of_the_beam_is_found_and_its_sd_covers_it(prepared: Prepared) -> None:
    start = prepared.start
    error = float(np.log10(start.young[0] / DENSITY / STRIP.specific))
    assert start.identified.all()
    assert abs(error) < 0.025
    assert 0.015 < start.log10_young_sd[0] < 0.04
    assert abs(error) < 2 * start.log10_young_sd[0]
    assert start.observed_hz[0] == pytest.approx(STRIP.hz, rel=2e-3)


def test_the_clamp_beyond_the_picture_is_found_with_the_scale(prepared: Prepared) -> None:
    hanging = prepared.hanging
    assert hanging.behind_px == pytest.approx(STRIP.behind_px, abs=2.0)
    assert hanging.px_per_m == pytest.approx(STRIP.px_per_m, rel=0.015)
    assert hanging.length_told


def test_no_force_acts_on_a_strip_that_swings_freely(prepared: Prepared) -> None:
    weight = DENSITY * 9.81
    assert np.linalg.norm(prepared.start.force, axis=1).max() < 0.05 * weight


def test_the_decay_of_the_swing_is_the_damping(prepared: Prepared) -> None:
    damping, omega = prepared.start.damping, 2 * np.pi * STRIP.hz
    ratio = (damping.mass_per_s + damping.stiffness_s * omega**2) / (2 * omega)
    assert ratio == pytest.approx(STRIP.damping, rel=0.1)
