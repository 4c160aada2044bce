"""Claims about derivatives of the free tail at the edge of what is physical."""

from __future__ import annotations

import numpy as np

from diffphys_ros.damping import Damping
from diffphys_ros.differences import differences
from diffphys_ros.start.free_tail import physical
from diffphys_ros.start.uncertainty import inconsistency
from tests.made_bar import PERIOD_S, YOUNG, bar, gust, modes_of


def test_a_difference_is_taken_from_above_where_the_other_side_is_not_physical() -> None:
    def only_above(at: np.ndarray) -> np.ndarray:
        assert at.min() >= 0
        return at**2

    np.testing.assert_allclose(differences(only_above, np.array([0.0, 1.0]), least=0.0), np.diag([0.0, 2.0]), atol=2e-4)
    np.testing.assert_array_equal(np.isfinite(physical(5, 2)), [False, False, True, True, False])


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
