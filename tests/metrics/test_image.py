"""Losses and metrics in cases that can be computed by hand."""

import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.metrics import image as losses
from diffphys_ros.types import object_mask

H, W = 24, 30


def noise(seed, *shape):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.fixture
def mask():
    m = torch.zeros(H, W, dtype=torch.bool)
    m[6:18, 8:20] = True
    return m


def test_the_object_mask_leaves_out_background_and_ignored_pixels():
    assert object_mask(np.array([[0, 1, 2, 255]], np.uint8)).tolist() == [[False, True, True, False]]


def test_l2_is_the_squared_offset_and_sees_nothing_outside_the_mask(mask):
    observed = noise(0, H, W, 3)
    rendered = observed + torch.where(mask, 0.25, torch.nan)[..., None]
    assert float(losses.masked_l2(rendered, observed, mask)) == pytest.approx(0.0625)


def test_ssim_of_an_image_with_itself_is_one(mask):
    image = noise(1, H, W, 3)
    assert float(losses.masked_ssim(image, image, mask)) == pytest.approx(1.0)


def test_ssim_of_two_flat_images_is_their_luminance_term():
    a, b = torch.full((1, 40, 40), 0.5, dtype=torch.float64), torch.full((1, 40, 40), 0.25, dtype=torch.float64)
    expected = (2 * 0.5 * 0.25 + 1e-4) / (0.5**2 + 0.25**2 + 1e-4)
    assert float(losses.ssim_map(a, b)[0, 20, 20]) == pytest.approx(expected)


def test_ssim_map_equals_the_formula_written_out_at_one_pixel():
    a, b = noise(2, 1, H, W), noise(3, 1, H, W)
    offset = np.arange(-5, 6)
    window = np.exp(-0.5 * (offset[:, None] ** 2 + offset**2) / 1.5**2)
    window /= window.sum()
    p, q = (t[0, 7:18, 9:20].numpy() for t in (a, b))
    mp, mq = (window * p).sum(), (window * q).sum()
    vp, vq, c = (window * (p - mp) ** 2).sum(), (window * (q - mq) ** 2).sum(), (window * (p - mp) * (q - mq)).sum()
    expected = (2 * mp * mq + 1e-4) * (2 * c + 9e-4) / ((mp**2 + mq**2 + 1e-4) * (vp + vq + 9e-4))
    assert float(losses.ssim_map(a, b)[0, 12, 14]) == pytest.approx(expected, rel=1e-9)


def test_image_loss_adds_weighted_dissimilarity_to_l2(mask):
    a, b = noise(4, H, W, 3), noise(5, H, W, 3)
    expected = losses.masked_l2(a, b, mask) + 0.3 * (1 - losses.masked_ssim(a, b, mask))
    assert float(losses.image_loss(a, b, mask, ssim_weight=0.3)) == pytest.approx(float(expected))


def test_image_loss_of_a_batch_of_equal_frames_is_that_of_one(mask):
    a, b = noise(6, H, W, 3), noise(7, H, W, 3)
    one = losses.image_loss(a, b, mask, ssim_weight=0.2)
    three = losses.image_loss(*(t.expand(3, *t.shape) for t in (a, b, mask)), ssim_weight=0.2)
    assert float(three) == pytest.approx(float(one))


def test_image_loss_gradient_equals_central_differences_and_vanishes_outside_the_mask(mask):
    a, b = noise(8, H, W, 3).requires_grad_(), noise(9, H, W, 3)
    losses.image_loss(a, b, mask, ssim_weight=0.5).backward()
    assert float(a.grad[~mask].abs().max()) == 0
    direction = noise(10, H, W, 3) - 0.5
    values = [float(losses.image_loss(a.detach() + s * direction, b, mask, ssim_weight=0.5)) for s in (1e-6, -1e-6)]
    assert float((a.grad * direction).sum()) == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-5)


