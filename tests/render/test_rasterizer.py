"""The Warp renderer against a plain torch twin in double precision, and against closed forms."""

import weakref

import numpy as np
import pytest
import torch
from torch.utils.checkpoint import checkpoint

from diffphys_ros.errors import InputError
from diffphys_ros.render import Rasterizer, window_around
from diffphys_ros.render.cpu import CpuChain
from diffphys_ros.types import Camera

from . import random_scenes, twin

SEEDS = (0, 1, 2)


def cotangents(camera, seed=0):
    generator = torch.Generator().manual_seed(seed)
    shape = camera.height, camera.width
    return [torch.randn(*shape, *extra, generator=generator, dtype=torch.float64) for extra in ((3,), (), ())]


def both(seed, count=60, opacity=(0.2, 0.95)):
    """Camera, twin's leaves and outputs, renderer's leaves and outputs, over the same random background."""
    camera = random_scenes.oblique_camera()
    exact = random_scenes.random_gaussians(camera, count, seed, opacity)
    background = torch.rand(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    rounded = random_scenes.to_float32(exact)
    outputs = Rasterizer(camera).render(*rounded, background.float())
    return camera, exact, twin.render(*exact, camera, background), rounded, outputs


@pytest.mark.parametrize("seed", SEEDS)
def test_image_alpha_and_depth_equal_the_twins(seed):
    _, _, expected, _, found = both(seed)
    for name, a, b in zip(("image", "alpha", "depth"), expected, found, strict=True):
        error = (a - b).abs()
        assert error.max() < 0.02, name  # one contribution just at the cut-off of 1/255 may fall on the other side
        assert error.flatten().sort().values[: int(0.99 * error.numel())].max() < 2e-5, name


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", random_scenes.NAMES)
def test_gradients_equal_the_twins(seed, name):
    camera, exact, expected, rounded, found = both(seed)
    weights = cotangents(camera, seed)
    sum((w * a).sum() for w, a in zip(weights, expected, strict=True)).backward()
    sum((w * b).sum() for w, b in zip(weights, found, strict=True)).backward()
    i = random_scenes.NAMES.index(name)
    a, b = exact[i].grad, rounded[i].grad.double()
    assert (a - b).norm() < 5e-4 * a.norm()


@pytest.mark.parametrize("output", [0, 1, 2])
def test_gradient_of_each_output_alone_equals_the_twins(output):
    camera, exact, expected, rounded, found = both(3, count=30)
    weight = cotangents(camera)[output]
    (weight * expected[output]).sum().backward()
    (weight * found[output]).sum().backward()
    for name, a, b in zip(random_scenes.NAMES, exact, rounded, strict=True):
        if a.grad is not None:
            assert (a.grad - b.grad.double()).norm() <= 5e-4 * a.grad.norm() + 1e-6, name


def test_opaque_stacks_stop_and_clamp_like_the_twin():
    _, exact, expected, rounded, found = both(5, count=150, opacity=(0.97, 1.0))
    assert (expected[0] - found[0]).abs().mean() < 1e-5
    (expected[0] ** 2).sum().backward()
    (found[0] ** 2).sum().backward()
    for name, a, b in zip(random_scenes.NAMES, exact, rounded, strict=True):
        assert (a.grad - b.grad.double()).norm() < 0.02 * a.grad.norm(), name


@pytest.mark.parametrize("name", random_scenes.NAMES)
def test_gradient_equals_central_differences(name):
    camera = random_scenes.oblique_camera(12, 10)
    # so wide that every pixel is in reach: the image is smooth, the cut-off at 1/255 plays no part
    leaves = random_scenes.to_float32(random_scenes.random_gaussians(camera, 6, 4, (0.5, 0.9), (9.0, 14.0)))
    weight = cotangents(camera, 4)[0].float()
    i, renderer = random_scenes.NAMES.index(name), Rasterizer(camera)

    def loss(values):
        return float((weight * renderer.render(*values)[0]).double().sum().detach())

    (weight * renderer.render(*leaves)[0]).sum().backward()
    direction = torch.randn(leaves[i].shape, generator=torch.Generator().manual_seed(1)) * leaves[i].detach().abs()
    step = 2e-3
    moved = [[t + sign * step * direction if j == i else t for j, t in enumerate(leaves)] for sign in (1, -1)]
    numeric = (loss(moved[0]) - loss(moved[1])) / (2 * step)
    analytic = float((leaves[i].grad * direction).sum())
    assert analytic == pytest.approx(numeric, rel=5e-3, abs=5e-3)


def plain_camera(width=41, height=31, focal=50.0):
    return Camera(np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]), np.eye(4), width, height)


