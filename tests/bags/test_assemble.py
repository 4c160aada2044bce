"""The uniform clock and the pairing of depth with colour."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.bags.assemble import MOST_PIXELS, Bounded, assemble
from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.config import FrameSettings
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

CAMERA = camera_from_fov(60.0, 4, 3)
START, PERIOD = 1_700_000_000_123_456_789, 0.04


def stamps(count: int, jitter_s: float = 0.0) -> list[int]:
    jitter = np.random.default_rng(1).normal(0, jitter_s, count)
    return [START + round(1e9 * (k * PERIOD + jitter[k])) for k in range(count)]


def frame(k: int) -> np.ndarray:
    return np.full((3, 4, 3), k, np.uint8)


def metres(k: int) -> np.ndarray:
    return np.full((3, 4), 1 + k, np.float32)


def clip(times: list[int], depths: list[tuple[int, np.ndarray]] | None = None) -> Clip:
    return assemble([(ns, frame(k)) for k, ns in enumerate(times)], depths or [], CAMERA, "test")


def shown(result: Clip) -> list[int]:
    return result.frames[:, 0, 0, 0].tolist()


def test_even_stamps_give_their_period_and_every_frame() -> None:
    result = clip(stamps(10))
    assert result.period_s == pytest.approx(PERIOD, rel=1e-9)
    assert (result.start_ns, shown(result), result.notes) == (START, list(range(10)), ())
    assert result.seen.all()


def test_jitter_of_a_tenth_of_the_period_moves_no_frame() -> None:
    result = clip(stamps(60, 0.1 * PERIOD))
    assert shown(result) == list(range(60))
    assert result.period_s == pytest.approx(PERIOD, rel=2e-3)


def test_a_lost_frame_repeats_the_one_before_unobserved_and_is_said() -> None:
    times = stamps(12, 0.05 * PERIOD)
    kept = [k for k in range(12) if k not in (4, 5, 9)]
    result = assemble([(times[k], frame(k)) for k in kept], [], CAMERA, "test")
    assert shown(result) == [0, 1, 2, 3, 3, 3, 6, 7, 8, 8, 10, 11]
    assert np.flatnonzero(~result.seen).tolist() == [4, 5, 9]
    assert "3 of 12 frames were lost" in result.notes[0]


def test_frames_that_are_kept_back_are_cut_off_by_the_clock_and_not_looked_at() -> None:
    times = stamps(12)
    kept = [k for k in range(12) if k not in (4, 7)]
    black = [(times[k], frame(k) if k < 8 else frame(0)) for k in kept]
    depths = [(times[k], metres(k)) for k in kept]
    for frames in (FrameSettings(fit=8), FrameSettings(predict=4), FrameSettings(fit=8, predict=3)):
        result = assemble(black, depths, CAMERA, "test", frames=frames)
        assert shown(result) == [0, 1, 2, 3, 3, 5, 6]  # the last slot is lost, and ends the clip
        assert result.depth is not None
        assert len(result.depth) == len(result) == 7
        assert result.period_s == pytest.approx(PERIOD)


def test_the_order_of_arrival_does_not_matter() -> None:
    images = [(ns, frame(k)) for k, ns in enumerate(stamps(9))]
    depths = [(ns, metres(k)) for k, ns in enumerate(stamps(9))]
    one, other = assemble(images, depths, CAMERA, "test"), assemble(images[::-1], depths[::-1], CAMERA, "test")
    np.testing.assert_array_equal(one.frames, other.frames)
    np.testing.assert_array_equal(one.depth, other.depth)


def test_each_frame_takes_the_nearest_depth_within_half_a_period() -> None:
    times = stamps(6)
    late = round(0.3 * PERIOD * 1e9)
    depths = [(times[k] + late, metres(k)) for k in range(6) if k != 2]
    result = clip(times, depths)
    assert result.depth is not None
    assert result.depth[:, 0, 0].tolist() == [1, 2, 0, 4, 5, 6]
    assert "1 of 6 frames have no depth image" in result.notes[0]


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_frames_are_refused(count: int) -> None:
    with pytest.raises(InputError, match=rf"test: has {count} colour frame\(s\), at least 2"):
        clip(stamps(count))


@pytest.mark.parametrize("seed", range(5))
def test_lost_frames_and_jitter_together_do_not_bias_the_period(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kept = np.flatnonzero(rng.random(40) > 0.2) if seed else np.arange(0, 40)
    kept = np.union1d([0], kept)
    times = [START + round(1e9 * PERIOD * (k + rng.normal(0, 0.12))) for k in kept]
    result = assemble([(ns, frame(int(k))) for ns, k in zip(times, kept, strict=True)], [], CAMERA, "test")
    assert result.period_s == pytest.approx(PERIOD, rel=0.01)
    assert np.flatnonzero(result.seen).tolist() == kept.tolist()


def test_equal_stamps_are_refused() -> None:
    with pytest.raises(InputError, match="they must grow"):
        clip([START] * 5)


def test_two_takes_in_one_recording_are_refused() -> None:
    with pytest.raises(InputError, match="follow no steady clock"):
        clip(stamps(5) + [ns + 10**12 for ns in stamps(5)])


def test_depth_without_a_single_value_is_refused() -> None:
    times = stamps(4)
    with pytest.raises(InputError, match=r"no finite value above 0; set topics.depth to 'none'"):
        clip(times, [(ns, np.zeros((3, 4), np.float32)) for ns in times])


def test_depth_of_another_size_than_the_colour_is_refused() -> None:
    times = stamps(4)
    with pytest.raises(InputError, match="depth image has 8x6 px, must have the camera's 4x3 px"):
        clip(times, [(ns, np.ones((6, 8), np.float32)) for ns in times])


def test_a_clip_of_more_pixels_than_can_be_worked_on_is_refused_before_it_is_stacked() -> None:
    camera = camera_from_fov(60.0, 3840, 2160)
    picture = np.zeros((2160, 3840, 3), np.uint8)  # one for all: only the sum counts
    with pytest.raises(InputError, match=r"its first 4000 frames have 33177600000 pixels together, at most 400000000 are taken .*cut out"):
        assemble([(START + k * 10**7, picture) for k in range(4000)], [], camera, "test")


def test_reading_ends_at_the_first_frame_that_is_too_many() -> None:
    images, picture = Bounded("test"), np.zeros((2160, 3840, 3), np.uint8)
    for k in range(MOST_PIXELS // (2160 * 3840)):
        images.add(k, picture)
    with pytest.raises(InputError, match=r"frames have \d+ pixels together"):
        images.add(0, picture)


def test_more_frames_than_can_be_worked_on_are_refused() -> None:
    with pytest.raises(InputError, match=r"has more than 5000 frames"):
        assemble([(ns, frame(0)) for ns in stamps(5001)], [], CAMERA, "test")


@pytest.mark.parametrize("stamp", [2**63, -(2**63), 10**19, 2**64 - 1])
def test_a_stamp_that_is_no_time_is_refused(stamp: int) -> None:
    with pytest.raises(InputError, match=r"carries the stamp .* s, must be within"):
        clip([*stamps(3), stamp])


@pytest.mark.parametrize("step", [10**18, 1])
def test_frames_ages_or_nothing_apart_are_refused(step: int) -> None:
    with pytest.raises(InputError, match=r"frames are .* s apart, must be between 1e-06 and 100 s"):
        clip([k * step for k in range(4)])


def test_stamps_before_1970_and_backwards_make_the_same_clock() -> None:
    times = [-(10**17) + 40_000_000 * k for k in range(6)]
    result = clip(times[::-1])
    assert result.start_ns == times[0]
    assert result.period_s == pytest.approx(0.04)
    assert shown(result) == [5, 4, 3, 2, 1, 0]


@pytest.mark.parametrize("size", [(1, 20_000), (20_000, 1)])
def test_an_image_too_long_to_work_on_is_refused(size: tuple[int, int]) -> None:
    camera = camera_from_fov(60.0, size[1], size[0])
    with pytest.raises(InputError, match=r"may have 16384 px a side"):
        assemble([(ns, np.zeros((*size, 3), np.uint8)) for ns in stamps(3)], [], camera, "test")
