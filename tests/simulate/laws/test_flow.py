"""What plastic laws project onto: the yield surface, without a change of volume, and with true gradients on both sides of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .points import OWN, PLASTIC, constants_of, differences, evaluate, points, rotations

UNIT = np.eye(3)
YIELDING = ["von_mises", "drucker_prager"]


def projected(law: str, F: np.ndarray) -> np.ndarray:
    return evaluate(law, "project", F, constants_of(law))[0]


def deviator(A: np.ndarray) -> np.ndarray:
    return A - np.trace(A, axis1=1, axis2=2)[:, None, None] / 3 * UNIT


def sheared(law: str) -> np.ndarray:
    """Points beyond the yield surface, packed a little."""
    F = points(law) @ np.array([[1.0, 0.9, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    return F * (0.96 / np.cbrt(np.linalg.det(F)))[:, None, None]


def barely_strained(law: str) -> np.ndarray:
    """Points within the yield surface."""
    rng = np.random.default_rng(5)
    return rotations(20) @ ((0.9 if law == "drucker_prager" else 1.0) * UNIT + 0.02 * rng.normal(size=(20, 3, 3)))


def loosened() -> np.ndarray:
    """Sand pulled apart, sheared or not."""
    F = points("weakly_compressible", repeated=True)
    return F * (1.2 / np.cbrt(np.linalg.det(F)))[:, None, None]


@pytest.mark.parametrize("law", PLASTIC)
def test_a_projection_changes_nothing_the_second_time(law):
    F = projected(law, sheared(law))
    np.testing.assert_allclose(projected(law, F), F, rtol=0, atol=1e-14)


@pytest.mark.parametrize("law", YIELDING)
def test_what_does_not_yield_is_left_alone(law):
    F = barely_strained(law)
    np.testing.assert_array_equal(projected(law, F), F)


@pytest.mark.parametrize("law", PLASTIC)
def test_flow_keeps_the_volume(law):
    F = sheared(law)
    np.testing.assert_allclose(np.linalg.det(projected(law, F)), np.linalg.det(F), rtol=1e-13)


@pytest.mark.parametrize("law", YIELDING)
def test_a_projection_turns_with_the_body(law):
    F, Q = sheared(law), rotations(40)
    np.testing.assert_allclose(projected(law, Q @ F), Q @ projected(law, F), rtol=0, atol=1e-13)
    np.testing.assert_allclose(projected(law, F @ Q), projected(law, F) @ Q, rtol=0, atol=1e-13)


def test_plasticine_flows_at_its_yield_stress():
    (tau,) = evaluate("von_mises", "stress", projected("von_mises", sheared("von_mises")), constants_of("von_mises"))
    equivalent = math.sqrt(1.5) * np.linalg.norm(deviator(tau), axis=(1, 2))
    np.testing.assert_allclose(equivalent, OWN["yield_stress_pa"], rtol=1e-12)


def test_sand_flows_where_its_shear_stress_reaches_friction_times_pressure():
    (tau,) = evaluate("drucker_prager", "stress", projected("drucker_prager", sheared("drucker_prager")), constants_of("drucker_prager"))
    sine = math.sin(OWN["friction_angle_rad"])
    bound = -math.sqrt(2 / 3) * 2 * sine / (3 - sine) * np.trace(tau, axis1=1, axis2=2)
    np.testing.assert_allclose(np.linalg.norm(deviator(tau), axis=(1, 2)), bound, rtol=1e-12)


def test_sand_in_triaxial_compression_fails_at_mohr_and_coulombs_ratio_of_stresses():
    (tau,) = evaluate("drucker_prager", "stress", projected("drucker_prager", np.diag([1.2, 1.2, 0.6])[None]), constants_of("drucker_prager"))
    sine = math.sin(OWN["friction_angle_rad"])
    assert tau[0, 2, 2] / tau[0, 0, 0] == pytest.approx((1 + sine) / (1 - sine))


def test_loosened_sand_bears_no_stress_and_remembers_its_volume():
    F = loosened()
    after = projected("drucker_prager", F)
    np.testing.assert_allclose(np.linalg.det(after), np.linalg.det(F), rtol=1e-13)
    np.testing.assert_allclose(after @ after.swapaxes(1, 2), np.tile(1.44 * UNIT, (len(F), 1, 1)), rtol=0, atol=1e-13)
    (tau,) = evaluate("drucker_prager", "stress", after, constants_of("drucker_prager"))
    assert not tau.any()


def test_a_fluid_forgets_its_shape():
    after = projected("weakly_compressible", points("weakly_compressible"))
    np.testing.assert_array_equal(after, after[:, :1, :1] * UNIT)


@pytest.mark.parametrize("law", YIELDING)
@pytest.mark.parametrize("side", [sheared, barely_strained])
def test_the_adjoint_of_a_projection_equals_central_differences_on_both_sides_of_the_yield_surface(law, side):
    differences(law, "project", side(law))


def test_the_adjoint_of_a_projection_equals_central_differences_at_repeated_stretches():
    twice = np.array([[0.8, 0.8, 1.3], [1.3, 0.8, 0.8], [0.8, 0.8 + 1e-9, 1.3], [0.5, 1.2, 1.2 - 1e-6]])
    Q = rotations(8).reshape(2, 4, 3, 3)
    F = Q[0] @ (UNIT * twice[:, None]) @ Q[1]
    for law in YIELDING:
        differences(law, "project", F * (0.9 / np.cbrt(np.linalg.det(F)))[:, None, None])


def test_the_adjoint_of_loosening_sand_equals_central_differences():
    differences("drucker_prager", "project", loosened())


def test_the_adjoint_of_a_fluids_projection_equals_central_differences():
    differences("weakly_compressible", "project", points("weakly_compressible"))
