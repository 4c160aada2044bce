"""Claims about derivatives of the free tail, also at the edge of what is physical."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.differences import differences
from diffphys_ros.elements.assemble import Elements, modal_model
from diffphys_ros.start.densities import Densities
from diffphys_ros.start.evidence import Evidence
from diffphys_ros.start.free_tail import Physics, physical
from diffphys_ros.start.uncertainty import inconsistency
from diffphys_ros.vibration.coordinates import observe
from diffphys_ros.vibration.forced_frames import find_support
from tests.made_bar import PERIOD_S, YOUNG, bar, gust, modes_of, motion, settings, tracks


def test_a_difference_is_taken_from_above_where_the_other_side_is_not_physical() -> None:
    def only_above(at: np.ndarray) -> np.ndarray:
        assert at.min() >= 0
        return at**2

    np.testing.assert_allclose(differences(only_above, np.array([0.0, 1.0]), least=0.0), np.diag([0.0, 2.0]), atol=2e-4)
    np.testing.assert_array_equal(np.isfinite(physical(5, 2)), [False, False, True, True, False])


@pytest.mark.parametrize("told", [{}, {"gravity": (0.0, 0.0, -9.81)}, {"thickness": 0.1}])  # of the last, modes come in pairs of one frequency
@pytest.mark.parametrize(("at_rest", "damping", "weighed"), [(True, Damping(0.4, 2e-3), True), (False, Damping(0.0, 0.0), False)])
def test_the_slope_of_the_tail_is_what_differences_find(told: dict[str, Any], at_rest: bool, damping: Damping, weighed: bool) -> None:
    body = bar(**told)
    modal = modal_model(Elements.of(body, apart=True), [YOUNG], [8])
    densities = Densities(body.density, body.part_volumes_m3, 0.5) if weighed else None
    seen = tracks(modal, motion(modal, YOUNG, gust()))
    observed = observe(body, seen, None)
    support = find_support(observed.coordinates, observed.known, PERIOD_S, at_rest=at_rest, noise_m=observed.noise_m)
    tail = Evidence(body, seen, observed, PERIOD_S, settings(at_rest=at_rest)).tail(modal, support)
    vector = Physics(YOUNG * (1.2, 0.7), damping, np.array([0.01, -0.02, 0.0, 0.015]), np.array([900.0, 450.0]) if weighed else None).vector(densities)
    expected = differences(lambda v: tail.misfit(Physics.of(v, 2, densities)).ravel() / tail.sigma_m, vector, least=physical(len(vector), 2))
    found = tail.slope(Physics.of(vector, 2, densities), densities)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max(), rtol=0)
    assert (np.abs(found - expected).max(0) < 1e-3 * np.abs(expected).max(0)).all()


def test_frequencies_that_agree_widen_nothing_and_others_by_what_they_are_off() -> None:
    unseen = np.ones(2)  # modes that no data speak of stay as they were believed
    assert inconsistency(np.array([0.7, -0.7, 0.0, 0.0]), np.r_[0.5, 0.5, unseen]) == 1.0
    assert inconsistency(np.array([4.0, -4.0, 0.0, 0.0]), np.r_[0.5, 0.5, unseen]) == np.sqrt(35 / 4)
    assert inconsistency(np.array([4.0, -4.0]), np.full(2, 0.5)) == np.sqrt(16.5)


def test_a_part_that_is_next_to_rigid_has_finite_derivatives_without_damping() -> None:
    rigid = np.array([YOUNG[0], 1e6 * YOUNG[1]])
    modal = modes_of(bar(), rigid, count=8)
    force = gust()
    words = {"footprint": modal.footprint_load(), "force": force, "frames": np.array([3]), "period_s": PERIOD_S}
    with np.errstate(over="raise"):
        found = modal.jacobian(rigid, damping=Damping(0.0, 0.0), **words)
    assert np.isfinite(found).all()
