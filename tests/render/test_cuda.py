"""The renderer on CUDA, against the CPU and against gsplat."""

import pytest
import torch

from benchmarks.peer import gsplat_cameras, gsplat_frames, has_gsplat, per_frame
from diffphys_ros.render import Rasterizer

from . import random_scenes

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


def batch(camera, *, count=800, frames=3, degree=None, seed=0, opacity=(0.2, 0.95)):
    """Gaussians that move over some frames, float32 on the CPU: mean, rotation, scale, opacity, color."""
    mean, rotation, scale, opaque, color = random_scenes.to_float32(random_scenes.random_gaussians(camera, count, seed, opacity))
    shift = torch.linspace(0, 0.02, frames)[:, None, None]
    color = color if degree is None else random_scenes.random_coefficients(count, degree).float()
    return [t.detach() for t in (mean + shift, rotation + shift, scale, opaque, color)]


def rendered(camera, tensors, device, *, seen=(0, 1, 2), window=None):
    """Outputs and gradients of the sum of squares of some of them, on the CPU."""
    leaves = [t.clone().to(device).requires_grad_() for t in tensors]
    background = torch.rand(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(0)).to(device).requires_grad_()
    outputs = Rasterizer(camera, device).render_frames(*leaves, background, window=window)
    gradients = torch.autograd.grad(sum(outputs[k].square().sum() for k in seen), [*leaves, background], allow_unused=True)
    return [t.detach().cpu() for t in (*outputs, *(g for g in gradients if g is not None))]


@pytest.fixture
def deterministic():
    torch.use_deterministic_algorithms(True)
    yield
    torch.use_deterministic_algorithms(False)


def assert_close(expected, found, bound):
    for k, (a, b) in enumerate(zip(expected, found, strict=True)):
        assert (a - b).norm() <= bound * a.norm(), k


@pytest.mark.parametrize("degree", [None, 0, 1, 2, 3])
def test_a_batch_equals_the_cpus_in_values_and_gradients(degree):
    camera = random_scenes.oblique_camera(160, 120)
    tensors = batch(camera, degree=degree)
    assert_close(rendered(camera, tensors, "cpu"), rendered(camera, tensors, "cuda:0"), 1e-4)


@pytest.mark.parametrize("seen", [(0,), (1,), (2,)])
def test_gradients_of_one_output_alone_equal_the_cpus(seen):
    camera = random_scenes.oblique_camera(75, 53)
    tensors = batch(camera, seed=1)
    assert_close(rendered(camera, tensors, "cpu", seen=seen), rendered(camera, tensors, "cuda:0", seen=seen), 1e-4)


def test_a_window_and_opaque_stacks_equal_the_cpus():
    camera = random_scenes.oblique_camera(160, 120)
    tensors, window = batch(camera, opacity=(0.9, 1.0), count=3000), (31, 17, 120, 99)
    assert_close(rendered(camera, tensors, "cpu", window=window), rendered(camera, tensors, "cuda:0", window=window), 2e-3)


def test_lists_too_long_for_shared_memory_equal_the_cpus():
    camera = random_scenes.oblique_camera(20, 18)
    tensors = batch(camera, count=6000, frames=1, opacity=(0.004, 0.02))
    assert_close(rendered(camera, tensors, "cpu"), rendered(camera, tensors, "cuda:0"), 1e-3)


def test_more_pairs_than_there_was_room_for_are_all_rendered():
    camera = random_scenes.oblique_camera(160, 120)
    wide = batch(camera, count=50)
    wide[2] = wide[2] * 30  # each Gaussian covers most of the 80 tiles
    assert_close(rendered(camera, wide, "cpu"), rendered(camera, wide, "cuda:0"), 1e-4)


def test_two_runs_show_the_same_bits():
    camera = random_scenes.oblique_camera(160, 120)
    tensors = batch(camera)
    assert all(torch.equal(a, b) for a, b in zip(*(rendered(camera, tensors, device)[:3] for device in ("cuda:0", "cuda")), strict=True))


@pytest.mark.usefixtures("deterministic")
def test_deterministic_gradients_are_equal_to_the_bit_and_those_of_the_cpu():
    camera = random_scenes.oblique_camera(160, 120)
    tensors = batch(camera, degree=2)
    first, second = (rendered(camera, tensors, "cuda:0") for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))
    assert_close(rendered(camera, tensors, "cpu"), first, 1e-4)


@pytest.mark.skipif(not has_gsplat(), reason="gsplat is not installed")
@pytest.mark.parametrize("degree", [None, 3])
def test_a_batch_equals_gsplats_in_values_and_gradients(degree):
    camera, device = random_scenes.oblique_camera(160, 120), "cuda:0"
    camera.pixel_from_camera[0, 1] = 0  # gsplat knows no skew
    leaves = [t.to(device).requires_grad_() for t in batch(camera, degree=degree)]
    theirs, size = per_frame(leaves), (camera.width, camera.height)
    image, alpha, depth = Rasterizer(camera, device).render_frames(*leaves)
    other, covered = gsplat_frames(theirs, gsplat_cameras(camera, len(alpha), device), size, "RGB+ED")
    assert_close((other[..., :3], covered, other[..., 3]), (image, alpha, depth), 1e-3)
    weight = torch.randn(*alpha.shape, 5, generator=torch.Generator().manual_seed(0)).to(device)
    found = torch.autograd.grad((torch.cat([image, depth[..., None], alpha[..., None]], -1) * weight).sum(), leaves)
    expected = torch.autograd.grad((torch.cat([other, covered[..., None]], -1) * weight).sum(), theirs)
    assert_close([*expected[:2], *(g.sum(0) for g in expected[2:])], found, 1e-2)
