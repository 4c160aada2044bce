"""Material fields: bounds, belief, capacity, gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from diffphys_ros.fields import MATERIAL_FIELDS, Believed, Bounds, Material, MaterialField, pretrain
from diffphys_ros.fields.material import POISSON_BOUNDS, ResidualMaterial

from .made import SOFT, STIFF, YOUNG, bar_points, generator, two_parts

POINTS = bar_points()
X = torch.as_tensor(POINTS, dtype=torch.float32)
EXACT = ("part", "residual")


def made(name: str, believed: Believed | None = None) -> MaterialField:
    return MATERIAL_FIELDS[name](believed or two_parts(POINTS), YOUNG, generator=generator())


def scramble(field: torch.nn.Module, size: float) -> None:
    noise = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in field.parameters():
            parameter += size * torch.randn(parameter.shape, generator=noise)


@pytest.mark.parametrize("name", MATERIAL_FIELDS)
@pytest.mark.parametrize("size", [1.0, 30.0, 1e4])
def test_bounds_hold_for_any_weights_and_any_place(name: str, size: float) -> None:
    field = made(name)
    scramble(field, size)
    far = torch.cat([X, 100 * X, torch.zeros(1, 3)])
    young, poisson = field(far)
    assert young.shape == poisson.shape == (len(far),)
    assert ((young >= YOUNG.low) & (young <= YOUNG.high)).all()
    assert ((poisson >= 0.0) & (poisson <= 0.49)).all()
    assert young.std() > 0


@pytest.mark.parametrize("name", EXACT)
def test_a_field_on_a_belief_starts_at_it_to_the_bit(name: str) -> None:
    believed = two_parts(POINTS)
    young, poisson = made(name)(X)
    np.testing.assert_array_equal(young.detach().numpy(), believed.young.astype(np.float32))
    np.testing.assert_array_equal(poisson.detach().numpy(), believed.poisson.astype(np.float32))


def test_points_between_those_of_the_belief_take_the_nearest() -> None:
    young, _ = made("residual")(torch.tensor([[0.05, 0.01, 0.01], [0.5, 0.0, 0.0]]))
    np.testing.assert_array_equal(young.detach().numpy(), np.float32([STIFF, SOFT]))


@pytest.mark.parametrize("name", ["triplane"])
def test_pretraining_brings_an_absolute_field_to_the_belief_within_two_percent(name: str) -> None:
    field, believed = made(name), two_parts(POINTS)
    before = float((field(X).young.detach() / believed.at(X).young).log10().abs().mean())
    left = pretrain(field, X, believed.at(X), YOUNG)
    young, poisson = field(X)
    error = (young.detach() / believed.at(X).young - 1).abs()
    assert before > 0.3
    assert float(error.median()) < 0.02
    assert float((poisson.detach() - believed.at(X).poisson).abs().median()) < 0.01
    assert left < 0.02


@pytest.mark.parametrize("name", EXACT)
def test_pretraining_leaves_a_field_that_is_at_the_belief_there(name: str) -> None:
    field, believed = made(name), two_parts(POINTS)
    assert pretrain(field, X, believed.at(X), YOUNG, steps=5) < 1e-6


@pytest.mark.slow
def test_a_residual_field_learns_a_step_that_the_belief_lacks_where_a_constant_per_part_cannot() -> None:
    one = Believed(POINTS, np.full(len(POINTS), 6e4), np.full(len(POINTS), 0.35))
    target = two_parts(POINTS).at(X)
    residual = pretrain(made("residual", one), X, target, YOUNG)
    constant = pretrain(made("part", one), X, target, YOUNG)
    assert residual < 0.03
    assert constant > 0.45


def test_a_field_interpolates_smoothly_between_the_points_that_it_was_taught() -> None:
    points = bar_points(40)
    ramp = Believed(points, 10 ** (4 + 3 * points[:, 0]), np.full(len(points), 0.3))
    field = made("triplane", ramp)
    pretrain(field, torch.as_tensor(points[::2], dtype=torch.float32), ramp.at(torch.as_tensor(points[::2], dtype=torch.float32)), YOUNG)
    unseen = torch.as_tensor(points[1::2], dtype=torch.float32)
    error = (field(unseen).young.detach() / ramp.at(unseen).young).log10()
    assert float(error.square().mean().sqrt()) < 0.04


@pytest.mark.parametrize("name", MATERIAL_FIELDS)
def test_gradients_reach_every_parameter_and_match_finite_differences(name: str) -> None:
    field = made(name).double()
    scramble(field, 0.3)
    x = X[::37].double()
    field(x).young.log().sum().backward()
    parameters = list(field.parameters())
    assert any(p.grad is not None and p.grad.abs().sum() > 0 for p in parameters)
    chosen = [p for p in parameters if p.numel() < 40]

    def said(*values: torch.Tensor) -> torch.Tensor:
        names = [n for n, p in field.named_parameters() if p.numel() < 40]
        young, poisson = torch.func.functional_call(field, dict(zip(names, values, strict=True)), (x,))
        return torch.cat([young.log(), poisson])

    assert torch.autograd.gradcheck(said, tuple(p.detach().clone().requires_grad_() for p in chosen), atol=1e-6)


@pytest.mark.parametrize("bounds", [YOUNG, POISSON_BOUNDS, Bounds(-1.0, 5.0)])
def test_a_shift_is_monotonous_stays_in_bounds_and_is_undone_by_none(bounds: Bounds) -> None:
    base = bounds.value(torch.linspace(-4, 4, 9, dtype=torch.float64))
    assert torch.equal(bounds.shifted(base, torch.zeros_like(base)), base)
    up = torch.stack([bounds.shifted(base, torch.full_like(base, r)) for r in (-50.0, -2.0, 0.0, 2.0, 50.0)])
    assert (up.diff(dim=0) > 0).all()
    assert ((up >= bounds.low) & (up <= bounds.high)).all()


def test_two_fields_of_one_seed_are_equal_to_the_bit_after_pretraining() -> None:
    def trained() -> Material:
        field = made("triplane")
        pretrain(field, X, two_parts(POINTS).at(X), YOUNG, steps=20)
        return field(X)

    assert torch.equal(trained().young, trained().young)


@pytest.mark.slow
def test_a_residual_field_at_the_border_of_its_bounds_can_still_come_back() -> None:
    field = ResidualMaterial(Believed(POINTS, np.full(len(POINTS), YOUNG.high), np.full(len(POINTS), 0.49)), YOUNG, generator=generator())
    assert pretrain(field, X, two_parts(POINTS).at(X), YOUNG) < 0.3
