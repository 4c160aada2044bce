"""The problem that a fit solves: what of the start values it takes over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.config import Settings
from diffphys_ros.inverse.prepare import Prepared
from diffphys_ros.inverse.problem import MARGIN, MISSING, pose_problem


@pytest.mark.parametrize(("missed", "margin"), [(0.5 * MISSING, 0), (2 * MISSING, MARGIN)])
def test_where_modes_miss_much_of_the_motion_frames_beside_the_forced_ones_may_carry_a_force_too(prepared: Prepared, quick_settings: Settings, missed: float, margin: int) -> None:
    forced = np.arange(len(prepared.start.forced)) == 4
    start = replace(prepared.start, forced=forced, track_cost=missed**2)
    layout = pose_problem(replace(prepared, start=start), None, quick_settings).layout
    np.testing.assert_array_equal(layout.forced, np.arange(4 - margin, 4 + margin + 1))
