"""Weights that carry points with particles."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from diffphys_ros.particles import bind, deform_splats

RNG_SEED = 3


@pytest.fixture
def lattice() -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n) * 0.01 for n in (12, 5, 4)), indexing="ij"), -1).reshape(-1, 3)


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(RNG_SEED).uniform((0.0, 0.0, 0.0), (0.11, 0.04, 0.03), (80, 3))


def quaternion(axis: np.ndarray, angle: float) -> np.ndarray:
    axis = axis / np.linalg.norm(axis)
    return np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis]


def rotation_of(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_linear_fields_are_reproduced_exactly(lattice: np.ndarray, points: np.ndarray) -> None:
    matrix, offset = np.random.default_rng(1).normal(size=(3, 3)), np.array([0.3, -0.2, 0.1])
    binding = bind(points, lattice)
    assert np.allclose(binding.weight.sum(1), 1, atol=1e-12)
    assert np.allclose(binding.apply(lattice @ matrix.T + offset), points @ matrix.T + offset, atol=1e-9)
    assert np.allclose(np.einsum("mki,mkj->mij", (lattice @ matrix.T)[binding.index], binding.gradient), matrix, atol=1e-8)


def test_points_half_a_spacing_outside_still_follow_a_linear_field(lattice: np.ndarray) -> None:
    outside = np.array([[0.05, -0.005, 0.015], [0.115, 0.02, 0.015], [-0.004, -0.004, -0.004]])
    binding = bind(outside, lattice)
    assert np.allclose(binding.apply(lattice), outside, atol=1e-9)


def test_a_plane_of_particles_carries_points_without_blowing_up(lattice: np.ndarray) -> None:
    sheet = lattice[lattice[:, 2] == 0]
    binding = bind(np.array([[0.05, 0.02, 0.3], [0.05, 0.02, 0.0]]), sheet)
    assert np.abs(binding.weight).max() < 4
    assert np.allclose(binding.weight.sum(1), 1)
    assert np.allclose(binding.apply(sheet)[1], [0.05, 0.02, 0.0], atol=1e-9)


def test_numpy_and_torch_agree_over_frames_and_gradients_flow(lattice: np.ndarray, points: np.ndarray) -> None:
    field = np.random.default_rng(2).normal(size=(3, len(lattice), 2))
    binding = bind(points, lattice)
    x = torch.tensor(field, requires_grad=True)
    y = binding.apply(x)
    assert y.shape == (3, len(points), 2)
    assert np.allclose(y.detach().numpy(), binding.apply(field))
    y.sum().backward()
    assert x.grad.sum().item() == pytest.approx(y.numel())


@pytest.mark.parametrize("with_gradient", [True, False])
def test_gaussians_turn_with_a_rigid_rotation(lattice: np.ndarray, points: np.ndarray, with_gradient: bool) -> None:
    turn = quaternion(np.array([1.0, 2.0, -0.5]), 2.4)
    matrix = rotation_of(turn)
    x0 = torch.tensor(lattice)
    x = (x0 @ torch.tensor(matrix).T + 0.1)[None]
    F = torch.tensor(matrix).expand(1, len(x0), 3, 3) if with_gradient else None
    start = np.random.default_rng(4).normal(size=(len(points), 4))
    start /= np.linalg.norm(start, axis=1, keepdims=True)
    mean, rotation = deform_splats(bind(points, lattice), torch.tensor(points), torch.tensor(start), x, x0, F)
    assert np.allclose(mean[0], points @ matrix.T + 0.1, atol=1e-9)
    for q, q0 in zip(rotation[0].numpy(), start, strict=True):
        assert np.allclose(rotation_of(q), matrix @ rotation_of(q0), atol=1e-7)


def test_stretch_moves_gaussians_but_does_not_turn_them(lattice: np.ndarray, points: np.ndarray) -> None:
    stretch = torch.diag(torch.tensor([1.4, 0.8, 0.9], dtype=torch.float64))
    x0 = torch.tensor(lattice)
    still = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).expand(len(points), 4)
    mean, rotation = deform_splats(bind(points, lattice), torch.tensor(points), still, (x0 @ stretch)[None], x0, None)
    assert np.allclose(mean[0], points @ stretch.numpy(), atol=1e-9)
    assert np.allclose(rotation[0], still, atol=1e-7)


@pytest.mark.parametrize("with_gradient", [True, False])
def test_gaussians_turn_by_the_rotation_of_a_turn_with_stretch(lattice: np.ndarray, points: np.ndarray, with_gradient: bool) -> None:
    turn = quaternion(np.array([0.3, -1.0, 0.8]), 1.1)
    stretch = np.diag([1.5, 0.7, 0.9]) + 0.2 * np.array([[0, 1, 0.5], [1, 0, 0.3], [0.5, 0.3, 0]])
    matrix = rotation_of(turn) @ stretch  # the polar decomposition of this product
    x0 = torch.tensor(lattice)
    F = torch.tensor(matrix).expand(1, len(x0), 3, 3) if with_gradient else None
    still = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).expand(len(points), 4)
    mean, rotation = deform_splats(bind(points, lattice), torch.tensor(points), still, (x0 @ torch.tensor(matrix).T)[None], x0, F)
    assert np.allclose(mean[0], points @ matrix.T, atol=1e-9)
    assert all(np.allclose(rotation_of(q), rotation_of(turn), atol=1e-9) for q in rotation[0].numpy())


@pytest.mark.parametrize("away", [0.01, 0.03, 0.1, 0.5])
def test_a_gaussian_far_from_the_body_goes_with_its_turn(lattice: np.ndarray, away: float) -> None:
    stray = np.array([[0.05, 0.02, 0.03 + away], [-away, 0.02, 0.0]])
    turn = rotation_of(quaternion(np.array([1.0, 0.5, 0.2]), 0.6)) - np.eye(3)
    binding = bind(stray, lattice)
    assert np.allclose(binding.weight.sum(1), 1)
    assert np.abs(binding.weight).max() < 1.6
    error = np.linalg.norm(binding.apply(lattice @ turn.T) - stray @ turn.T, axis=1)
    alone = np.linalg.norm((lattice.mean(0) - stray) @ turn.T, axis=1)  # were it to go with the body's middle
    assert (error < (1e-9 if away < 0.1 else 0.9 * alone)).all()


def test_a_gaussian_off_a_sheet_that_others_continue_goes_with_them() -> None:
    sheet = np.stack(np.meshgrid(*(np.arange(n) * 0.01 for n in (9, 9, 1)), indexing="ij"), -1).reshape(-1, 3)
    body = np.concatenate([sheet, sheet - [0, 0, 0.03]])
    matrix = rotation_of(quaternion(np.array([1.0, 0.0, 0.0]), 0.6))
    stray = np.array([[0.04, 0.04, 0.03]])
    assert np.allclose(bind(stray, body).apply(body @ matrix.T), stray @ matrix.T, atol=1e-9)


@pytest.mark.parametrize("span", [2, 0])
def test_gaussians_on_sheets_and_single_particles_turn_as_far_as_these_tell(lattice: np.ndarray, span: int) -> None:
    thin = lattice[(lattice[:, span:] == lattice[0, span:]).all(1)]
    matrix = rotation_of(quaternion(np.array([1.0, 2.0, 0.5]), 0.9))
    x0, start = torch.tensor(thin), torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64)
    _, rotation = deform_splats(bind(thin[:1], thin), torch.tensor(thin[:1]), start, (x0 @ torch.tensor(matrix).T)[None], x0, None)
    assert np.allclose(rotation_of(rotation[0, 0].numpy()), matrix if span else np.eye(3), atol=1e-8)
