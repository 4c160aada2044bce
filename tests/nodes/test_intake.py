"""Claims about what ingest_node collects: bounded, and not spoilt by single messages."""

from __future__ import annotations

import time
from contextlib import nullcontext

import numpy as np
import pytest
import rclpy
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.bags.transforms import MAX_LINKS
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_job import MOST_IN_HAND
from diffphys_ros.nodes.clip_out import messages_of
from diffphys_ros.nodes.convert import message_class, stamp_ns, to_ros
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.intake import SPARE, Intake
from diffphys_ros.nodes.qos import profile
from diffphys_ros.types import Clip

from .processes import PATIENCE_S

MIB = 2**20
PERIOD_NS = 33_333_333


def image(pixels, encoding: str, stamp: int, /, **changes):
    return to_ros("sensor_msgs/msg/Image", messages.image(messages.header(stamp, "camera_optical"), pixels, encoding) | changes)


def colour(clip, k: int):
    return image(clip.frames[k], "rgb8", clip.start_ns + k * PERIOD_NS)


def depth(clip, k: int, after_ns: int = 0, metres: float = 0.5):
    return image(np.full(clip.frames.shape[1:3], metres, np.float32), "32FC1", clip.start_ns + k * PERIOD_NS + after_ns)


def info_of(clip, **changes):
    return to_ros("sensor_msgs/msg/CameraInfo", messages.camera_info(messages.header(0, "camera_optical"), clip.camera) | changes)


def link(child: str, parent: str):
    return to_ros("geometry_msgs/msg/TransformStamped", {"header": messages.header(0, parent), "child_frame_id": child})


def clip_of(intake: Intake) -> tuple[Clip, list[str]]:
    """What a listener makes of the messages, and what ingest_node says of them."""
    buffer, steps = ClipBuffer(), messages_of(intake, config.build({}))
    while True:
        try:
            topic, fields = next(steps)
        except StopIteration as stop:
            assert buffer.missing(masks=False) == ""
            return buffer.clip(), stop.value.notes
        buffer.take(topic, to_ros(TOPICS[topic].type_name, fields))


def known() -> bool:
    return False


def test_depth_without_colour_is_kept_as_far_as_it_may_be_needed(made_clip) -> None:
    intake = Intake(1200, 64 * MIB)
    for k in range(5000):
        intake.take_depth(depth(made_clip, k))
    assert len(intake.depths) <= SPARE
    assert stamp_ns(intake.depths[-1]) == made_clip.start_ns + 4999 * PERIOD_NS


def test_large_images_beside_are_bounded_in_bytes() -> None:
    intake = Intake(1200, MIB)
    for k in range(50):
        intake.take_depth(image(np.zeros((300, 300), np.float32), "32FC1", k))
        intake.take_mask(image(np.zeros((600, 600), np.uint8), "mono8", k))
    assert sum(len(m.data) for m in intake.depths) <= MIB
    assert sum(len(m.data) for m in intake.masks) <= MIB
    assert intake.depths
    assert intake.masks