def gaussian(mean, scale, opacity=0.8, color=(1.0, 0.5, 0.25)):
    rows = [mean, [1.0, 0, 0, 0], scale, opacity, color]
    return [torch.tensor([row], dtype=torch.float32) for row in rows]


def test_one_gaussian_is_the_projected_ellipse():
    camera, depth = plain_camera(), 2.0
    _, alpha, z = Rasterizer(camera).render(*gaussian([0.0, 0.0, depth], [0.2, 0.1, 0.05]))
    sx2, sy2 = (0.2 * 50 / depth) ** 2 + 0.3, (0.1 * 50 / depth) ** 2 + 0.3
    y, x = np.mgrid[:31, :41] - np.array([15, 20])[:, None, None]
    expected = 0.8 * np.exp(-0.5 * (x**2 / sx2 + y**2 / sy2))
    np.testing.assert_allclose(alpha.numpy(), np.where(expected >= 1 / 255, expected, 0), atol=1e-6)
    np.testing.assert_allclose(z.numpy()[expected >= 1 / 255], depth, rtol=1e-5)


def test_pixel_centres_lie_at_integer_coordinates():
    camera = plain_camera()
    point = camera.backproject(np.array([12.0, 7.0]), np.array(1.5))
    _, alpha, _ = Rasterizer(camera).render(*gaussian(point.tolist(), [0.01, 0.01, 0.01]))
    assert divmod(int(alpha.argmax()), camera.width) == (7, 12)
    assert float(alpha[7, 11]) == pytest.approx(float(alpha[7, 13]), rel=1e-4)


def test_the_nearer_gaussian_covers_the_farther_whatever_their_order():
    near, far = gaussian([0, 0, 1.0], [0.1] * 3, 0.75, (1, 0, 0)), gaussian([0, 0, 2.0], [0.2] * 3, 0.5, (0, 1, 0))
    for first, second in ((near, far), (far, near)):
        image, alpha, depth = Rasterizer(plain_camera()).render(*map(torch.cat, zip(first, second, strict=True)), torch.tensor([0, 0, 1.0]))
        np.testing.assert_allclose(image[15, 20], [0.75, 0.25 * 0.5, 0.25 * 0.5], atol=1e-6)
        assert float(alpha[15, 20]) == pytest.approx(0.875)
        assert float(depth[15, 20]) == pytest.approx((0.75 * 1 + 0.125 * 2) / 0.875, rel=1e-5)


def test_gaussians_behind_the_camera_leave_no_trace_and_no_gradient():
    leaves = [t.requires_grad_() for t in gaussian([0, 0, -1.0], [0.1] * 3)]
    image, alpha, depth = Rasterizer(plain_camera()).render(*leaves, torch.tensor([0.2, 0.4, 0.6]))
    np.testing.assert_allclose(image.detach(), np.broadcast_to(np.float32([0.2, 0.4, 0.6]), (31, 41, 3)))
    (image.sum() + alpha.sum() + depth.sum()).backward()
    assert all(float(t.grad.abs().sum()) == 0 for t in leaves)


@pytest.mark.parametrize("name", random_scenes.NAMES[:4])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_gaussian_that_is_not_finite_is_left_out_and_has_no_gradient(name, value):
    camera = random_scenes.oblique_camera()
    whole = random_scenes.to_float32(random_scenes.random_gaussians(camera, 20, 2))
    with torch.no_grad():
        whole[random_scenes.NAMES.index(name)][0] = value
    found, expected = (Rasterizer(camera).render(*tensors) for tensors in (whole, [t[1:] for t in whole]))
    for a, b in zip(found, expected, strict=True):
        assert torch.equal(a, b)
    for gradient in torch.autograd.grad(sum(t.sum() for t in found), whole):
        assert torch.isfinite(gradient).all()
        assert float(gradient[0].abs().sum()) == 0


def test_a_batch_equals_frame_by_frame_in_values_and_gradients():
    camera = random_scenes.oblique_camera()
    mean, rotation, scale, opacity, color = random_scenes.to_float32(random_scenes.random_gaussians(camera, 40, 7))
    shift = torch.tensor([0.0, 0.01, -0.02])[:, None, None]
    renderer, weight = Rasterizer(camera), cotangents(camera)[0].float()
    single = [renderer.render(mean + s, rotation + s, scale, opacity, color) for s in shift]
    together = renderer.render_frames(mean + shift, rotation + shift, scale, opacity, color)
    for k, found in enumerate(together):
        assert torch.equal(found, torch.stack([frame[k] for frame in single]))
    leaves = (mean, rotation, scale, opacity, color)
    one = torch.autograd.grad(sum((weight * frame[0]).sum() for frame in single), leaves)
    all_frames = torch.autograd.grad((weight * together[0]).sum(), leaves)
    for a, b in zip(one, all_frames, strict=True):
        assert (a - b).norm() < 1e-5 * a.norm()


