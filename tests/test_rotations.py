"""Quaternions and matrices against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros.rotations import polar_rotation, product, quaternion_of, rotated


def wxyz(rotation: Rotation) -> torch.Tensor:
    return torch.tensor(rotation.as_quat()[..., [3, 0, 1, 2]])


def test_a_product_turns_by_its_second_and_then_by_its_first() -> None:
    a, b = Rotation.random(5, random_state=0), Rotation.random(5, random_state=1)
    vector = np.random.default_rng(0).standard_normal((5, 3))
    np.testing.assert_allclose(rotated(wxyz(a), torch.tensor(vector)), a.apply(vector), atol=1e-12)
    np.testing.assert_allclose(rotated(product(wxyz(a), wxyz(b)), torch.tensor(vector)), (a * b).apply(vector), atol=1e-12)


def test_the_product_with_no_turn_is_the_same_to_the_bit() -> None:
    q = torch.randn(50, 4, generator=torch.Generator().manual_seed(0))
    assert torch.equal(product(q, torch.tensor([1.0, 0, 0, 0]).expand(50, 4)), q)


@pytest.mark.parametrize("axis", range(4))
def test_the_quaternion_of_a_matrix_is_exact_near_every_half_turn(axis: int) -> None:
    """Near a half turn about an axis, and near none (axis 0), another component is the largest."""
    near = np.eye(4)[axis] + 0.01 * np.random.default_rng(axis).standard_normal((20, 4))
    turn = Rotation.from_quat(near[:, [1, 2, 3, 0]])
    found = quaternion_of(torch.tensor(turn.as_matrix()))
    np.testing.assert_allclose(found.norm(dim=1), 1, atol=1e-15)
    np.testing.assert_allclose((found * wxyz(turn)).sum(1).abs(), 1, atol=1e-14)
    np.testing.assert_allclose(found[:, axis].abs(), near[:, axis] / np.linalg.norm(near, axis=1), atol=1e-12)


def test_the_quaternion_of_a_matrix_has_the_gradient_of_central_differences() -> None:
    matrix = torch.tensor(Rotation.random(4, random_state=2).as_matrix()).requires_grad_()
    assert torch.autograd.gradcheck(quaternion_of, (matrix,))


def test_the_polar_rotation_has_the_gradient_of_central_differences() -> None:
    matrix = (torch.eye(3, dtype=torch.float64) + 0.2 * torch.tensor(np.random.default_rng(5).normal(size=(3, 3)))).requires_grad_()
    assert torch.autograd.gradcheck(polar_rotation, (matrix[None],))
    rotation = polar_rotation(matrix.detach())
    assert torch.allclose(rotation @ rotation.T, torch.eye(3, dtype=torch.float64), atol=1e-10)
