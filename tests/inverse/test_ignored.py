"""An arm that crosses the object is no part of loss, background, tracks and Gaussians, whatever it looks like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffphys_ros.config import build
from diffphys_ros.depth import surface_depth
from diffphys_ros.inverse import carried
from diffphys_ros.inverse.carried import CarriedGaussians
from diffphys_ros.inverse.evidence.pixels import ImageTerm, static_background
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.particles import bind
from diffphys_ros.progress import finished
from diffphys_ros.render import Rasterizer
from diffphys_ros.splats import fit_splats
from diffphys_ros.tracks import follow
from diffphys_ros.types import IGNORE, Clip
from tests.boxes import bar_settings
from tests.segment.occluded import Occluded, arm_across_a_bar


@pytest.fixture(scope="module")
def crossed() -> tuple[Occluded, Clip]:
    """The scene, and its clip with true labels: the bar 1, the arm before it 255."""
    scene = arm_across_a_bar()
    return scene, scene.clip.with_labels(np.where(scene.hidden, IGNORE, scene.object).astype(np.uint8))


def repainted(clip: Clip, seed: int) -> Clip:
    """Other colours and other depths at every ignored pixel."""
    rng, ignored = np.random.default_rng(seed), clip.labels == IGNORE
    noise = rng.integers(0, 256, clip.frames.shape, dtype=np.uint8)
    depth = None if clip.depth is None else np.where(ignored, rng.uniform(0.2, 0.4, ignored.shape), clip.depth).astype(np.float32)
    return replace(clip, frames=np.where(ignored[..., None], noise, clip.frames), depth=depth)


@pytest.fixture(scope="module")
def terms(prepared: Prepared, crossed: tuple[Occluded, Clip]):
    """Image and depth term, with their gradients, of a clip; the object is a handful of Gaussians in the world frame."""

    def of(clip: Clip) -> tuple[float, float, np.ndarray]:
        own = replace(prepared, clip=clip, body=replace(prepared.body, world_from_body=np.eye(4)))
        grid = np.stack(np.meshgrid(np.linspace(0.01, 0.23, 12), [-0.025], np.linspace(-0.025, 0.025, 4), indexing="ij"), -1).reshape(-1, 3)
        points = torch.as_tensor(grid, dtype=torch.float32)
        count = len(points)
        identity = torch.tensor([1.0, 0, 0, 0]).expand(count, 4).contiguous()
        shape = torch.full((count, 3), 0.008), torch.full((count,), 0.9), torch.full((count, 3), 0.4)
        behind = torch.as_tensor(static_background(clip)).float() / 255
        renderer = CarriedGaussians(Rasterizer(clip.camera, "cpu"), bind(grid, grid), points, identity, *shape, torch.eye(4)[:3], behind)
        term = ImageTerm(own, renderer, every=2, ssim_weight=0.2, with_depth=True)
        x = points[None].repeat(len(clip), 1, 1).requires_grad_()
        F = torch.eye(3).expand(len(clip), count, 3, 3)
        image, depth = term(x, F, 1e-4)
        (image + depth).backward()
        return image.item(), depth.item(), x.grad.numpy()

    return of


def test_what_the_arm_looks_like_changes_neither_loss_nor_gradient(terms, crossed: tuple[Occluded, Clip]) -> None:
    plain, changed = terms(crossed[1]), terms(repainted(crossed[1], 1))
    assert plain[0] > 0
    assert plain[1] > 0
    assert plain[:2] == changed[:2]
    np.testing.assert_array_equal(plain[2], changed[2])
    assert np.abs(plain[2]).max() > 0


def test_without_the_label_the_arm_would_change_the_loss(terms, crossed: tuple[Occluded, Clip]) -> None:
    scene, clip = crossed
    everything = (scene.object | scene.hidden).astype(np.uint8)
    blind = [terms(one.with_labels(everything)) for one in (clip, repainted(clip, 1))]
    assert blind[0][0] != blind[1][0]
    assert not np.array_equal(blind[0][2], blind[1][2])


def test_the_arm_does_not_enter_the_background(crossed: tuple[Occluded, Clip]) -> None:
    np.testing.assert_array_equal(static_background(crossed[1]), static_background(repainted(crossed[1], 2)))


def test_the_scene_is_asked_of_frames_that_show_it_away_from_the_object(crossed: tuple[Occluded, Clip]) -> None:
    """A square of one colour moves to the right; the column of pixels beside it, which is not labelled, has its colour."""
    frames, labels = np.full((8, 12, 20, 3), 50, np.uint8), np.zeros((8, 12, 20), np.uint8)
    for k in range(8):
        labels[k, 3:9, 2 + k : 8 + k] = 1
        frames[k, 3:9, 2 + k : 9 + k] = 200
    clip = replace(crossed[1], frames=frames, labels=labels, depth=None)
    assert (static_background(clip, edge_px=1)[3:9, 9] == 50).all()  # one frame shows this column as it is, one beside the object
    assert (static_background(clip)[3:9, 9] == 125).all()


def test_what_one_frame_alone_shows_is_taken_from_it(crossed: tuple[Occluded, Clip]) -> None:
    """An object that steps aside in one frame of 40, of which every second is asked first."""
    frames, labels = np.full((40, 12, 20, 3), 50, np.uint8), np.zeros((40, 12, 20), np.uint8)
    labels[:, 3:9, 4:10], frames[:, 3:9, 4:10] = 1, 200
    labels[7], frames[7], frames[7, 3:9, 4:10] = 0, 50, 120
    clip = replace(crossed[1], frames=frames, labels=labels, depth=None)
    assert (static_background(clip, edge_px=1)[3:9, 4:10] == 120).all()


def test_no_track_is_valid_on_the_arm(crossed: tuple[Occluded, Clip]) -> None:
    scene, clip = crossed
    tracks = follow(clip, surface_depth(clip, bar_settings())[0], bar_settings())
    index = np.clip(np.rint(tracks.pixels).astype(int), 0, np.array(clip.frames.shape[2:0:-1]) - 1)
    on_arm = np.take_along_axis(scene.hidden.reshape(len(clip), -1), index[..., 1] * clip.camera.width + index[..., 0], 1)
    assert on_arm.sum() > 100
    assert (on_arm & tracks.valid).sum() <= 0.01 * on_arm.sum()
    assert tracks.valid[-1].mean() > 0.9


def test_gaussians_of_a_clip_that_begins_under_the_arm_do_not_know_it(crossed: tuple[Occluded, Clip]) -> None:
    settings = build({"experiment.splat_iterations": 3, "experiment.max_splats": 60})
    fitted = []
    for clip in (crossed[1], repainted(crossed[1], 3)):
        depth0 = np.where(clip.labels[7] == 1, clip.depth[7], 0).astype(np.float32)
        fitted.append(finished(fit_splats(clip.frames[7], clip.labels[7], depth0, clip.camera, settings)))
    assert all(np.array_equal(a, b) for a, b in zip(vars(fitted[0]).values(), vars(fitted[1]).values(), strict=True))


@pytest.mark.parametrize("frames", [1, 3])
def test_frames_in_turn_give_the_loss_and_gradient_of_all_at_once(terms, crossed: tuple[Occluded, Clip], monkeypatch: pytest.MonkeyPatch, frames: int) -> None:
    whole = terms(crossed[1])
    monkeypatch.setitem(carried.AT_ONCE, "cpu", 48 * frames)
    parts = terms(crossed[1])
    assert parts[:2] == pytest.approx(whole[:2], rel=1e-5)
    np.testing.assert_allclose(parts[2], whole[2], atol=1e-5 * np.abs(whole[2]).max())
