"""A recording's mask topic says what the object in frame 0 is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.errors import InputError
from diffphys_ros.segment.given import given_mask

from .conftest import HEIGHT, PERIOD_NS, START_NS, WIDTH, Message, colour_topic, image, info_topic

TOPIC = "/segmenter/mask"


def labels(k: int) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[3:8, 2 + k : 9 + k] = 1
    mask[3:8, 9 + k :] = 255
    return mask


def mask_topic(frames: range = range(6)) -> Iterator[Message]:
    for k in frames:
        ns = START_NS + k * PERIOD_NS
        yield TOPIC, "sensor_msgs/msg/Image", ns, image(ns, labels(k), "mono8"), False


def settings(**values: object) -> config.Settings:
    return config.build({f"topics.{name}": value for name, value in values.items()})


def test_the_mask_nearest_to_the_first_frame_is_kept_with_its_ignored_pixels(record: Callable[..., Path]) -> None:
    clip = read_clip(record(mask_topic(), colour_topic(), info_topic()), settings(mask=TOPIC))
    assert len(clip) == 6
    np.testing.assert_array_equal(clip.first_labels, labels(0))
    np.testing.assert_array_equal(given_mask(clip, settings()), labels(0))


def test_a_recording_without_a_named_mask_topic_has_no_first_labels(record: Callable[..., Path]) -> None:
    assert read_clip(record(colour_topic(), info_topic()), settings()).first_labels is None


def test_a_mask_topic_that_is_not_there_is_refused(record: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match=r"topics\.mask is '/no/mask', must be one of"):
        read_clip(record(colour_topic(), info_topic()), settings(mask="/no/mask"))


def test_a_mask_that_names_a_png_as_well_yields_to_it(record: Callable[..., Path], tmp_path: Path) -> None:
    import cv2

    png = np.zeros((HEIGHT, WIDTH), np.uint8)
    png[1, 1] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), png)
    clip = read_clip(record(mask_topic(), colour_topic(), info_topic()), settings(mask=TOPIC))
    assert given_mask(clip, config.build({"scene.first_mask": str(tmp_path / "mask.png")})).sum() == 1
