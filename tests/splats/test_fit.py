"""Gaussians fitted to a made-up frame, and to the truth scenes where they are at hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import binary_dilation

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.metrics import image as losses
from diffphys_ros.render import Rasterizer
from diffphys_ros.splats import fit_splats, ply
from diffphys_ros.types import object_mask

from . import made

ORDER_DB = 42
SETTINGS = config.build({"experiment.max_splats": 700, "experiment.splat_iterations": 60})


def finish(steps):
    """Progress and result of a generator."""
    seen = []
    while True:
        try:
            seen.append(next(steps))
        except StopIteration as stop:
            return seen, stop.value


def render(splats, camera, background=None):
    tensors = [torch.from_numpy(a) for a in vars(splats).values()]
    return [t.numpy() for t in Rasterizer(camera).render(*tensors, background)]


def fit_made(image=None, labels=None, depth=None):
    labels = made.mask().astype(np.uint8) if labels is None else labels
    image, depth = (given if given is not None else default() for given, default in ((image, made.image), (depth, made.depth)))
    return finish(fit_splats(image, labels, depth, made.camera(), SETTINGS))


@pytest.fixture(scope="module")
def fitted():
    return fit_made()


def test_the_object_is_drawn_to_35_decibel(fitted):
    image, mask = made.image(), made.mask()
    background = torch.full((3,), 120 / 255)
    drawn = render(fitted[1], made.camera(), background)[0].astype(float)
    assert losses.psnr_masked(drawn, image / 255, mask) > 35


def test_the_mask_is_filled_and_hardly_anything_bleeds_out_of_it(fitted):
    alpha, mask = render(fitted[1], made.camera())[1], made.mask()
    assert alpha[mask].mean() > 0.97
    assert alpha[~mask].sum() < 0.03 * mask.sum()


def test_the_drawn_depth_is_the_surface(fitted):
    depth, mask = render(fitted[1], made.camera())[2], made.mask()
    error = depth[mask] - made.depth()[mask]
    assert np.median(np.abs(error)) < 0.003
    assert abs(error.mean()) < 0.001


def test_progress_counts_up_and_the_loss_falls(fitted):
    seen = fitted[0]
    assert [k for k, _, _ in seen] == list(range(1, 61))
    assert {n for _, n, _ in seen} == {60}
    assert seen[-1][2] < 0.2 * seen[0][2]


def test_never_more_gaussians_than_asked_for(fitted):
    assert 500 < len(fitted[1].mean) <= 700


def test_a_chosen_count_follows_the_detail_of_the_picture(fitted):
    """A picture with a finer pattern is drawn well too, with more Gaussians."""
    few = config.build({"experiment.splat_iterations": 40})
    y, x = np.mgrid[: made.HEIGHT, : made.WIDTH]
    counts = []
    for wavelength_px in (40, 10):
        wave = np.sin(2 * np.pi * x / wavelength_px) * np.sin(2 * np.pi * y / wavelength_px)
        image = np.repeat(np.where(made.mask(), 120 + 60 * wave, 120)[..., None], 3, -1).astype(np.uint8)
        splats = finish(fit_splats(image, made.mask().astype(np.uint8), made.depth(), made.camera(), few))[1]
        drawn = render(splats, made.camera(), torch.full((3,), 120 / 255))[0].astype(float)
        assert losses.psnr_masked(drawn, image / 255, made.mask()) > 28
        counts.append(len(splats.mean))
    assert counts[1] > 1.5 * counts[0]


def test_two_fits_are_equal_to_the_bit(fitted):
    again = fit_made()[1]
    assert all(np.array_equal(a, b) for a, b in zip(vars(again).values(), vars(fitted[1]).values(), strict=True))


def test_the_result_survives_raw_form_to_the_bit(fitted):
    again = ply.from_raw(ply.to_raw(fitted[1]))
    assert all(np.array_equal(a, b) for a, b in zip(vars(again).values(), vars(fitted[1]).values(), strict=True))


def test_ignored_pixels_leave_no_trace():
    labels, image = made.mask().astype(np.uint8), made.image()
    labels[:, 30:36] = 255
    painted = image.copy()
    painted[:, 30:36] = (255, 0, 255)
    plain, changed = (fit_made(image=i, labels=labels)[1] for i in (image, painted))
    assert all(np.array_equal(a, b) for a, b in zip(vars(plain).values(), vars(changed).values(), strict=True))


def test_an_empty_mask_is_refused():
    with pytest.raises(InputError, match="frame 0 shows no object"):
        fit_made(labels=np.full((made.HEIGHT, made.WIDTH), 255, np.uint8))


def test_a_mask_without_any_depth_is_refused():
    with pytest.raises(InputError, match="depth: is 0 or not finite on the whole mask"):
        fit_made(depth=np.full((made.HEIGHT, made.WIDTH), np.nan, np.float32))


def test_holes_and_nan_in_the_depth_are_bridged():
    depth = made.depth()
    depth[20:24, 20:40], depth[10:14, 28:33] = 0, np.nan
    splats = fit_made(depth=depth)[1]
    assert all(np.isfinite(a).all() for a in vars(splats).values())


@pytest.mark.parametrize("scene", ["beam_gust"])
def test_frame_0_of_a_truth_scene_reaches_35_decibel(scene, scenes):
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.segment import label_clip

    settings = config.layered([scenes / scene / "given.yaml"], {"experiment.splat_iterations": 80})
    clip = read_clip(scenes / scene / "clip.mcap", settings)
    labels = label_clip(clip, settings)[0]
    assert clip.depth is not None
    _, splats = finish(fit_splats(clip.frames[0], labels, clip.depth[0], clip.camera, settings))
    around = torch.as_tensor(np.where((labels > 0)[..., None], clip.frames[0][labels == 0].mean(0), clip.frames[0]) / 255)
    drawn = render(splats, clip.camera, around)[0].astype(float)
    assert losses.psnr_masked(drawn, clip.frames[0] / 255, object_mask(labels)) > 35


@pytest.mark.parametrize("towards_rad", [0.0, np.pi / 2])
def test_the_picture_does_not_depend_on_which_disc_covers_which(fitted, towards_rad):
    """Two surfaces that lean opposite ways are drawn in opposite order, at the same places and sizes."""
    splats, camera, mask = fitted[1], made.camera(), made.mask()
    pixel, _ = camera.project(splats.mean.astype(float))
    across = (pixel - pixel.mean(0)) @ [np.cos(towards_rad), np.sin(towards_rad)] / camera.focal_px
    drawn = []
    for slope in (-0.06, 0.06):
        drawn.append(render(leaning(splats, across * slope), camera, torch.full((3,), 120 / 255))[0])
    assert losses.psnr_masked(drawn[0], drawn[1], mask) > ORDER_DB


def leaning(splats, slope):
    """The same picture, Gaussian by Gaussian, of depths that are larger by the share `slope` (G,)."""
    factor = (1 + slope)[:, None].astype(np.float32)
    sight = splats.mean - made.camera().position
    return replace(splats, mean=(made.camera().position + sight * factor).astype(np.float32), scale=splats.scale * factor)


def test_an_outline_fills_its_pixels_in_part_before_the_scene_that_is_known_there():
    """A black object on a white wall, whose outermost pixels are grey and were not labelled."""
    inner, behind = made.mask(), np.full((made.HEIGHT, made.WIDTH, 3), 255, np.uint8)
    edge = binary_dilation(inner) & ~inner
    image = np.where(inner[..., None], 0, np.where(edge[..., None], 128, behind)).astype(np.uint8)
    seen = {}
    for width in (0, 1):
        asked = config.build({"experiment.max_splats": 700, "experiment.splat_iterations": 60, "experiment.splat_edge_px": width})
        splats = finish(fit_splats(image, inner.astype(np.uint8), made.depth(), made.camera(), asked, behind=behind))[1]
        drawn = render(splats, made.camera(), torch.ones(made.HEIGHT, made.WIDTH, 3))[0]
        seen[width] = float(np.abs(drawn - image / 255)[edge].mean())
    assert seen[1] < 0.3 * seen[0]


def test_discs_at_several_depths_keep_their_order_and_draw_detail_that_leaning_discs_cannot():
    """A plane across the line of sight with a speckle of one pixel, seen as it is and leaning by 3 degrees."""
    rng = np.random.default_rng(0)
    image, mask, camera, flat = rng.integers(60, 200, (made.HEIGHT, made.WIDTH, 3), dtype=np.uint8), made.mask(), made.camera(), np.where(made.mask(), 0.6, 0)
    near = {}
    for spread in (0.0, 4.0):
        asked = config.build({"experiment.max_splats": 1600, "experiment.splat_iterations": 60, "experiment.splat_spread_px": spread})
        splats = finish(fit_splats(image, mask.astype(np.uint8), flat.astype(np.float32), camera, asked))[1]
        pixel, _ = camera.project(splats.mean.astype(float))
        drawn = render(leaning(splats, 0.05 * (pixel - pixel.mean(0))[:, 0] / camera.focal_px), camera, torch.full((3,), 120 / 255))[0]
        near[spread] = losses.psnr_masked(drawn, image / 255, mask)
    assert near[4.0] > near[0.0] + 3