def test_an_empty_mask_gives_zero_loss():
    a, b, none = noise(11, H, W, 3), noise(12, H, W, 3), torch.zeros(H, W, dtype=torch.bool)
    assert float(losses.image_loss(a, b, none, ssim_weight=0.2)) == 0
    assert float(losses.depth_loss(a[..., 0], b[..., 0], none)) == 0


def test_depth_loss_is_quadratic_near_and_linear_far(mask):
    observed = torch.full((H, W), 0.5, dtype=torch.float64)
    near, far = (float(losses.depth_loss(observed + e, observed, mask, scale_m=0.02)) for e in (1e-4, 2.0))
    assert near == pytest.approx(1e-8, rel=1e-4)
    assert far == pytest.approx(2 * 0.02 * 2.0, rel=0.02)


def test_depth_loss_ignores_unknown_depths(mask):
    observed = torch.full((H, W), 0.5, dtype=torch.float64)
    observed[8, 10], observed[9, 10], observed[10, 10] = 0.0, torch.nan, torch.inf
    rendered = torch.full((H, W), 0.5, dtype=torch.float64, requires_grad=True)
    loss = losses.depth_loss(rendered, observed, mask)
    loss.backward()
    assert loss.item() == 0
    assert bool(torch.isfinite(rendered.grad).all())


def test_psnr_of_a_known_offset(mask):
    observed = np.full((H, W, 3), 100, np.uint8)
    rendered = np.where(mask.numpy()[..., None], observed + 51, 7).astype(np.uint8)
    assert losses.psnr_masked(rendered, observed, mask.numpy()) == pytest.approx(20 * np.log10(5))


def test_psnr_of_equal_images_is_a_hundred_decibel(mask):
    image = np.full((H, W, 3), 100, np.uint8)
    assert losses.psnr_masked(image, image, mask.numpy()) == pytest.approx(100)


def test_ssim_metric_of_bytes_equals_that_of_unit_values(mask):
    a, b = ((noise(s, H, W, 3) * 255).to(torch.uint8) for s in (13, 14))
    assert losses.ssim_masked(a.numpy(), b.numpy(), mask.numpy()) == pytest.approx(
        losses.ssim_masked(a.double() / 255, b.double() / 255, mask)
    )


def test_metrics_refuse_an_empty_mask():
    image, none = np.zeros((H, W, 3), np.uint8), np.zeros((H, W), bool)
    for metric in (losses.psnr_masked, losses.ssim_masked):
        with pytest.raises(InputError, match="no pixel to compare"):
            metric(image, image, none)


def test_the_frozen_first_frame_is_compared_over_each_later_object():
    frames, labels = np.zeros((3, H, W, 3), np.uint8), np.zeros((3, H, W), np.uint8)
    frames[1], labels[1, 2:9] = 51, 1
    found = losses.psnr_frozen_frame(frames, labels)
    assert found[0] == pytest.approx(20 * np.log10(5))
    assert np.isnan(found[1])


def test_the_ssim_of_an_object_does_not_depend_on_the_picture_around_it():
    rng = np.random.default_rng(4)
    a, b = rng.random((2, 40, 50, 3))
    mask = np.zeros((40, 50), bool)
    mask[12:25, 8:31] = rng.random((13, 23)) > 0.2
    inside = losses.ssim_masked(a, b, mask)
    assert inside == pytest.approx(float(losses.masked_ssim(*(torch.from_numpy(t) for t in (a, b, mask)))), abs=1e-12)
    assert inside == losses.ssim_masked(a[10:, 5:], b[10:, 5:], mask[10:, 5:])


def test_blocks_are_means_and_counted_where_one_of_their_pixels_is():
    image, mask = torch.arange(5.0).view(1, 1, 5, 1).expand(1, 3, 5, 3), torch.zeros(1, 3, 5, dtype=torch.bool)
    mask[0, 0, 4] = True
    torch.testing.assert_close(losses.coarser(image, 2)[0, :, :, 0], torch.tensor([[0.5, 2.5, 4.0], [0.5, 2.5, 4.0]]))
    assert losses.coarser_mask(mask, 2)[0].tolist() == [[False, False, True], [False, False, False]]