def test_depth_at_thrice_the_rate_leaves_every_frame_its_own(made_clip) -> None:
    intake = Intake(1200, 64 * MIB)
    for k in range(150):
        for third in (-1, 0, 1):
            intake.take_depth(depth(made_clip, k, third * PERIOD_NS // 3, 0.5 + 0.1 * third))
        intake.take_image("image", image(made_clip.frames[0], "rgb8", made_clip.start_ns + k * PERIOD_NS))
    intake.beside.take_info(info_of(made_clip), fov_known=known)
    assert len(intake.depths) <= 150 + SPARE
    clip, _ = clip_of(intake)
    assert (clip.depth == np.float32(0.5)).all()


def test_the_mask_nearest_to_the_first_image_is_used_whenever_it_comes(made_clip) -> None:
    intake = Intake(1200, 64 * MIB)
    for k in (-3, -1, 2):
        if k == 2:
            intake.take_image("image", colour(made_clip, 0))
        intake.take_mask(image(np.full((48, 64), k + 10, np.uint8), "mono8", made_clip.start_ns + k * PERIOD_NS))
    assert [m.data[0] for m in intake.masks] == [9]


def test_a_clip_is_full_before_its_listeners_would_have_to_drop_it(made_clip) -> None:
    intake = Intake(1200, MIB)
    for k in range(1000):
        if intake.full:
            break
        intake.take_image("image", image(made_clip.frames[0], "rgb8", made_clip.start_ns + k * PERIOD_NS))
    frames = len(intake.images)
    assert frames == MIB // (64 * 48 * (3 + 1))


def test_bad_images_among_good_ones_cost_themselves_alone(made_clip) -> None:
    intake = Intake(1200, 64 * MIB)
    intake.beside.take_info(info_of(made_clip), fov_known=known)
    intake.take_image("image", image(np.zeros((1, 1, 3), np.uint8), "rgb8", made_clip.start_ns - PERIOD_NS))
    for k in range(len(made_clip)):
        for changes in ({"height": 400}, {"encoding": "nv21"}, {"width": 0}):
            with pytest.raises(InputError, match="topic image"):
                intake.take_image("image", image(made_clip.frames[k], "rgb8", made_clip.start_ns, **changes))
        intake.take_image("image", colour(made_clip, k))
    clip, notes = clip_of(intake)
    np.testing.assert_array_equal(clip.frames, made_clip.frames)
    assert any("1 of 13 images were left out" in note for note in notes)


def test_an_unusable_camera_info_does_not_take_the_place_of_a_good_one(made_clip) -> None:
    intake = Intake(1200, 64 * MIB)
    for changes, refused in (({"k": np.zeros(9)}, True), ({}, False), ({"k": np.full(9, np.nan)}, True), ({"width": 640, "height": 480}, False)):
        with pytest.raises(InputError, match="topic camera_info") if refused else nullcontext():
            intake.beside.take_info(info_of(made_clip, **changes), fov_known=known)
    for k in range(len(made_clip)):
        intake.take_image("image", colour(made_clip, k))
    clip, _ = clip_of(intake)
    np.testing.assert_array_equal(clip.camera.pixel_from_camera, made_clip.camera.pixel_from_camera)


def test_a_transform_that_closes_a_circle_or_has_no_rotation_is_refused() -> None:
    intake = Intake(1200, MIB)
    intake.beside.take_link(link("camera", "arm"))
    intake.beside.take_link(link("arm", "world"))
    with pytest.raises(InputError, match="circle"):
        intake.beside.take_link(link("world", "camera"))
    broken = link("camera", "world")
    broken.transform.rotation.w = 0.0
    with pytest.raises(InputError, match="quaternion"):
        intake.beside.take_link(broken)
    assert intake.beside.transforms.root("camera") == "world"
    assert len(intake.beside.transforms) == 2


def test_the_transform_tree_is_bounded() -> None:
    intake = Intake(1200, MIB)
    for k in range(MAX_LINKS):
        intake.beside.take_link(link(str(k), "world"))
    with pytest.raises(InputError, match="1000 links"):
        intake.beside.take_link(link("one more", "world"))


def ended(node: IngestNode) -> str:
    """The clip's end is asked for; the state when the worker is done."""
    assert node._on_end(Trigger.Request(), Trigger.Response()).success
    while node.worker.busy:
        node._poll()
    return node.state


def test_a_clip_that_fails_does_not_keep_the_next_one_out(make_node, made_clip) -> None:
    node = make_node(IngestNode)
    node.take("camera_info", info_of(made_clip))
    node.take("depth", image(np.ones((5, 5), np.float32), "32FC1", made_clip.start_ns))
    for state in ("failed", "done"):
        for k in range(len(made_clip)):
            node.take("image", colour(made_clip, k))
        assert ended(node) == state


def test_a_clip_that_is_cut_off_at_its_bound_is_warned_of(make_node, made_clip, monkeypatch: pytest.MonkeyPatch) -> None:
    node, said = make_node(IngestNode, max_frames=5), []
    monkeypatch.setattr(type(node.get_logger()), "warning", lambda logger, words, **options: said.append(words))
    node.take("camera_info", info_of(made_clip))
    for k in range(len(made_clip)):
        node.take("image", colour(made_clip, k))
    assert [words for words in said if "a clip of 5 images" in words and "max_frames" in words and "is no part of it" in words]


def test_a_clip_that_ends_before_its_camera_info_comes_waits_for_it(make_node, made_clip) -> None:
    node = make_node(IngestNode)
    for k in range(len(made_clip)):
        node.take("image", colour(made_clip, k))
    assert ended(node) == "waiting"
    assert node.waiting_for() == "/camera_info"
    node.take("camera_info", info_of(made_clip))
    node._look()
    while node.worker.busy:
        node._poll()
    assert node.state == "done"


def test_images_are_decoded_one_at_a_time_and_a_slow_publisher_is_waited_for(make_node, made_clip) -> None:
    node = make_node(IngestNode)
    node.take("camera_info", info_of(made_clip))
    for k in range(100):
        node.take("image", image(made_clip.frames[k % 12], "rgb8", made_clip.start_ns + k * PERIOD_NS))
    assert node._on_end(Trigger.Request(), Trigger.Response()).success
    until = time.monotonic() + 1.0
    while time.monotonic() < until:  # nobody polls
        time.sleep(0.05)
    assert sum(event.value is not None for event in node.worker.poll()) == MOST_IN_HAND


def test_what_stages_say_of_a_clip_lets_the_next_one_go(make_node, made_clip) -> None:
    node, stage = make_node(IngestNode), rclpy.create_node("segment_node")
    done = TOPICS["clip/done"]
    stage.create_publisher(message_class(done.type_name), "clip/done", profile(done))
    until = time.monotonic() + PATIENCE_S
    while node._stages() != {"/segment_node"}:
        assert time.monotonic() < until
        time.sleep(0.01)
    node.take("camera_info", info_of(made_clip))
    for number in range(4):
        for k in range(len(made_clip)):
            node.take("image", image(made_clip.frames[k], "rgb8", made_clip.start_ns + (number * 1000 + k) * PERIOD_NS))
        node._on_end(Trigger.Request(), Trigger.Response())
        while node.worker.busy:
            node._poll()
    assert node.dispatch.out == made_clip.start_ns
    assert (node.health()["clips_waiting"], node.health()["clips_dropped"]) == (2, 1)
    assert "/segment_node to end with the clip before; 2 wait" in node.waiting_for()
    status = messages.status("/segment_node", {}, level=messages.OK)
    node._on_clip_done(to_ros(done.type_name, messages.diagnostics(made_clip.start_ns, [status])))
    node._look()
    while node.worker.busy:
        node._poll()
    assert node.dispatch.out == made_clip.start_ns + 1000 * PERIOD_NS
    stage.destroy_node()


def test_reset_keeps_camera_and_transforms_which_are_not_sent_again(make_node, made_clip) -> None:
    node, published = make_node(IngestNode), []
    send = node.send
    node.send = lambda name, fields: (published.append((name, fields)), send(name, fields))
    node.take("camera_info", info_of(made_clip))
    node.intake.beside.take_link(link("camera_optical", "world"))
    for _ in range(2):
        for k in range(len(made_clip)):
            node.take("image", colour(made_clip, k))
        assert ended(node) == "done"
        assert node._on_reset(Trigger.Request(), Trigger.Response()).success
    assert [fields["header"]["frame_id"] for name, fields in published if name == "clip/camera_pose"] == ["world", "world"]


def test_bounds_out_of_range_end_a_node_that_starts(make_node) -> None:
    with pytest.raises(InputError, match="max_frames is -1, must be in 2"):
        make_node(IngestNode, max_frames=-1)
