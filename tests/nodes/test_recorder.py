"""Claims about when a clip begins and ends on a camera that does not stop."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from diffphys_ros.bags.thumbnail import thumbnail
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import messages
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.intake import Intake
from diffphys_ros.nodes.motion import LEAST_REST, LEAST_TAIL, Watch
from diffphys_ros.nodes.recorder import ALWAYS, MANUAL, MOTION, PAUSE, Recorder

HZ, MIB = 30, 2**20
HEIGHT, WIDTH = 48, 64
START_NS = 1_700_000_000_000_000_000
NOISE = np.random.default_rng(0).normal(0, 2, (16, HEIGHT, WIDTH))
BACKGROUND = np.random.default_rng(1).uniform(40, 200, (HEIGHT, WIDTH))


def picture(k: int, offset_px: float) -> np.ndarray:
    """A noisy image (H, W, 3) with a bright block at an offset from its place."""
    grey = BACKGROUND + NOISE[k % len(NOISE)]
    left = 26 + round(offset_px)
    grey[18:30, left : left + 12] = 240
    return np.clip(grey, 0, 255).astype(np.uint8)[..., None].repeat(3, 2)


def swing(k: int, push: int) -> float:
    """Pushed at frame `push`, then a decaying swing of 3 Hz [px]."""
    t = (k - push) / HZ
    return 0.0 if t < 0 else 8 * np.exp(-2 * t) * np.sin(2 * np.pi * 3 * t)


class Camera:
    """Feeds a recorder, and keeps what it closes and says."""

    def __init__(self, trigger: str, seconds: float = 2.0, max_bytes: int = 64 * MIB, max_frames: int = 1200) -> None:
        self.clips, self.faults, self.k = [], [], 0
        self.recorder = Recorder(Intake(max_frames, max_bytes), trigger, seconds, lambda clip, why: self.clips.append((clip, why)), self.faults.append)

    def film(self, frames: int, push: int | None = None) -> None:
        """More images; `push`: after how many of them."""
        began = self.k
        for self.k in range(began, began + frames):
            offset = 0.0 if push is None else swing(self.k, began + push)
            self.take(picture(self.k, offset), self.k)
        self.k += 1

    def take(self, pixels: np.ndarray, k: int) -> None:
        head = messages.header(START_NS + round(k / HZ * 1e9), "camera")
        self.recorder.take("image", to_ros("sensor_msgs/msg/Image", messages.image(head, pixels, "rgb8")))

    def numbers(self, clip: int = -1) -> list[int]:
        """Which images a clip has."""
        return [round((image.stamp - START_NS) * 1e-9 * HZ) for image in self.clips[clip][0].images]


def test_an_endless_camera_is_kept_as_a_ring_of_so_many_seconds() -> None:
    camera = Camera(MANUAL)
    camera.film(300)
    assert camera.recorder.health()["ring_s"] == pytest.approx(2.0, abs=0.05)
    assert camera.clips == []


def test_a_ring_of_large_images_is_bounded_in_bytes_with_its_depth() -> None:
    camera, bound = Camera(MANUAL, seconds=100.0, max_bytes=MIB), MIB
    for k in range(300):
        head = messages.header(START_NS + round(k / HZ * 1e9), "camera")
        camera.recorder.intake.take_depth(to_ros("sensor_msgs/msg/Image", messages.image(head, np.ones((HEIGHT, WIDTH), np.float32), "32FC1")))
        camera.take(picture(k, 0), k)
        assert camera.recorder.intake.bytes <= bound
    assert len(camera.recorder.intake.images) > 30
    assert abs(len(camera.recorder.intake.images) - len(camera.recorder.intake.depths)) <= HZ


def test_by_hand_a_clip_lasts_from_record_to_end() -> None:
    camera = Camera(MANUAL, seconds=5.0)
    camera.film(40)
    camera.recorder.record()
    camera.film(60, push=10)
    assert camera.recorder.end("~/end was called")
    assert camera.numbers() == list(range(40, 100))
    assert camera.faults == []
    camera.film(10)
    assert len(camera.recorder.intake.images) == 10  # it listens on


def test_end_without_record_takes_what_happened_just_now() -> None:
    camera = Camera(MANUAL)
    camera.film(100, push=70)
    assert camera.recorder.end("~/end was called")
    assert camera.numbers()[-1] == 99
    assert len(camera.numbers()) == pytest.approx(2 * HZ, abs=2)


def test_a_clip_by_hand_that_nobody_ends_is_as_long_as_the_ring() -> None:
    camera = Camera(MANUAL)
    camera.recorder.record()
    camera.film(200)
    assert [len(clip.images) for clip, _ in camera.clips] == [2 * HZ + 1]
    assert "clip.seconds" in camera.clips[0][1]


def test_motion_opens_a_clip_with_the_rest_before_it_and_stillness_ends_it() -> None:
    camera = Camera(MOTION, seconds=6.0)
    for push in (60, 90):
        camera.film(240, push=push)
    assert len(camera.clips) == 2
    for clip, push in ((0, 60), (1, 240 + 90)):
        assert camera.numbers(clip)[0] == pytest.approx(push - HZ, abs=4)
        assert camera.numbers(clip)[-1] > push + 40
    assert camera.faults == []


def test_noise_and_exposure_alone_open_no_clip() -> None:
    camera = Camera(MOTION)
    for k in range(90):
        camera.take(np.clip(picture(k, 0).astype(float) * (1 + 0.05 * np.sin(k)), 0, 255).astype(np.uint8), k)
    assert not camera.recorder.recording


def test_too_little_rest_is_said_at_once() -> None:
    camera = Camera(MANUAL, seconds=5.0)
    camera.recorder.record()
    camera.film(LEAST_REST + 3, push=0)
    assert len(camera.faults) == 1
    assert "of rest" in camera.faults[0]
    assert camera.recorder.health()["clip_warning"] == camera.faults[0]


def test_too_short_a_free_tail_is_in_the_diagnostics_while_it_is_recorded_and_said_at_the_end() -> None:
    camera = Camera(MANUAL, seconds=5.0)
    camera.recorder.record()
    camera.film(16, push=10)
    assert "free swing" in camera.recorder.health()["clip_warning"]
    assert camera.faults == []
    assert camera.recorder.end("~/end was called")
    assert "free swing" in camera.faults[0]


def test_a_long_enough_tail_is_no_fault_any_more() -> None:
    camera = Camera(MANUAL, seconds=5.0)
    camera.recorder.record()
    camera.film(10 + LEAST_TAIL + 12, push=10)
    assert camera.recorder.health()["clip_warning"] == ""


def test_a_recording_played_once_is_a_clip_from_its_first_image_to_the_silence() -> None:
    camera = Camera(ALWAYS)
    for clip in range(2):
        camera.film(100)  # longer than the ring
        camera.recorder.silence()
        assert len(camera.clips) == clip + 1
        assert len(camera.numbers()) == 100
        assert camera.clips[-1][1] == PAUSE


def test_what_follows_a_clip_that_was_full_is_no_clip_before_a_pause() -> None:
    camera = Camera(ALWAYS, max_frames=50)
    camera.film(500)
    assert [len(clip.images) for clip, _ in camera.clips] == [50]
    assert "max_frames" in camera.clips[0][1]
    camera.recorder.silence()
    camera.film(10)
    assert camera.recorder.recording


def test_stamps_that_jump_back_end_the_clip_and_what_comes_then_is_not_mixed_with_it() -> None:
    camera = Camera(ALWAYS)
    camera.film(60)
    camera.k = 0
    camera.film(20)
    assert [len(clip.images) for clip, _ in camera.clips] == [60]
    assert len(camera.recorder.intake.images) == 20


def test_a_late_image_finds_its_place_and_one_that_came_twice_is_refused() -> None:
    camera = Camera(ALWAYS)
    for k in (0, 1, 3, 2, 4):
        camera.take(picture(k, 0), k)
    with pytest.raises(InputError, match="came twice or late"):
        camera.take(picture(3, 0), 3)
    assert camera.recorder.end("")
    assert camera.numbers() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("encoding", ["rgb8", "mono8", "jpeg"])
def test_a_thumbnail_shows_what_the_image_shows(encoding) -> None:
    pixels = picture(0, 0).repeat(10, 0).repeat(10, 1)
    if encoding == "jpeg":
        message = SimpleNamespace(format="jpeg", data=cv2.imencode(".jpg", pixels)[1].tobytes())
    else:
        plain = messages.image(messages.header(1), pixels if encoding == "rgb8" else pixels[..., 0], encoding)
        message = to_ros("sensor_msgs/msg/Image", plain)
    small = thumbnail(message)
    assert small.shape == (60, 80)
    expected = cv2.resize(pixels[..., 1], (80, 60), interpolation=cv2.INTER_AREA)
    assert np.abs(small - expected).mean() < 4


def test_a_compressed_image_that_is_broken_is_no_motion() -> None:
    watch = Watch()
    assert thumbnail(SimpleNamespace(format="jpeg", data=b"\xff\xd8\xff no picture")) is None
    watch.look(1, None)
    assert not watch.moving