def test_a_window_is_the_crop_of_the_whole_image():
    camera = random_scenes.oblique_camera()
    leaves = random_scenes.to_float32(random_scenes.random_gaussians(camera, 40, 8))
    background = torch.rand(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(0))
    renderer, (left, top, right, bottom) = Rasterizer(camera), (7, 5, 30, 26)
    whole, crop = renderer.render(*leaves, background), renderer.render(*leaves, background, window=(left, top, right, bottom))
    for a, b in zip(whole, crop, strict=True):
        torch.testing.assert_close(a[top:bottom, left:right], b, atol=2e-5, rtol=0)


def test_the_background_receives_the_transmittance_as_gradient():
    background = torch.full((31, 41, 3), 0.5, requires_grad=True)
    image, alpha, _ = Rasterizer(plain_camera()).render(*gaussian([0, 0, 1.0], [0.1] * 3), background)
    image.sum().backward()
    torch.testing.assert_close(background.grad, (1 - alpha)[..., None].expand(-1, -1, 3))


def test_two_runs_are_equal_to_the_bit():
    camera = random_scenes.oblique_camera()
    gradients = []
    for _ in range(2):
        leaves = random_scenes.to_float32(random_scenes.random_gaussians(camera, 50, 9))
        sum(t.sum() for t in Rasterizer(camera).render(*leaves)).backward()
        gradients.append([t.grad for t in leaves])
    assert all(torch.equal(a, b) for a, b in zip(*gradients, strict=True))


def test_a_wrong_shape_is_named():
    mean, rotation, scale, opacity, color = gaussian([0, 0, 1.0], [0.1] * 3)
    with pytest.raises(InputError, match=r"scale has shape \(1, 2\)"):
        Rasterizer(plain_camera()).render(mean, rotation, scale[:, :2], opacity, color)


def test_a_window_outside_the_image_is_refused():
    with pytest.raises(InputError, match="inside the image of 41 x 31"):
        Rasterizer(plain_camera()).render(*gaussian([0, 0, 1.0], [0.1] * 3), window=(0, 0, 42, 10))


def test_window_around_covers_every_mask_and_stays_inside():
    masks = np.zeros((2, 31, 41), bool)
    masks[0, 10, 3], masks[1, 20, 38] = True, True
    assert window_around(masks, 5) == (0, 5, 41, 26)
    with pytest.raises(InputError, match="no pixel"):
        window_around(np.zeros((31, 41), bool), 2)


def test_a_background_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"background: has shape \(41, 31, 3\), must be"):
        Rasterizer(plain_camera()).render(*gaussian([0, 0, 1.0], [0.1] * 3), torch.zeros(41, 31, 3))


def test_each_frame_shows_its_own_background():
    mean, rotation, *rest = gaussian([0, 0, 1.0], [0.1] * 3)
    behind = torch.rand(2, 31, 41, 3, generator=torch.Generator().manual_seed(0))
    window = (3, 4, 30, 25)
    image, alpha, _ = Rasterizer(plain_camera()).render_frames(mean.expand(2, 1, 3), rotation.expand(2, 1, 4), *rest, behind, window=window)
    black, _, _ = Rasterizer(plain_camera()).render(mean, rotation, *rest, window=window)
    torch.testing.assert_close(image, black + (1 - alpha)[..., None] * behind[:, 4:25, 3:30])


def test_a_checkpoint_lets_go_of_all_that_the_way_back_needs(monkeypatch):
    camera = random_scenes.oblique_camera()
    leaves = random_scenes.to_float32(random_scenes.random_gaussians(camera, 60, 0, (0.2, 0.95)))
    rasterizer, kept, forward = Rasterizer(camera), [], CpuChain.forward

    def watched(chain, scene):
        rendered = forward(chain, scene)
        kept.extend(map(weakref.ref, rendered.kept))
        return rendered

    monkeypatch.setattr(CpuChain, "forward", watched)
    plain = torch.autograd.grad(rasterizer.render(*leaves)[0].sum(), leaves)
    kept.clear()
    image = checkpoint(lambda *given: rasterizer.render(*given)[0], *leaves, use_reentrant=False)
    assert kept
    assert not any(known() is not None for known in kept)
    for a, b in zip(plain, torch.autograd.grad(image.sum(), leaves), strict=True):
        assert torch.equal(a, b)
