"""Blocks of pixels and the surface below them."""

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.splats.seed import MAX_STRETCH, count_blocks, gather_blocks, surface_at

from . import made


@pytest.mark.parametrize("count", [1, 10, 80, 400, 5000])
def test_blocks_cover_the_mask_once_and_keep_the_count(count):
    mask = made.mask()
    blocks = gather_blocks(made.image() / 255, mask, count)
    assert len(blocks.side) <= count
    assert (blocks.side**2).sum() == pytest.approx(mask.sum())


def test_the_blocks_together_keep_the_mean_colour():
    image, mask = made.image() / 255, made.mask()
    blocks = gather_blocks(image, mask, 150)
    np.testing.assert_allclose((blocks.color * blocks.side[:, None] ** 2).sum(0) / mask.sum(), image[mask].mean(0))


def test_with_room_for_all_every_differing_pixel_has_its_own_block():
    rng = np.random.default_rng(0)
    image, mask = rng.random((20, 30, 3)), np.ones((20, 30), bool)
    blocks = gather_blocks(image, mask, 600)
    x, y = np.rint(blocks.centre.T).astype(int)
    assert len(blocks.side) == 600
    np.testing.assert_allclose(blocks.color, image[y, x], atol=1e-12)


def test_detail_gets_smaller_blocks_than_flat_colour():
    image, mask = np.full((32, 64, 3), 0.5), np.ones((32, 64), bool)
    image[:, 32:] = np.random.default_rng(1).random((32, 32, 3))
    blocks = gather_blocks(image, mask, 600)
    left = blocks.centre[:, 0] < 32
    assert np.median(blocks.side[left]) == 4
    assert np.median(blocks.side[~left]) <= 2


def flat_colour_psnr(image, mask, count):
    """Of a picture in which every pixel has the colour of the nearest block."""
    blocks = gather_blocks(image, mask, count)
    rows, columns = np.nonzero(mask)
    apart = (rows[:, None] - blocks.centre[:, 1]) ** 2 + (columns[:, None] - blocks.centre[:, 0]) ** 2
    nearest = (apart / blocks.side**2).argmin(1)
    return -10 * np.log10(((blocks.color[nearest] - image[rows, columns]) ** 2).mean())


def test_as_many_blocks_are_counted_as_a_decibel_asks_for():
    image, mask = np.random.default_rng(2).normal(0.5, 0.1, (40, 60, 3)), np.ones((40, 60), bool)
    image[:, :28] = 0.5
    counts = [count_blocks(image, mask, db, 10_000) for db in (15, 26, 30, 34, 80)]
    assert counts[0] == 40 * 60 / 16
    assert counts == sorted(set(counts))
    assert counts[-1] == 40 * 28 / 16 + 40 * 32
    assert abs(flat_colour_psnr(image, mask, counts[2]) - 30) < 1
    assert count_blocks(image, mask, 80, 500) == 500


def test_a_pattern_whose_blocks_are_all_alike_is_counted_down_to_its_pixels():
    y, x = np.mgrid[:16, :16]
    image = np.repeat(((x + y) % 2)[..., None] * 1.0, 3, -1)
    assert count_blocks(image, np.ones((16, 16), bool), 30, 1000) == 256


def surface(pixels, depth=None):
    return surface_at(np.asarray(pixels, float), made.depth() if depth is None else depth, made.mask(), made.camera())


PIXELS = [[31, 24], [25, 20], [40, 28]]


def test_the_third_axis_is_the_planes_normal_towards_the_camera():
    normal = made.NORMAL / np.linalg.norm(made.NORMAL)
    expected = made.camera().world_from_camera[:3, :3] @ normal
    np.testing.assert_allclose(surface(PIXELS).axes[..., 2], np.broadcast_to(expected, (3, 3)), atol=0.01)


def test_axes_are_rotations():
    axes = surface(PIXELS).axes
    np.testing.assert_allclose(np.swapaxes(axes, 1, 2) @ axes, np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1)


def test_a_step_of_one_footprint_along_each_axis_is_one_pixel_and_the_two_are_square():
    camera, pixels, found = made.camera(), np.array(PIXELS, float), surface(PIXELS)
    centre = camera.backproject(pixels, found.depth)
    tiny = 1e-4
    moved = [camera.project(centre + tiny * found.axes[..., k] * found.footprint[:, k, None])[0] - pixels for k in (0, 1)]
    steps = np.stack(moved, -1) / tiny
    np.testing.assert_allclose(np.swapaxes(steps, 1, 2) @ steps, np.broadcast_to(np.eye(2), (3, 2, 2)), atol=2e-3)
    np.testing.assert_allclose(found.pixel_from_plane * found.footprint[:, None], steps, atol=2e-3)


def test_the_tilt_is_bounded_at_steps_in_the_depth():
    depth = made.depth()
    depth[:, 31:] += np.float32(0.3) * (depth[:, 31:] > 0)
    found = surface([[30, 24], [31, 24], [32, 24]], depth)
    assert (found.footprint[:, 0] / found.footprint[:, 1]).max() < MAX_STRETCH * 1.2


def test_unknown_depths_take_the_nearest_known():
    depth = np.where(made.mask(), 0.5, 0)
    depth[20:26, 25:35] = 0
    depth[27, 28] = np.nan
    np.testing.assert_allclose(surface([[30, 23], [28, 27]], depth).depth, 0.5)


def test_a_surface_without_any_depth_is_refused():
    with pytest.raises(InputError, match="give depths"):
        surface(PIXELS, np.zeros((made.HEIGHT, made.WIDTH)))
