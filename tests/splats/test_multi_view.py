"""Gaussians of a painted block, fitted to pictures from all around and to frames in which it moves."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.metrics.image import psnr_masked
from diffphys_ros.render import Rasterizer
from diffphys_ros.splats import View, fit_views, from_points, ply

from . import around
from .test_fit import finish

SIZE = {"width": 48, "height": 36}
SETTINGS = config.build({})


def block_view(angle_rad, world_from_block=around.STILL, motion=None):
    camera = around.camera(angle_rad, **SIZE)
    image, labels = around.picture(camera, world_from_block)
    return View(image, camera, labels, motion=motion)


def block_points(count=250):
    points, colors = around.cloud(2 * count)
    return from_points(points[:count], colors[:count])


def psnr(splats, view):
    tensors = [torch.from_numpy(a) for a in vars(splats).values()]
    behind = torch.from_numpy(view.behind.copy()) / 255
    return psnr_masked(Rasterizer(view.camera).render(*tensors, behind)[0].clamp(0, 1), torch.from_numpy(view.image) / 255, view.mask)


VIEWS = [block_view(angle) for angle in np.linspace(0, 2 * np.pi, 9)[:-1]]


@pytest.fixture(scope="module")
def fitted():
    return finish(fit_views(VIEWS, block_points(), SETTINGS, iterations=160, count=700))


@pytest.mark.slow
def test_pictures_from_all_around_are_drawn_and_those_in_between_too(fitted):
    splats = fitted[1]
    seen, unseen = (np.mean([psnr(splats, v) for v in views]) for views in (VIEWS, [block_view(a + np.pi / 8) for a in (0, 2, 4)]))
    assert seen > 21
    assert unseen > 19.5


def test_progress_counts_up_the_loss_falls_and_the_number_of_gaussians_grows(fitted):
    seen, splats = fitted
    assert [k for k, _, _ in seen] == list(range(1, 161))
    assert np.mean([loss for _, _, loss in seen[-8:]]) < 0.2 * np.mean([loss for _, _, loss in seen[:8]])
    assert 400 < len(splats.mean) <= 700


def test_two_fits_are_equal_to_the_bit_and_survive_raw_form():
    first, second = (finish(fit_views(VIEWS[:3], block_points(60), SETTINGS, iterations=20))[1] for _ in range(2))
    for other in (second, ply.from_raw(ply.to_raw(first))):
        assert all(np.array_equal(a, b) for a, b in zip(vars(first).values(), vars(other).values(), strict=True))


def test_without_labels_the_whole_picture_counts():
    camera = around.camera(0.3, **SIZE)
    view = View(around.picture(camera)[0], camera)
    start = from_points(*around.cloud(400))
    splats = finish(fit_views([view], start, SETTINGS, iterations=80, count=800))[1]
    assert psnr(splats, view) > max(psnr(start, view) + 8, 20)


def moved(k):
    """Rigid transform of the block in frame k, and the motion that says so."""
    turn, shift = Rotation.from_rotvec([0, 0, 0.25 * k]), np.array([0.03, -0.02, 0.01]) * k
    world_from_block = np.eye(4)
    world_from_block[:3, :3], world_from_block[:3, 3] = turn.as_matrix(), shift
    quaternion = torch.tensor(turn.as_quat()[[3, 0, 1, 2]], dtype=torch.float32)

    def motion(mean):
        there = mean @ torch.tensor(turn.as_matrix().T, dtype=torch.float32) + torch.tensor(shift, dtype=torch.float32)
        return there - mean, quaternion.expand(len(mean), 4)

    return world_from_block, motion


@pytest.mark.slow
def test_frames_of_a_known_motion_give_the_gaussians_of_frame_0():
    """One camera sees the block turn. The frames' motion makes views from around of it; without it they do not fit together."""
    angle, frames = 0.4, [0, -2, -1, 1, 2]
    views = [block_view(angle, *moved(k)) for k in frames]
    still = [replace(view, motion=None) for view in views]
    with_motion, without_motion = (finish(fit_views(v, block_points(), SETTINGS, iterations=100, count=500))[1] for v in (views, still))
    held_out = block_view(angle - 0.375)  # the block as it is in frame 0, from where frame 1.5 shows it
    assert psnr(with_motion, held_out) > 20
    assert psnr(with_motion, views[0]) > psnr(without_motion, views[0]) + 3


def test_ignored_pixels_leave_no_trace():
    labels = VIEWS[0].labels.copy()
    labels[:, 20:24] = 255
    painted = VIEWS[0].image.copy()
    painted[:, 20:24] = (255, 0, 255)
    views = [replace(VIEWS[0], image=image, labels=labels) for image in (VIEWS[0].image, painted)]
    plain, changed = (finish(fit_views([v, VIEWS[1]], block_points(80), SETTINGS, iterations=15))[1] for v in views)
    assert all(np.array_equal(a, b) for a, b in zip(vars(plain).values(), vars(changed).values(), strict=True))


def test_views_that_show_nothing_are_left_out_and_refused_where_there_are_no_others():
    empty = replace(VIEWS[1], labels=np.zeros_like(VIEWS[1].labels))
    alone, beside = (finish(fit_views(v, block_points(40), SETTINGS, iterations=5))[1] for v in (VIEWS[:1], [VIEWS[0], empty]))
    assert np.array_equal(alone.mean, beside.mean)
    with pytest.raises(InputError, match="none of 1 shows the object"):
        finish(fit_views([empty], block_points(40), SETTINGS))


def test_a_picture_of_another_size_than_its_camera_is_refused():
    with pytest.raises(InputError, match=r"view 0: image of \(30, 48\) px must be \(36, 48\)"):
        finish(fit_views([replace(VIEWS[0], image=VIEWS[0].image[:30])], block_points(40), SETTINGS))
