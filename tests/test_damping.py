"""Damping of which no mode gains energy."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.damping import Damping

LEADING, STIFF = 400.0, 1e8  # squared angular frequencies [1/s^2]


@pytest.mark.parametrize("constants", [(2.0, 1e-3), (2.0, -1e-4), (-0.1, 1e-3), (0.5, -1e-2), (-1.0, -1e-3)])
def test_no_mode_gains_energy_and_the_leading_one_decays_as_before(constants: tuple[float, float]) -> None:
    given = Damping(*constants)
    braking = given.braking(LEADING)
    decay = braking.decay(np.array([1.0, LEADING, STIFF]))
    assert (decay >= 0).all()
    assert min(braking.mass_per_s, braking.stiffness_s) >= 0
    assert decay[1] == pytest.approx(max(float(given.decay(np.array([LEADING]))[0]), 0.0))


def test_what_brakes_already_stays() -> None:
    given = Damping(2.0, 1e-3)
    assert given.braking(LEADING) is given
