"""Where nobody tells a clamp and the object stays within the picture, it is held where it meets what is still, and nowhere where nothing of it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.body.still_end import still_end
from diffphys_ros.outline import covered
from diffphys_ros.types import Clip
from tests.boxes import turned
from tests.plain_strips import Strip

HELD = Strip(frames=60, fps=60.0, length_px=100.0, behind_px=-20.0)  # from 20 px below the picture's upper edge


def labelled(strip: Strip, *, shift_px: float = 0.0) -> Clip:
    """The strip's clip with its true labels; all of it moves aside by that much, to and fro."""
    outlines = (strip.outline(sway) + np.array([shift_px * np.sin(k), 0.0]) for k, sway in enumerate(strip.sway()))
    return strip.clip().with_labels(np.stack([covered(outline, strip.size) > 0.5 for outline in outlines]).astype(np.uint8))


@pytest.mark.parametrize("tip_px", [8.0, 20.0])
def test_a_strip_is_held_across_its_still_end_and_not_at_the_middle_of_its_free_one(tip_px: float) -> None:
    line = np.reshape(still_end(labelled(replace(HELD, tip_px=tip_px))), (2, 2))
    assert line[:, 1] == pytest.approx([20.0, 20.0], abs=1.5)
    assert np.sort(line[:, 0]) == pytest.approx([47.0, 63.0], abs=2.0)


@pytest.mark.parametrize("degrees", [-130.0, 20.0, 70.0])
def test_the_line_is_that_of_the_end_however_the_camera_is_held(degrees: float) -> None:
    turn = turned(np.deg2rad(degrees), axis=2)[:2, :2]
    upright = replace(HELD, size=(150, 150), middle_px=75.0)
    labels = np.stack([covered((upright.outline(sway) - 75) @ turn.T + 75, upright.size) > 0.5 for sway in upright.sway()])
    line = np.reshape(still_end(upright.clip().with_labels(labels.astype(np.uint8))), (2, 2))
    end = (np.array([[67.0, 20.0], [83.0, 20.0]]) - 75) @ turn.T + 75
    across = (line[1] - line[0]) @ (end[1] - end[0]) / np.linalg.norm(line[1] - line[0]) / np.linalg.norm(end[1] - end[0])
    assert abs(across) > np.cos(np.deg2rad(6.0))
    assert np.linalg.norm(line.mean(0) - end.mean(0)) < 2.0


def test_what_moves_as_a_whole_or_hardly_at_all_is_held_nowhere() -> None:
    assert still_end(labelled(HELD, shift_px=4.0)) is None
    assert still_end(labelled(replace(HELD, tip_px=1.0))) is None


def test_what_is_held_at_both_ends_has_no_one_clamp() -> None:
    along, half = np.linspace(0, np.pi, 60), np.array([0.0, 7.0])
    bent = [np.stack([10 + 90 * along / np.pi, 70 + 12 * np.cos(0.5 * k) * np.sin(along) ** 2], 1) for k in range(12)]
    labels = np.stack([covered(np.concatenate([centre - half, (centre + half)[::-1]]), (140, 110)) > 0.5 for centre in bent])
    clip = HELD.clip().part(0, 12)
    assert still_end(replace(clip, frames=np.zeros((12, 140, 110, 3), np.uint8)).with_labels(labels.astype(np.uint8))) is None
