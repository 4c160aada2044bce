"""Colours by spherical harmonics, against their definition in double precision."""

import math

import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.render import Rasterizer

from . import random_scenes, twin


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_image_and_gradients_equal_the_twins(degree):
    camera = random_scenes.oblique_camera()
    mean, rotation, scale, opacity, _ = random_scenes.random_gaussians(camera, 40, degree)
    exact = [mean, rotation, scale, opacity, random_scenes.random_coefficients(40, degree)]
    rounded = random_scenes.to_float32(exact)
    expected = twin.render(mean, rotation, scale, opacity, twin.shade(mean, exact[4], camera), camera)[0]
    found = Rasterizer(camera).render(*rounded)[0]
    assert (expected - found).abs().mean() < 1e-5
    weight = torch.randn(expected.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    (weight * expected).sum().backward()
    (weight * found).sum().backward()
    for name, a, b in zip(random_scenes.NAMES, exact, rounded, strict=True):
        assert (a.grad - b.grad.double()).norm() < 1e-3 * a.grad.norm(), name


def test_the_twins_basis_is_orthonormal_on_the_sphere():
    z, weight = np.polynomial.legendre.leggauss(8)
    turn = 2 * np.pi * np.arange(16) / 16
    z, turn = (torch.as_tensor(a).reshape(-1) for a in np.meshgrid(z, turn, indexing="ij"))
    side = (1 - z**2).sqrt()
    basis = twin.harmonics(torch.stack([side * turn.cos(), side * turn.sin(), z], -1), 3)
    area = torch.as_tensor(np.repeat(weight, 16)) * 2 * math.pi / 16
    torch.testing.assert_close(torch.einsum("n,ni,nj->ij", area, basis, basis), torch.eye(16, dtype=torch.float64))


def test_degree_0_is_a_plain_colour():
    camera = random_scenes.oblique_camera()
    mean, rotation, scale, opacity, color = random_scenes.to_float32(random_scenes.random_gaussians(camera, 30, 1))
    coefficients = ((color - 0.5) * math.sqrt(4 * math.pi))[:, None]
    plain = Rasterizer(camera).render(mean, rotation, scale, opacity, color)[0]
    torch.testing.assert_close(Rasterizer(camera).render(mean, rotation, scale, opacity, coefficients)[0], plain, atol=1e-6, rtol=0)


def test_a_batch_equals_frame_by_frame_in_values_and_gradients():
    camera = random_scenes.oblique_camera()
    mean, rotation, scale, opacity, _ = random_scenes.to_float32(random_scenes.random_gaussians(camera, 30, 2))
    coefficients = random_scenes.random_coefficients(30, 3).detach().float().requires_grad_()
    shift = torch.tensor([0.0, 0.05, -0.1])[:, None, None]
    renderer, leaves = Rasterizer(camera), (mean, coefficients)
    single = torch.stack([renderer.render(mean + s, rotation, scale, opacity, coefficients)[0] for s in shift])
    together = renderer.render_frames(mean + shift, rotation.expand(3, -1, -1), scale, opacity, coefficients)[0]
    assert torch.equal(single, together)
    for a, b in zip(torch.autograd.grad((single**2).sum(), leaves), torch.autograd.grad((together**2).sum(), leaves), strict=True):
        assert (a - b).norm() < 1e-5 * a.norm()


def test_a_number_of_coefficients_that_no_degree_has_is_refused():
    camera = random_scenes.oblique_camera()
    mean, rotation, scale, opacity, _ = random_scenes.to_float32(random_scenes.random_gaussians(camera, 5, 2))
    with pytest.raises(InputError, match=r"color has shape \(5, 5, 3\)"):
        Rasterizer(camera).render(mean, rotation, scale, opacity, torch.zeros(5, 5, 3))
