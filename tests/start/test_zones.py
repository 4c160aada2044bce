"""A modulus per zone where nobody has outlined the materials: bars whose stiffness along the body is known."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.start import start_values
from diffphys_ros.start.zone_layout import MOST_STEPS
from diffphys_ros.start.zones import Zoned, zone_values
from tests.made_bar import PERIOD_S, bar, gust, modes_of, motion, settings, tracks

pytestmark = pytest.mark.slow

SIZE = {"length": 0.3, "height": 0.04, "thickness": 0.05, "pitch": 1e-3}
BORDER = 0.13  # m; inside a zone
STIFF, SOFT = 8e5, 2e5  # Pa
CENTRES = (np.arange(MOST_STEPS) + 0.5) * SIZE["length"] / MOST_STEPS


def found(edges: tuple[float, ...], young: tuple[float, ...], *, seed: int = 0, **more: object) -> Zoned:
    """Zones of a bar that is taken for one part, from noisy tracks of a bar with parts."""
    true = bar(edges=edges, **SIZE)
    modes = modes_of(true, np.array(young), finer=0.85, count=12)
    seen = tracks(modes, motion(modes, np.array(young), gust(peak=1500.0)), seed=seed)
    body, words = bar(edges=(), **SIZE), settings(at_rest=True, density_kg_m3=[600.0])
    start = start_values(body, seen, PERIOD_S, words)[0]
    return zone_values(body, seen, PERIOD_S, words, start, **more)


@pytest.fixture(scope="module")
def jump() -> Zoned:
    return found((BORDER,), (STIFF, SOFT))


def log10_error(zones: Zoned) -> np.ndarray:
    return np.log10(zones.start.young / np.where(CENTRES < BORDER, STIFF, SOFT))


def test_a_border_that_nobody_has_seen_is_found_with_the_stiffness_on_both_sides(jump):
    off = np.abs(CENTRES - BORDER) > 0.5 * SIZE["length"] / MOST_STEPS
    assert np.abs(log10_error(jump)[off]).max() < 0.04
    step = np.diff(np.log10(jump.start.young))
    assert abs((step < -0.1).nonzero()[0] - 4.5).max() <= 0.5


def test_the_claimed_spread_covers_the_error_and_says_that_the_outer_end_is_hardly_told(jump):
    sd = jump.start.log10_young_sd
    off = np.abs(CENTRES - BORDER) > 0.5 * SIZE["length"] / MOST_STEPS
    assert (np.abs(log10_error(jump))[off] < 2 * sd[off]).all()
    assert sd[-1] > 2 * sd[0]
    assert not jump.start.identified[-1]
    assert jump.start.identified[0]


def test_a_uniform_bar_stays_uniform():
    zones = found((), (STIFF,), seed=1)
    assert np.ptp(np.log10(zones.start.young)) < 0.03
    assert np.abs(np.log10(zones.start.young / STIFF)).max() < 0.03


def test_a_pattern_that_is_believed_in_and_true_leaves_no_gradual_border():
    def pattern(points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 0] < BORDER, 4.0, 1.0)

    zones = found((BORDER,), (STIFF, SOFT), pattern=pattern)
    assert np.abs(log10_error(zones))[np.abs(CENTRES - BORDER) > 0.0125].max() < 0.04


def test_the_linear_motion_of_the_zones_explains_the_tracks_and_their_precision_is_positive(jump):
    assert jump.start.track_cost < 1e-3
    assert (np.linalg.eigvalsh(jump.log_young_precision) > 0).all()
    np.testing.assert_array_equal(jump.part, 1)
    assert jump.body.parts == len(jump.start.young) == len(jump.modal.stiffness) == MOST_STEPS
