"""Claims about whose a message is: nothing of another clip is used, whatever comes when, and what replaces something of this one is."""

from __future__ import annotations

import threading
import time
import zlib
from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clip_buffer import MASK, ClipBuffer
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.splat_node import SplatNode
from diffphys_ros.nodes.splat_topic import splat_cloud
from diffphys_ros.splats.ply import FIELDS, from_raw
from diffphys_ros.types import Clip

from .processes import PATIENCE_S

SECOND = 10**9


@pytest.fixture
def first(made_clip) -> Clip:
    return replace(made_clip, depth=np.full(made_clip.frames.shape[:3], 0.5, np.float32))


@pytest.fixture
def second(first) -> Clip:
    """Another clip of the same camera, a minute later."""
    return replace(first, start_ns=first.start_ns + 60 * SECOND, frames=255 - first.frames, labels=first.labels[:, :, ::-1].copy())


def messages_of(clip: Clip) -> list:
    stamps = slot_stamps(clip)
    plain = [*clip_messages(clip, stamps), *mask_messages(clip, stamps)]
    return [(name, to_ros(TOPICS[name].type_name, fields)) for name, fields in plain]


def masks_of(clip: Clip) -> list:
    return [(name, message) for name, message in messages_of(clip) if name == MASK]


def splats_of(clip: Clip, labels: np.ndarray | None = None, seed: int = 0, stamp: int | None = None):
    rows = np.random.default_rng(seed).normal(size=(20, len(FIELDS))).astype(np.float32)
    head = messages.header(clip.start_ns if stamp is None else stamp, "world")
    crc = zlib.crc32((clip.labels[0] if labels is None else labels).tobytes())
    return to_ros(TOPICS["splats"].type_name, splat_cloud(from_raw(rows), head, crc))


@pytest.mark.parametrize("topic", ["clip/camera_pose", "clip/gravity", "clip/first_mask", "clip/image", "clip/depth", "clip/end", MASK])
@pytest.mark.parametrize("before", [True, False])
def test_a_message_of_another_clip_is_not_used_in_place_of_one_that_is_missing(first, second, topic, before) -> None:
    buffer, own = ClipBuffer(), [each for each in messages_of(first) if each[0] != topic]
    strange = [each for each in messages_of(second) if each[0] == topic]
    for name, message in [*strange, *own] if before else [*own, *strange]:
        buffer.take(name, message)
    assert topic in buffer.missing(masks=True)
    for name, message in messages_of(first):
        if name == topic:
            buffer.take(name, message)
    assert buffer.missing(masks=True) == ""
    np.testing.assert_array_equal(buffer.clip().frames, first.frames)
    np.testing.assert_array_equal(buffer.clip().labels, first.labels)


def test_a_clip_of_which_all_came_before_its_camera_info_is_whole(first, second) -> None:
    buffer = ClipBuffer()
    for name, message in [*messages_of(first), *reversed(messages_of(second))]:
        buffer.take(name, message, 1 if message in [m for _, m in messages_of(first)] else 2)
    assert buffer.id == second.start_ns
    assert buffer.missing(masks=True) == ""
    np.testing.assert_array_equal(buffer.clip().labels, second.labels)


def poll(node, done) -> None:
    until = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < until, node.waiting_for() or node.state
        node._poll()
        time.sleep(0.005)


class Gated(SplatNode):
    """Its job waits, and says which labels it was given: of frame 0, more it does not keep."""

    def __init__(self) -> None:
        self.gate, self.begun, self.ended = threading.Event(), [], []
        super().__init__()

    def job(self):
        labels = self.buffer.copy().clip().labels[0]

        def work():
            yield "begun"
            while not self.gate.wait(0.01):
                yield "at work"
            return labels

        self.begun.append(labels)
        return work

    def on_news(self, news) -> None:
        pass

    def on_done(self, labels) -> None:
        self.ended.append(labels)

    def finish(self) -> None:
        self.gate.set()
        poll(self, lambda: not self.worker.busy)


def test_other_masks_end_the_work_on_the_old_ones_and_only_theirs_is_published(make_node, first) -> None:
    node, other = make_node(Gated), replace(first, labels=first.labels[:, :, ::-1].copy())
    for name, message in [*messages_of(first), *masks_of(other)[:-1]]:
        node.take(name, message)
    assert len(node.begun) == 1  # the new set is not complete
    node.take(*masks_of(other)[-1])
    poll(node, lambda: len(node.begun) == 2)
    node.finish()
    assert len(node.ended) == 1
    np.testing.assert_array_equal(node.ended[0], other.labels[0])


