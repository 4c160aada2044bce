"""What all of an outline moves by is told from its bending, without anything of the scene around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.outline import Sway, follow_outline, sway_of
from diffphys_ros.outline.follow import LEAST_SD_PX
from diffphys_ros.types import Clip
from tests.plain_strips import Strip

STRIP = Strip(frames=90, noise=1.0, size=(156, 110), turn=np.pi / 2)  # at rest in frame 0
TIMES_S = np.arange(STRIP.frames)[:, None] / STRIP.fps
HAND = np.array([2.0, 1.2]) * np.sin(2 * np.pi * np.array([0.9, 1.3]) * TIMES_S)


def labelled(shift: np.ndarray | float, strip: Strip = STRIP) -> Clip:
    clip = strip.clip(shift)
    return clip.with_labels((clip.frames[..., 0] > sum(strip.grey) / 2).astype(np.uint8))


def seen(clip: Clip) -> Sway:
    found = sway_of(clip, follow_outline(clip, np.where(clip.labels[0] > 0, 1.0, 0.0).astype(np.float32)))
    assert found is not None
    return found


def off_px(found: Sway, shift: np.ndarray) -> np.ndarray:
    """What a shift is off by, beside a constant, root mean square, across and along the strip (2,)."""
    return np.std(found.shift_px - shift, axis=0)


@pytest.mark.parametrize("turned", [False, True])
def test_the_motion_of_a_hand_is_found_to_a_twentieth_of_a_pixel_whichever_way_the_strip_points(turned: bool) -> None:
    clip, shift = labelled(HAND), HAND
    if turned:
        clip, shift = replace(clip, frames=clip.frames.swapaxes(1, 2), labels=clip.labels.swapaxes(1, 2)), HAND[:, ::-1]
        clip = replace(clip, camera=replace(clip.camera, width=clip.camera.height, height=clip.camera.width))
    found = seen(clip)
    assert off_px(found, shift).max() < LEAST_SD_PX
    assert found.size_px == pytest.approx(np.linalg.norm(HAND, axis=1).max(), abs=0.15)
    assert found.along_sd_px == 0


def test_a_frame_that_shows_something_else_moves_no_other() -> None:
    jumped = HAND.copy()
    jumped[40] += np.array([9.0, 0.0])
    found = seen(labelled(jumped))
    assert np.abs((found.shift_px - HAND - np.mean(found.shift_px - HAND, axis=0))[np.arange(90) != 40]).max() < 0.2


def test_a_camera_on_a_tripod_has_no_motion() -> None:
    found = seen(labelled(0.0))
    assert found.size_px == 0
    assert not found.shift_px.any()


def test_how_far_a_hand_went_along_an_object_whose_end_is_not_seen_is_not_known() -> None:
    clip = labelled(HAND, replace(STRIP, size=(126, 110)))
    found = seen(clip)
    assert off_px(found, HAND)[0] < 2 * LEAST_SD_PX
    assert np.abs(found.shift_px[:, 1]).max() < 0.01
    assert found.along_sd_px > 1.0


def test_the_frame_nearest_to_rest_is_found_though_a_hand_hides_it() -> None:
    clip = labelled(HAND)
    assert [seen(clip.part(first, 90)).to_rest for first in (2, 10)] == [-2, 2]
