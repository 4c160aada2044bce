"""What passes between camera and object is ignored, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.segment.propagate import propagate
from tests.boxes import bar, box_clip, oblique_camera, turned
from tests.segment.occluded import BOARD, Occluded, arm_across_a_bar, first_labels, ignored


@pytest.fixture(scope="module")
def scene() -> Occluded:
    return arm_across_a_bar()


@pytest.fixture(scope="module", params=["depth and colour", "colour alone"])
def labels(scene: Occluded, request) -> np.ndarray:
    depth = scene.clip.depth if request.param == "depth and colour" else None
    return propagate(scene.clip.frames, scene.clip.seen, first_labels(scene), depth)


def test_the_arm_really_crosses_the_object(scene: Occluded) -> None:
    share = scene.hidden.sum((1, 2)) / scene.object[0].sum()
    assert share.max() > 0.12
    assert share[0] == share[-1] == 0


def test_an_arm_before_the_object_is_ignored(scene: Occluded, labels: np.ndarray) -> None:
    """Counted over the pixels of all frames: the object's label on the arm would pull the fit towards the arm's pixels."""
    object_on_arm = ((labels > 0) & ~ignored(labels) & scene.hidden).sum() / scene.hidden.sum()
    assert object_on_arm < 0.02
    assert (ignored(labels) & scene.hidden).sum() / scene.hidden.sum() > 0.95


def test_what_is_seen_of_the_object_keeps_its_label(scene: Occluded, labels: np.ndarray) -> None:
    for found, true in zip(labels, scene.object, strict=True):
        counted = (found > 0) & ~ignored(found)
        assert (counted & true).sum() / (counted | true).sum() > 0.9
    assert (ignored(labels) & scene.object).sum() / scene.object.sum() < 0.03


def test_the_object_is_found_again_after_the_arm(scene: Occluded, labels: np.ndarray) -> None:
    counted = (labels[-1] > 0) & ~ignored(labels[-1])
    assert (counted & scene.object[-1]).sum() / (counted | scene.object[-1]).sum() > 0.97


@pytest.mark.slow
def test_an_object_that_is_hidden_as_a_whole_is_ignored_and_found_again() -> None:
    scene = arm_across_a_bar(BOARD, reach=0.5)
    share = scene.hidden.sum((1, 2)) / (scene.hidden | scene.object).sum((1, 2))
    assert share.max() > 0.98
    labels = propagate(scene.clip.frames, scene.clip.seen, first_labels(scene), scene.clip.depth)
    counted = (labels > 0) & ~ignored(labels)
    assert (counted & scene.hidden).sum() / scene.hidden.sum() < 0.02
    assert (counted[-1] & scene.object[-1]).sum() / (counted[-1] | scene.object[-1]).sum() > 0.97


@pytest.mark.parametrize("with_depth", [True, False])
def test_an_object_that_nothing_hides_has_no_ignored_pixel(with_depth: bool) -> None:
    """It swings, comes 6 % nearer to the camera on the way, and turns a face into view."""
    clip = box_clip(bar(cuts=(0.08,)), [turned(0.15 * np.sin(0.8 * k), axis=2) for k in range(9)], oblique_camera())
    labels = propagate(clip.frames, clip.seen, clip.labels[0], clip.depth if with_depth else None)
    assert not ignored(labels).any()


def test_holes_of_the_depth_image_do_not_hide_the_object(scene: Occluded) -> None:
    clip = box_clip(bar(), [turned(0.1 * np.sin(0.8 * k)) for k in range(6)], oblique_camera())
    holed = clip.depth.copy()
    holed[:, 40:100:3] = 0
    assert not ignored(propagate(clip.frames, clip.seen, clip.labels[0], holed)).any()


def test_an_arm_that_is_given_in_frame_0_is_followed(scene: Occluded) -> None:
    """The clip begun while the arm is there: 255 in the given labels moves with the arm and never becomes the object."""
    part = slice(6, 10)
    clip = replace(scene.clip, frames=scene.clip.frames[part])
    given = np.where(scene.hidden[6], 255, scene.object[6]).astype(np.uint8)
    labels = propagate(clip.frames, clip.seen, given, scene.clip.depth[part])
    hidden = scene.hidden[part]
    assert ((labels == 1) & hidden).sum() / hidden.sum() < 0.06
