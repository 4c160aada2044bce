"""Claims about a clip on its way over topics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.types import Clip


def sent(buffer: ClipBuffer, plain) -> None:
    for name, fields in plain:
        buffer.take(name, to_ros(TOPICS[name].type_name, fields))


def over_topics(clip: Clip, stamps: np.ndarray | None = None) -> ClipBuffer:
    buffer, stamps = ClipBuffer(), slot_stamps(clip) if stamps is None else stamps
    sent(buffer, clip_messages(clip, stamps))
    if clip.labels is not None:
        sent(buffer, mask_messages(clip, stamps))
    return buffer


def assert_same(a: Clip, b: Clip) -> None:
    np.testing.assert_array_equal(a.frames, b.frames)
    np.testing.assert_array_equal(a.seen, b.seen)
    assert (a.depth is None) == (b.depth is None)
    if a.depth is not None:
        np.testing.assert_array_equal(a.depth, b.depth)
    assert (a.gravity is None) == (b.gravity is None)
    if a.gravity is not None:
        np.testing.assert_array_equal(a.gravity, b.gravity)
    np.testing.assert_array_equal(a.camera.pixel_from_camera, b.camera.pixel_from_camera)
    np.testing.assert_allclose(a.camera.world_from_camera, b.camera.world_from_camera, atol=1e-12)
    assert (a.camera.frame_id, a.camera.world_frame_id, a.start_ns) == (b.camera.frame_id, b.camera.world_frame_id, b.start_ns)
    assert a.period_s == pytest.approx(b.period_s, rel=1e-9)


@pytest.fixture
def deep_clip(made_clip) -> Clip:
    depth = np.random.default_rng(0).uniform(0.3, 0.7, made_clip.frames.shape[:3]).astype(np.float32)
    return replace(made_clip, depth=depth, gravity=np.array([0.1, 0.0, -9.8]))


def test_clip_depth_and_labels_arrive_as_they_were(deep_clip):
    buffer = over_topics(deep_clip)
    assert buffer.missing(masks=True) == ""
    assert_same(buffer.clip(), deep_clip)
    np.testing.assert_array_equal(buffer.clip().labels, deep_clip.labels)


def test_a_clip_without_depth_says_so(made_clip):
    buffer = over_topics(made_clip)
    assert buffer.missing(masks=True) == ""
    assert_same(buffer.clip(), made_clip)


def test_the_label_image_of_a_mask_topic_arrives_and_its_absence_too(made_clip):
    labels = made_clip.labels[0] * 3
    np.testing.assert_array_equal(over_topics(replace(made_clip, first_labels=labels)).clip().first_labels, labels)
    assert over_topics(made_clip).clip().first_labels is None


def test_a_lost_frame_is_lost_on_the_other_side_too(deep_clip):
    seen = np.arange(len(deep_clip)) != 5
    frames, depth = deep_clip.frames.copy(), deep_clip.depth.copy()
    frames[5], depth[5] = frames[4], 0
    clip = replace(deep_clip, observed=seen, frames=frames, depth=depth)
    buffer = over_topics(clip)
    assert len(buffer.announced) == len(clip) - 1
    assert_same(buffer.clip(), clip)
    np.testing.assert_array_equal(buffer.clip().labels, clip.labels)


def test_stamps_with_jitter_give_the_clock_of_the_recording_bit_for_bit(deep_clip):
    jitter = np.random.default_rng(1).integers(-10**6, 10**6, len(deep_clip))
    stamps = slot_stamps(deep_clip) + jitter
    first = over_topics(deep_clip, stamps).clip()
    again = over_topics(first, slot_stamps(first, stamps)).clip()
    assert (first.period_s, first.start_ns) == (again.period_s, again.start_ns)


@pytest.mark.parametrize("topic", ["clip/image", "clip/depth", "clip/mask", "clip/end", "clip/camera_info", "clip/camera_pose", "clip/gravity", "clip/first_mask"])
def test_a_clip_is_complete_only_when_the_last_message_of_each_topic_is_there(deep_clip, topic):
    stamps = slot_stamps(deep_clip)
    everything = [*clip_messages(deep_clip, stamps), *mask_messages(deep_clip, stamps)]
    last = max(i for i, (name, _) in enumerate(everything) if name == topic)
    buffer = ClipBuffer()
    sent(buffer, everything[:last] + everything[last + 1 :])
    assert topic in buffer.missing(masks=True)
    sent(buffer, [everything[last]])
    assert buffer.missing(masks=True) == ""


def test_the_order_of_arrival_does_not_matter(deep_clip):
    stamps = slot_stamps(deep_clip)
    buffer = ClipBuffer()
    sent(buffer, [*clip_messages(deep_clip, stamps), *mask_messages(deep_clip, stamps)][::-1])
    assert_same(buffer.clip(), deep_clip)
    np.testing.assert_array_equal(buffer.clip().labels, deep_clip.labels)


def test_a_received_pose_is_handed_on_to_the_last_bit(made_clip):
    link = messages.camera_pose(0, made_clip.camera)
    link["transform"]["rotation"] = {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.9273618495495703}
    buffers = [ClipBuffer(), ClipBuffer()]
    for buffer in buffers:
        sent(buffer, clip_messages(made_clip, slot_stamps(made_clip), link))
    poses = [buffer.clip().camera.world_from_camera for buffer in buffers]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert buffers[0].single("clip/camera_pose").transform.rotation.w == 0.9273618495495703


def test_masks_of_another_size_are_refused_with_a_sentence(made_clip):
    buffer = over_topics(replace(made_clip, labels=made_clip.labels[:, ::2]))
    with pytest.raises(InputError, match="clip/mask"):
        buffer.clip()


def test_one_frame_makes_no_clip_and_is_reported(made_clip):
    one = replace(made_clip, frames=made_clip.frames[:1], labels=made_clip.labels[:1])
    buffer = over_topics(one)
    assert buffer.missing(masks=True) == ""
    with pytest.raises(InputError, match="at least 2"):
        buffer.clip()
