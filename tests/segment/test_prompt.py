"""Box and point choose the object; the motion mask reaches the still root."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.segment.motion import motion_mask
from diffphys_ros.segment.otsu import otsu_mask
from diffphys_ros.segment.prompt import NO_MARK, Mark, Prompt
from diffphys_ros.types import Clip
from tests.boxes import Box, bar, bar_settings, box_clip, oblique_camera, turned

SHAPE = (60, 100)
MOUNT = Box(np.array([-0.04, -0.05, -0.05]), np.array([0.0, 0.05, 0.05]))


def two_regions() -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[10:40, 10:50] = mask[20:30, 70:90] = True
    return mask


def test_the_largest_region_counts_where_nobody_points() -> None:
    assert np.array_equal(np.nonzero(Prompt(None, None).region(two_regions()).any(0))[0], np.arange(10, 50))


@pytest.mark.parametrize("prompt", [Prompt(None, np.array([80.0, 25.0])), Prompt(None, np.array([66.0, 25.0])), Prompt(np.array([60.0, 0, 99, 59]), None)])
def test_a_click_on_or_beside_a_region_or_a_box_around_it_chooses_it(prompt: Prompt) -> None:
    assert np.array_equal(np.nonzero(prompt.region(two_regions()).any(0))[0], np.arange(70, 90))


def test_a_click_far_from_every_region_is_refused() -> None:
    with pytest.raises(InputError, match=r"segment\.point_px \[99\.0, 59\.0\].*click on the object"):
        Prompt(None, np.array([99.0, 59.0])).region(two_regions())


@pytest.mark.parametrize(
    ("values", "name"),
    [({"segment__box_px": [30, 10, 20, 40]}, "box_px"), ({"segment__box_px": [200, 10, 220, 40]}, "box_px"), ({"segment__point_px": [100, 10]}, "point_px")],
)
def test_prompts_off_the_image_are_refused(values: dict[str, list[float]], name: str) -> None:
    with pytest.raises(InputError, match=rf"segment\.{name}.*100 x 60 image"):
        Prompt.of(bar_settings(**values), NO_MARK, SHAPE)


@pytest.mark.parametrize("point", [[100.0, 10.0], [10.0, np.nan]])
def test_a_click_off_the_image_is_refused_as_a_click_not_as_a_setting(point: list[float]) -> None:
    with pytest.raises(InputError, match=r"^the click \[1.*100 x 60 image"):
        Prompt.of(bar_settings(segment__point_px=[5, 5]), Mark(point=np.array(point)), SHAPE)


def test_a_click_goes_before_the_point_of_the_settings_and_keeps_their_box() -> None:
    settings = bar_settings(segment__point_px=[5, 5], segment__box_px=[0, 0, 50, 50])
    prompt = Prompt.of(settings, Mark(point=np.array([20.0, 30.0])), SHAPE)
    assert prompt.point is not None
    assert prompt.box is not None
    assert (prompt.point.tolist(), prompt.box.tolist()) == ([20, 30], [0, 0, 50, 50])


@pytest.fixture(scope="module")
def two_movers() -> Clip:
    """Beside the swinging bar a smaller patch slides to and fro."""
    clip = box_clip(bar(), [turned(0.1 * np.sin(0.9 * k)) for k in range(9)], oblique_camera())
    frames, noise = clip.frames.copy(), np.random.default_rng(1).integers(0, 255, (30, 40, 3), dtype=np.uint8)
    patch = cv2.GaussianBlur(noise, (0, 0), 1.2)
    for k, frame in enumerate(frames):
        left = 180 + round(4 * np.sin(0.9 * k))
        frame[120:150, left : left + 40] = patch
    return replace(clip, frames=frames, labels=None, depth=None)


@pytest.mark.parametrize("values", [{"segment__point_px": [200, 135]}, {"segment__box_px": [160, 110, 239, 159]}])
def test_a_prompt_chooses_among_moving_regions(two_movers: Clip, values: dict[str, list[float]]) -> None:
    chosen = motion_mask(two_movers, bar_settings(**values)) > 0
    assert chosen[122:148, 184:216].mean() > 0.95
    assert not chosen[:100].any()
    assert (motion_mask(two_movers, bar_settings()) > 0)[120:150, 184:216].mean() < 0.05


def test_no_part_of_the_mask_lies_outside_the_box(two_movers: Clip) -> None:
    whole = motion_mask(two_movers, bar_settings()) > 0
    right, bottom = (int(np.nonzero(whole.any(axis))[0].mean()) for axis in (0, 1))
    mask = motion_mask(two_movers, bar_settings(segment__box_px=[0, 0, right, bottom])) > 0
    assert mask.any()
    assert not mask[:, right + 1 :].any()
    assert not mask[bottom + 1 :].any()


def test_a_click_chooses_among_what_stands_out_from_the_border(two_movers: Clip) -> None:
    assert otsu_mask(two_movers, bar_settings(segment__point_px=[200, 135]))[:100].sum() == 0


@pytest.mark.parametrize("mask", [motion_mask, otsu_mask])
def test_a_click_chooses_what_the_same_point_of_the_settings_chooses(two_movers: Clip, mask: Callable[..., np.ndarray]) -> None:
    clicked = mask(two_movers, bar_settings(), Mark(point=np.array([200.0, 135.0])))
    assert np.array_equal(clicked, mask(two_movers, bar_settings(segment__point_px=[200, 135])))


@pytest.fixture(scope="module")
def still_root() -> Clip:
    """The bar's first part, of another colour than the rest, stands still: the rest turns about its end."""
    hinge = np.array([0.1, 0, 0])
    rest, frames, depths = Box(np.array([0.1, -0.025, -0.03]), np.array([0.24, 0.025, 0.03]), (0.1,)), [], []
    root = box_clip(Box(np.array([0.0, -0.025, -0.03]), np.array([0.1, 0.025, 0.03])), [np.eye(4)], oblique_camera(), mount=MOUNT)
    for k in range(9):
        pose = turned(0.12 * np.sin(0.9 * k))
        pose[:3, 3] = hinge - pose[:3, :3] @ hinge
        view = box_clip(rest, [pose], oblique_camera())
        nearer = (view.labels[0] > 0) & (view.depth[0] <= root.depth[0] + 1e-3)
        frames.append(np.where(nearer[..., None], view.frames[0], root.frames[0]))
        depths.append(np.where(nearer, view.depth[0], root.depth[0]))
        if k == 0:
            label = nearer | (root.labels[0] > 0)
    return replace(root, frames=np.stack(frames), depth=np.stack(depths), labels=np.repeat(label[None].astype(np.uint8), 9, 0))


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_motion_with_depth_reaches_a_still_root_of_another_colour(still_root: Clip) -> None:
    true = still_root.labels[0] > 0
    assert overlap(motion_mask(still_root, bar_settings()) > 0, true) > 0.93
    without = overlap(motion_mask(replace(still_root, depth=None), bar_settings()) > 0, true)
    assert without < 0.8  # colour alone cannot know that the still piece belongs to the object


def test_the_mask_ends_at_the_clamped_face_although_the_mount_goes_on(still_root: Clip) -> None:
    """The mount painted as the root: colour and depth both go on into it."""
    painted = still_root.frames.copy()
    mount = (still_root.depth[0] < 0.55) & (still_root.labels[0] == 0)
    painted[:, mount] = (painted[:, mount] * 0.4 + np.array([130, 40, 30]) * 0.6).astype(np.uint8)
    mask = motion_mask(replace(still_root, frames=painted), bar_settings()) > 0
    assert (mask & mount).sum() < 0.25 * mount.sum()


@pytest.mark.parametrize("name", ["beam_gust", "beam_two_part", "plant_poke"])
def test_motion_alone_finds_the_object_of_a_truth_scene(name: str, scenes: Path) -> None:
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.config import layered

    settings = layered([scenes / name / "given.yaml"], {"scene.first_mask": None})
    clip = read_clip(scenes / name / "clip.mcap", settings)
    with np.load(scenes / name / "truth.npz") as truth:
        shape = truth["mask_shape"]
        true = np.unpackbits(truth["mask"])[: int(np.prod(shape))].reshape(shape)[0].astype(bool)
    assert overlap(motion_mask(clip, settings) > 0, true) > 0.97
