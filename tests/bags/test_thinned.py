"""A clip of many frames is used whole, or thinned by choice with its times right, or refused; never cut in silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags import assemble
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.thinned import chosen
from diffphys_ros.config import FrameSettings
from diffphys_ros.errors import InputError

from .conftest import PERIOD_NS, START_NS, colour_topic, depth_topic, info_topic, picture

HIGH_FPS = 239.76  # Hz, what phones state for 240
SETTINGS = config.build({"camera.fov_deg": 60.0})


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 frames, each of its own brightness."""
    path = tmp_path_factory.mktemp("slow") / "slow.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), HIGH_FPS, (64, 48))
    for k in range(24):
        writer.write(np.full((48, 64, 3), 10 * k, np.uint8))
    writer.release()
    return path


def brightness(path: Path, **frames: int) -> tuple[np.ndarray, float, tuple[str, ...]]:
    clip = read_clip(path, SETTINGS, frames=FrameSettings(**frames))
    return np.rint(clip.frames[:, 24, 32, 0] / 10), clip.period_s, clip.notes


def test_a_clip_of_240_frames_a_second_is_used_whole(video: Path) -> None:
    level, period_s, notes = brightness(video)
    assert level.tolist() == list(range(24))
    assert period_s == pytest.approx(1 / HIGH_FPS, rel=1e-6)
    assert not any("every" in note for note in notes)


def test_a_thinned_clip_has_the_times_of_the_frames_that_were_taken_and_says_so(video: Path) -> None:
    level, period_s, notes = brightness(video, every=5)
    assert level.tolist() == [0, 5, 10, 15, 20]
    assert period_s == pytest.approx(5 / HIGH_FPS, rel=1e-6)
    assert "every 5. frame was taken (frames.every): 5 of 24" in notes
    assert not any("cut off" in note for note in notes)


def test_frames_that_are_neither_fitted_nor_predicted_are_said(video: Path) -> None:
    level, _, notes = brightness(video, every=2, fit=6, predict=2)
    assert level.tolist() == [0, 2, 4, 6, 8, 10]
    assert "the first 6 of 12 frames are fitted (frames.fit), the last 4 are left out" in notes


def test_a_folder_of_pictures_is_thinned_alike(tmp_path: Path) -> None:
    for k in range(7):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k)[..., ::-1])
    clip = read_clip(tmp_path, config.build({"camera.fps": 60.0}), frames=FrameSettings(every=3))
    assert np.array_equal(clip.frames, [picture(0), picture(3), picture(6)])
    assert clip.period_s == pytest.approx(3 / 60)


def test_a_recording_is_thinned_by_its_clock_with_the_depth_of_the_same_moments(record: Callable[..., Path]) -> None:
    clip = read_clip(record(colour_topic(frames=9), depth_topic(frames=9), info_topic()), config.build({}), frames=FrameSettings(every=4))
    assert np.array_equal(clip.frames, [picture(0), picture(4), picture(8)])
    assert clip.depth is not None
    assert clip.depth[:, 0, 0] == pytest.approx([0.5, 0.504, 0.508])
    assert clip.period_s == pytest.approx(4 * PERIOD_NS * 1e-9, rel=1e-6)


def test_lost_frames_shift_no_later_one() -> None:
    stamps = [START_NS + k * PERIOD_NS for k in range(20) if k not in (3, 4, 9)]
    assert [(stamps[i] - START_NS) // PERIOD_NS for i in chosen(stamps, 4, "clip")] == [0, 8, 12, 16]
    assert [(stamps[::-1][i] - START_NS) // PERIOD_NS for i in chosen(stamps[::-1], 4, "clip")] == [16, 12, 8, 0]


def test_a_clip_too_long_is_refused_with_the_cure_and_read_once_thinned(video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assemble, "MOST_FRAMES", 20)
    with pytest.raises(InputError, match=r"has more than 20 frames; take fewer with frames.every, or cut out the seconds"):
        read_clip(video, SETTINGS)
    assert len(read_clip(video, SETTINGS, frames=FrameSettings(every=2))) == 12
