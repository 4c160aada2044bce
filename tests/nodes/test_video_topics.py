"""Claims about a video as the topics of a camera."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording
from diffphys_ros.errors import InputError
from diffphys_ros.nodes.video_topics import topics_of_video
from tests.bags.conftest import picture


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Without loss, 240 frames a second."""
    path = tmp_path / "film.avi"
    written = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), 240.0, picture(0).shape[1::-1])
    for k in range(5):
        written.write(np.ascontiguousarray(picture(k)[..., ::-1]))
    written.release()
    return path


def test_a_video_as_topics_is_the_clip_that_its_file_is(video: Path) -> None:
    settings = config.build({"camera.fov_deg": 60.0})
    recorded = read_clip(write_recording(video.with_suffix(".mcap"), topics_of_video(video)), settings)
    filmed = read_clip(video, settings)
    np.testing.assert_array_equal(recorded.frames, filmed.frames)
    assert recorded.period_s == pytest.approx(filmed.period_s, rel=1e-6)
    np.testing.assert_array_equal(recorded.camera.pixel_from_camera, filmed.camera.pixel_from_camera)


def test_its_camera_is_one_that_nobody_calibrated(video: Path) -> None:
    recording = write_recording(video.with_suffix(".mcap"), topics_of_video(video))
    with pytest.raises(InputError, match=r"focal length K\[0\] = 0, must be above 0; calibrate the camera or set camera.fov_deg"):
        read_clip(recording, config.build({}))


def test_what_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(b"\0no film")
    with pytest.raises(InputError, match="holds no video that can be decoded"):
        next(topics_of_video(tmp_path / "film.mp4"))
