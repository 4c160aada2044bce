"""Claims about what is kept of a clip: bounded, and of one clip alone."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clip_buffer import MASK, OVERFULL, ClipBuffer
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.segment_node import SegmentNode
from tests.conftest import make_clip

HEAD = messages.header(5, "camera_optical")
MIB = 2**20


def said_of(clip) -> list:
    stamps = slot_stamps(clip)
    return [(name, to_ros(TOPICS[name].type_name, plain)) for name, plain in [*clip_messages(clip, stamps), *mask_messages(clip, stamps)]]


def later(clip, seconds: int = 60):
    """Another clip: other pictures, another time."""
    return replace(clip, frames=255 - clip.frames, start_ns=clip.start_ns + seconds * 10**9)


def image(pixels, encoding: str, /, stamp: int = 5, **changes):
    return to_ros("sensor_msgs/msg/Image", messages.image(messages.header(stamp, "camera_optical"), pixels, encoding) | changes)


def path(clip, count: int, /, **changes):
    stamps = slot_stamps(clip)[:count]
    return to_ros(TOPICS["clip/end"].type_name, messages.camera_path(stamps.tolist(), clip.camera) | changes)


def take(buffer: ClipBuffer, said, sent_ns: int) -> int:
    for name, message in said:
        sent_ns += 1
        buffer.take(name, message, None if name == MASK else sent_ns)
    return sent_ns


@pytest.mark.parametrize("shuffled", [False, True])
def test_a_second_clip_takes_the_place_of_the_first_whatever_comes_first_of_it(made_clip, shuffled) -> None:
    buffer, second = ClipBuffer(), later(made_clip)
    sent = take(buffer, said_of(made_clip), 0)
    assert buffer.missing(masks=True) == ""
    said = list(enumerate(said_of(second), sent + 1))
    if shuffled:
        head = [word for word in said if word[1][0] != MASK]
        np.random.default_rng(0).shuffle(head)
        said = [*head, *(word for word in said if word[1][0] == MASK)]  # they are made of the whole clip
    for when, (name, message) in said:
        buffer.take(name, message, None if name == MASK else when)
    assert buffer.missing(masks=True) == ""
    np.testing.assert_array_equal(buffer.clip().frames, second.frames)
    np.testing.assert_array_equal(buffer.clip().labels, second.labels)


def test_masks_of_an_earlier_clip_are_not_those_of_this_one(made_clip) -> None:
    buffer = ClipBuffer()
    for name, message in said_of(later(made_clip, -60)):
        if name == MASK:
            buffer.take(name, message)
    for name, message in said_of(made_clip):
        if name != MASK:
            buffer.take(name, message, 7)
    assert buffer.missing(masks=True) == MASK


def test_what_was_left_of_a_clip_without_an_end_does_not_spoil_the_next(made_clip) -> None:
    buffer, second = ClipBuffer(), later(made_clip)
    sent = take(buffer, said_of(made_clip)[:7], 0)
    buffer.take("clip/end", path(made_clip, 3), sent + 1)
    take(buffer, said_of(second), sent + 1)
    assert buffer.missing(masks=True) == ""
    np.testing.assert_array_equal(buffer.clip().frames, second.frames)


def test_an_image_of_another_size_is_no_frame(made_clip) -> None:
    buffer = ClipBuffer()
    buffer.take("clip/image", image(np.zeros((1, 1, 3), np.uint8), "rgb8"), 1)
    take(buffer, said_of(made_clip), 1)
    buffer.take("clip/image", image(np.zeros((1, 1, 3), np.uint8), "rgb8"), 10**6)
    np.testing.assert_array_equal(buffer.clip().frames, made_clip.frames)


@pytest.mark.parametrize("topic", ["clip/image", "clip/depth", MASK])
def test_a_clip_that_never_ends_is_dropped_at_the_bound_and_the_next_is_taken(made_clip, topic) -> None:
    buffer, encoding = ClipBuffer(MIB), {"clip/image": "rgb8", "clip/depth": "32FC1", MASK: "mono8"}[topic]
    pixels = np.zeros((128, 128, 3) if encoding == "rgb8" else (128, 128), np.float32 if encoding == "32FC1" else np.uint8)
    tracemalloc.start()
    refused = []
    for k in range(400):  # 6 to 26 MiB
        try:
            buffer.take(topic, image(pixels, encoding, stamp=k), k)
        except InputError as error:
            refused.append(str(error))
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2 * MIB
    assert held < MIB / 2
    assert "1 MiB and is dropped" in refused[0]
    assert buffer.missing(masks=True) == f"clip/camera_info {OVERFULL}"
    take(buffer, said_of(made_clip), 1000)
    assert buffer.missing(masks=True) == ""


def test_the_count_of_bytes_follows_what_is_kept(made_clip) -> None:
    buffer = ClipBuffer()
    for clip in (made_clip, later(made_clip), later(made_clip, 120)):
        for _ in range(2):
            take(buffer, said_of(clip), 100 * clip.start_ns)
    kept = [*buffer.images.values(), *buffer.depths.values(), *buffer.masks.values()]
    assert buffer.bytes == sum(len(message.data) for message in kept)
    assert len(kept) == 2 * len(made_clip) + 1


BAD = {
    "clip/image": [
        ("encoding", lambda: image(np.zeros((2, 2), np.float32), "32FC1")),
        ("encoding 'nv21' is unknown", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8", encoding="nv21")),
        ("2x0 px", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8", height=0)),
        ("need more", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8", step=2**31)),
        ("at most 33554432 pixels", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8", height=2**16, width=2**16)),
    ],
    "clip/depth": [("must be 16UC1", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8"))],
    "clip/first_mask": [("must be mono8", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8"))],
    MASK: [("must be mono8", lambda: image(np.zeros((2, 2, 3), np.uint8), "rgb8"))],
    "clip/camera_info": [
        ("4000000000 ns beside the seconds", lambda: to_ros("sensor_msgs/msg/CameraInfo", {"header": {"stamp": {"sec": 2**31 - 1, "nanosec": 4 * 10**9}}, "width": 4, "height": 3})),
        ("K\\[0\\]", lambda: to_ros("sensor_msgs/msg/CameraInfo", {"header": HEAD, "width": 4, "height": 3})),
        ("not finite", lambda: to_ros("sensor_msgs/msg/CameraInfo", {"header": HEAD, "width": 4, "height": 3, "k": np.full(9, np.nan)})),
    ],
    "clip/camera_pose": [("unit quaternion", lambda: to_ros("geometry_msgs/msg/TransformStamped", {"header": HEAD, "transform": {"rotation": {"w": 0.0}}}))],
    "clip/gravity": [("must be within 100", lambda g=g: to_ros("geometry_msgs/msg/Vector3Stamped", {"header": HEAD, "vector": {"z": g}})) for g in (np.nan, -1e300)],
    "clip/end": [
        ("announces 0 images", lambda: to_ros(TOPICS["clip/end"].type_name, {})),
        ("must ascend from that of its header", lambda: path(make_clip(), 3, header=messages.header(7))),
        ("must ascend from that of its header", lambda: path(replace(make_clip(), period_s=-0.1), 3)),
    ],
}


@pytest.mark.parametrize(("topic", "words", "make"), [(topic, words, make) for topic, rows in BAD.items() for words, make in rows])
def test_a_message_that_can_be_part_of_no_clip_is_refused_and_nothing_of_it_kept(topic, words, make) -> None:
    buffer = ClipBuffer()
    with pytest.raises(InputError, match=words) as caught:
        buffer.take(topic, make())
    assert topic in str(caught.value)
    assert buffer == ClipBuffer()


def test_a_clip_that_comes_while_the_last_one_is_labelled_is_next(make_node, made_clip) -> None:
    import threading

    gate, begun = threading.Event(), []

    class Slow(SegmentNode):
        def job(self):
            stamps = self.buffer.stamps()

            def wait():
                yield f"{stamps[0]}"
                gate.wait(60)
                return []

            begun.append(int(stamps[0]))
            return wait

    node, second = make_node(Slow), later(made_clip)
    for clip in (made_clip, second):
        for name, message in said_of(clip):
            if name != MASK:
                node.take(name, message)
    assert begun == [made_clip.start_ns]
    gate.set()
    while len(begun) < 2:
        node._poll()
    assert begun == [made_clip.start_ns, second.start_ns]


def test_a_bound_out_of_range_ends_a_node_that_starts(make_node) -> None:
    with pytest.raises(InputError, match=r"max_mib is 0, must be in 1"):
        make_node(SegmentNode, max_mib=0)


def test_where_frame_0_is_all_that_is_wanted_its_mask_alone_is_kept_and_counts(made_clip) -> None:
    buffer = ClipBuffer(first_alone=True)
    take(buffer, said_of(made_clip), 0)
    assert buffer.missing(masks=True) == ""
    assert buffer.bytes == made_clip.frames[0].nbytes + made_clip.labels[0].nbytes
    assert np.array_equal(buffer.clip().labels[0], made_clip.labels[0])
    for frame, sets in ((1, 1), (0, 2)):
        labels = made_clip.labels.copy()
        labels[frame, :4] = 1
        take(buffer, [word for word in said_of(replace(made_clip, labels=labels)) if word[0] == MASK], 0)
        assert buffer.mask_set == sets
