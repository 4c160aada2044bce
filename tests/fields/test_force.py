"""Force fields: zero at first, capacity, gradients, smoothness."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from diffphys_ros.fields import FORCE_FIELDS, ForceField, Smoothness

from .made import bar_points, box, generator

FRAMES, UNIT = 6, 500.0
X = torch.as_tensor(bar_points(), dtype=torch.float32)
T = torch.arange(FRAMES)


def made(name: str) -> ForceField:
    return FORCE_FIELDS[name](box(), FRAMES, UNIT, generator=generator())


def gust() -> torch.Tensor:
    """Along y, uniform, strongest in the middle of the clip."""
    target = torch.zeros(FRAMES, len(X), 3)
    target[..., 1] = (UNIT * torch.sin(torch.pi * (T + 0.5) / FRAMES))[:, None]
    return target


def push() -> torch.Tensor:
    """Along z, on the free half only, in two frames."""
    target = torch.zeros(FRAMES, len(X), 3)
    target[2:4, :, 2] = UNIT * (X[:, 0] > 0.2)
    return target


def taught(field: ForceField, target: torch.Tensor, steps: int = 300) -> float:
    """Relative root mean squared error after Adam."""
    optimiser = torch.optim.Adam(field.parameters(), 2e-2)
    for _ in range(steps):
        loss = ((field(X, T) - target) / UNIT).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        return float((field(X, T) - target).square().mean().sqrt() / target.square().mean().sqrt())


@pytest.mark.parametrize("name", FORCE_FIELDS)
def test_every_field_begins_at_zero_with_one_vector_per_frame_and_point(name: str) -> None:
    force = made(name)(X, T[1:4])
    assert force.shape == (3, len(X), 3)
    assert not force.any()


@pytest.mark.parametrize("name", FORCE_FIELDS)
def test_every_field_can_be_a_gust(name: str) -> None:
    assert taught(made(name), gust()) < 0.05


@pytest.mark.parametrize(("name", "low", "high"), [("frame", 0.6, 0.8), ("modes", 0.05, 0.45), ("planes", 0.0, 0.2), ("voxels", 0.0, 0.1)])
def test_the_more_a_field_can_hold_the_nearer_it_comes_to_a_push_on_half_the_bar(name: str, low: float, high: float) -> None:
    assert low <= taught(made(name), push()) < high


@pytest.mark.parametrize("name", FORCE_FIELDS)
def test_gradients_match_finite_differences(name: str) -> None:
    field = made(name).double()
    noise = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in field.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=noise, dtype=torch.float64)
    x = X[::61].double()
    names = [n for n, p in field.named_parameters() if p.numel() < 100]

    def said(*values: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(field, dict(zip(names, values, strict=True)), (x, T[:2])) / UNIT

    values = tuple(dict(field.named_parameters())[n].detach().clone().requires_grad_() for n in names)
    assert names
    assert torch.autograd.gradcheck(said, values, atol=1e-6)


@pytest.mark.parametrize("name", ["voxels", "planes"])
def test_features_take_gradients_once_the_decoder_has_moved(name: str) -> None:
    field = made(name)
    taught(field, push(), steps=2)
    field.zero_grad()
    field(X, T).sum().backward()
    assert all(p.grad is not None and p.grad.any() for n, p in field.named_parameters() if "decoder" not in n)


def test_frames_of_the_voxel_field_know_nothing_of_each_other() -> None:
    field = made("voxels")
    taught(field, push(), steps=20)
    before = field(X, T).detach()
    with torch.no_grad():
        field.features[2] += 1.0  # type: ignore[index,operator]
    changed = (field(X, T) - before).abs().amax((1, 2)) > 0
    np.testing.assert_array_equal(changed.numpy(), T.numpy() == 2)


def test_a_uniform_steady_force_is_smooth_and_a_slope_costs_its_square_over_the_object() -> None:
    smoothness = Smoothness.of(bar_points())
    steady = torch.ones(FRAMES, len(X), 3)
    assert float(smoothness(steady)) < 1e-10
    slope = torch.zeros(FRAMES, len(X), 3)
    slope[..., 0] = 5 * X[:, 1]
    assert float(smoothness(slope)) == pytest.approx((5 * 0.38) ** 2, rel=1e-3)
    flicker = steady * (-1.0) ** T[:, None, None]
    assert float(smoothness(flicker)) == pytest.approx(12.0, rel=1e-5)


def test_finer_particles_do_not_change_how_rough_a_field_is() -> None:
    values = []
    for count in (20, 40):
        points = bar_points(count)
        force = torch.zeros(2, len(points), 3)
        force[..., 1] = torch.as_tensor(np.sin(10 * points[:, 0]))
        values.append(float(Smoothness.of(points)(force)))
    assert values[1] == pytest.approx(values[0], rel=0.05)


def test_a_single_layer_of_points_has_a_roughness_too() -> None:
    flat = bar_points()[bar_points()[:, 2] == 0]
    slope = torch.zeros(2, len(flat), 3)
    slope[..., 0] = torch.as_tensor(flat[:, 0])
    assert float(Smoothness.of(flat)(slope)) == pytest.approx(0.38**2, rel=1e-3)