def test_masks_that_come_again_as_they_were_begin_nothing(make_node, first) -> None:
    node = make_node(Gated)
    for name, message in [*messages_of(first), *masks_of(first)]:
        node.take(name, message)
    node.finish()
    assert len(node.begun) == len(node.ended) == 1


def test_half_a_set_of_masks_of_a_killed_segmenter_is_not_mixed_with_the_next(make_node, first) -> None:
    node, other = make_node(Gated), replace(first, labels=first.labels[:, :, ::-1].copy())
    for name, message in messages_of(first):
        if name != MASK:
            node.take(name, message)
    for name, message in [*masks_of(other)[:7], *masks_of(first)]:
        node.take(name, message)
    node.finish()
    np.testing.assert_array_equal(node.ended[0], first.labels[0])


class Fitting(FitNode):
    """Says which Gaussians its jobs were given."""

    def __init__(self) -> None:
        self.given: list = []
        super().__init__()

    def job(self):
        self.given.append((self.buffer.id, self.splats[self.buffer.id].splats.mean[0, 0]))

        def work():
            yield from ()
            return []

        return work

    def settle(self) -> None:
        poll(self, lambda: not self.worker.busy)


def test_gaussians_of_another_clip_or_of_other_labels_are_not_fitted(make_node, first, second) -> None:
    node = make_node(Fitting)
    for name, message in messages_of(first):
        node.take(name, message)
    for cloud in (splats_of(second), splats_of(first, stamp=0), splats_of(first, labels=second.labels[0])):
        node._on_splats(cloud)
    assert node.given == []
    assert "splats in the masks of this clip" in node.waiting_for()
    node._on_splats(splats_of(first))
    assert [clip for clip, _ in node.given] == [first.start_ns]


def test_a_new_click_reaches_the_result_masks_then_gaussians_then_the_fit(make_node, first) -> None:
    node, other = make_node(Fitting), replace(first, labels=first.labels[:, :, ::-1].copy())
    for name, message in messages_of(first):
        node.take(name, message)
    node._on_splats(splats_of(first))
    node.settle()
    for name, message in masks_of(other):
        node.take(name, message)
    node.settle()
    assert len(node.given) == 1
    assert "splats" in node.waiting_for()
    node._on_splats(splats_of(other, seed=1))
    node.settle()
    assert len(node.given) == 2
    assert node.given[0][1] != node.given[1][1]


def test_gaussians_of_the_next_clip_may_come_before_it(make_node, first, second) -> None:
    node = make_node(Fitting)
    for clip in (first, second):
        node._on_splats(splats_of(clip))
    for clip in (first, second):
        for name, message in messages_of(clip):
            node.take(name, message)
        node.settle()
    assert [clip for clip, _ in node.given] == [first.start_ns, second.start_ns]


def test_a_clip_that_is_dropped_for_the_next_one_is_counted_and_said(make_node, first, second) -> None:
    node, heard = make_node(Fitting), []
    node.send = lambda name, fields: heard.append((name, fields)) if name == "clip/done" else None
    for clip in (first, second):
        for name, message in messages_of(clip):
            node.take(name, message)
    assert node.health()["clips_dropped"] == 1
    assert [(name, fields["header"], fields["status"][0]["message"]) for name, fields in heard] == [("clip/done", messages.header(first.start_ns), "dropped")]


def test_a_clip_is_kept_once_and_takes_other_masks_when_its_images_are_gone(make_node, first, tmp_path) -> None:
    (tmp_path / "few.yaml").write_text("experiment: {max_splats: 50}\n")
    node, other = make_node(SplatNode, config=str(tmp_path / "few.yaml"), fit__device="cpu"), replace(first, labels=first.labels[:, :, ::-1].copy())
    whole = sum(len(message.data) for name, message in messages_of(first) if name in ("clip/image", "clip/depth"))
    for name, message in messages_of(first):
        node.take(name, message)
    assert node.buffer.bytes < whole / 2  # frame 0 and the masks, before and after
    deadline = time.monotonic() + PATIENCE_S
    while node.buffer.images and time.monotonic() < deadline:
        node._poll()
    assert not node.buffer.images
    assert node.buffer.bytes < whole / 2  # frame 0 and the masks
    node.worker.cancel()
    for name, message in masks_of(other):
        node.take(name, message)
    assert node.buffer.missing(masks=True) == ""
    np.testing.assert_array_equal(node.buffer.clip().labels[0], other.labels[0])
    np.testing.assert_array_equal(node.buffer.clip().frames[0], first.frames[0])
