"""Every constitutive law is one: no stress at rest, objective, derived from its energy, Hooke's law in the small, true gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from diffphys_ros.simulate.laws import LAWS

from .energies import ENERGIES
from .points import ELASTIC, FLUIDS, PLASTIC, SOLIDS, constants_of, differences, evaluate, points, rotations

UNIT = np.eye(3)


@pytest.mark.parametrize("law", LAWS)
def test_nothing_is_stressed_at_rest_in_any_orientation(law):
    F = np.concatenate([UNIT[None], rotations(20)])
    (tau,) = evaluate(law, "stress", F, constants_of(law))
    np.testing.assert_allclose(tau, np.zeros_like(F), rtol=0, atol=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_stress_turns_with_the_body_and_is_symmetric(law):
    F, Q = points(law), rotations(len(points(law)))
    (tau,), (turned,) = (evaluate(law, "stress", G, constants_of(law)) for G in (F, Q @ F))
    assert abs(tau).max() > 100
    np.testing.assert_allclose(turned, Q @ tau @ Q.swapaxes(1, 2), rtol=0, atol=1e-12 * abs(tau).max())
    np.testing.assert_allclose(tau, tau.swapaxes(1, 2), rtol=0, atol=1e-12 * abs(tau).max())


@pytest.mark.parametrize("law", LAWS)
def test_stress_is_the_derivative_of_the_energy(law):
    F, constants = points(law), constants_of(law)
    (tau,) = evaluate(law, "stress", F, constants)
    variable = torch.tensor(F, requires_grad=True)
    energy = ENERGIES[law](variable, torch.tensor(constants).expand(len(F), 4))
    (first_piola,) = torch.autograd.grad(energy.sum(), variable)
    np.testing.assert_allclose(tau, first_piola.numpy() @ F.swapaxes(1, 2), rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("law", SOLIDS)
def test_small_strains_obey_hookes_law(law):
    rng, size, constants = np.random.default_rng(4), 1e-6, constants_of(law)
    gradient = rng.normal(size=(20, 3, 3)) - 2 * UNIT  # sand bears compression alone
    (tau,) = evaluate(law, "stress", UNIT + size * gradient, constants)
    strain = (gradient + gradient.swapaxes(1, 2)) / 2
    hooke = 2 * constants[0] * strain + constants[1] * np.trace(strain, axis1=1, axis2=2)[:, None, None] * UNIT
    np.testing.assert_allclose(tau / size, hooke, rtol=0, atol=2e-5 * abs(hooke).max())


@pytest.mark.parametrize("law", FLUIDS)
def test_a_fluid_bears_pressure_alone_and_has_the_bulk_modulus_of_its_constants(law):
    constants = constants_of(law)
    (tau,) = evaluate(law, "stress", (1 - 1e-6) * rotations(3), constants)
    bulk = constants[1] + 2 / 3 * constants[0]
    np.testing.assert_allclose(tau, np.tile(-3e-6 * bulk * UNIT, (3, 1, 1)), rtol=2e-5, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_the_adjoint_of_stress_equals_central_differences_also_at_repeated_stretches(law):
    differences(law, "stress", points(law, repeated=True))


@pytest.mark.parametrize("law", FLUIDS)
def test_viscous_stress_is_newtons_objective_and_has_its_gradient(law):
    F, rng, constants = points(law), np.random.default_rng(6), constants_of(law)
    C, Q = rng.normal(size=F.shape), rotations(len(F))
    (tau,) = evaluate(law, "viscous_stress", F, C, constants)
    shear = C + C.swapaxes(1, 2) - 2 / 3 * np.trace(C, axis1=1, axis2=2)[:, None, None] * UNIT
    np.testing.assert_allclose(tau, constants[2] * np.linalg.det(F)[:, None, None] * shear, rtol=1e-12, atol=1e-12)
    (turned,) = evaluate(law, "viscous_stress", Q @ F, Q @ C @ Q.swapaxes(1, 2), constants)
    np.testing.assert_allclose(turned, Q @ tau @ Q.swapaxes(1, 2), rtol=0, atol=1e-11)
    differences(law, "viscous_stress", F, C)


def test_every_law_is_elastic_or_flows():
    assert sorted(ELASTIC + PLASTIC) == sorted(LAWS)
