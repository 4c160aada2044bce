"""Claims about clamp and length drawn with clicks: two make a line, which labelling and fit take for what a setting says."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.nodes.clicks import CLAMP_CLICK, LENGTH_CLICK, Drawn
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.segment_node import SegmentNode
from diffphys_ros.nodes.splat_node import SplatNode
from diffphys_ros.splats import from_points
from diffphys_ros.types import Clip, Splats

from .processes import PATIENCE_S
from .test_clip_identity import messages_of, splats_of

NAMES = {CLAMP_CLICK: "/robot1/clamp_click", LENGTH_CLICK: "/robot1/length_click"}


def click_at(u: float, v: float, frame_id: str = "camera_optical") -> PointStamped:
    message = PointStamped()
    message.header.frame_id = frame_id
    message.point.x, message.point.y = float(u), float(v)
    return message


def drawn(topic: str, *points: tuple[float, float]) -> Drawn:
    lines = Drawn()
    for point in points:
        lines = lines.clicked(topic, click_at(*point))
    return lines


def test_two_clicks_are_a_line_which_stands_until_the_next_one_is_whole(made_clip) -> None:
    settings, points = build({"scene.clamp_box_m": [-0.1, -0.1, -0.1, 0.1, 0.1, 0.1]}), [(3.0, 4.0), (13.0, 4.0), (5.0, 6.0), (15.0, 6.0)]
    one, two, three, four = (drawn(CLAMP_CLICK, *points[:count]).on(settings, made_clip.camera, NAMES).scene for count in (1, 2, 3, 4))
    assert one == settings.scene
    assert (two.clamp_px, two.clamp_box_m) == ([3, 4, 13, 4], None)
    assert three == two
    assert four.clamp_px == [5, 6, 15, 6]


def test_a_clicked_length_leaves_the_clamp_as_it_was_told(made_clip) -> None:
    settings = build({"scene.clamp_px": [[0, 0], [9, 0]], "scene.size_m": 0.1})
    scene = drawn(LENGTH_CLICK, (1.0, 2.0), (3.0, 40.0)).on(settings, made_clip.camera, NAMES).scene
    assert scene == replace(settings.scene, length_px=[1, 2, 3, 40])


def test_an_end_in_a_frame_that_nobody_knows_is_refused_by_the_name_of_its_topic(made_clip) -> None:
    lines = Drawn().clicked(CLAMP_CLICK, click_at(1, 2, "map")).clicked(CLAMP_CLICK, click_at(1, 2))
    with pytest.raises(InputError, match=r"^topic /robot1/clamp_click: a point in frame 'map', must be in"):
        lines.on(build({}), made_clip.camera, NAMES)


def watched(monkeypatch: pytest.MonkeyPatch, module: str, answer: Any) -> list[Any]:
    """The settings with which a node's jobs are begun."""
    got: list[Any] = []

    def elsewhere(job: Any, *given: Any):
        got.append(next(each for each in given if hasattr(each, "scene")))
        yield from ()
        return answer(given)

    monkeypatch.setattr(f"diffphys_ros.nodes.{module}.steps", elsewhere)
    return got


def until(node: Any, done: Any) -> None:
    end = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < end, node.waiting_for() or node.state
        node._poll()


ANSWERS = {
    SegmentNode: lambda given: np.zeros(given[0].frames.shape[:3], np.uint8),
    SplatNode: lambda given: (start_splats(), given[0].camera),
    FitNode: lambda given: [],
}


def start_splats() -> Splats:
    return from_points(np.random.default_rng(0).normal(size=(20, 3)), np.full((20, 3), 0.5))


@pytest.mark.parametrize(("kind", "module"), [(SegmentNode, "segment_node"), (SplatNode, "splat_node"), (FitNode, "fit_node")])
def test_a_line_begins_the_work_on_the_clip_again_and_ends_with_the_clip(make_node, made_clip, monkeypatch, kind, module) -> None:
    got = watched(monkeypatch, module, ANSWERS[kind])
    first = replace(made_clip, depth=np.full(made_clip.frames.shape[:3], 0.5, np.float32))
    node = make_node(kind)

    def feed(clip: Clip) -> None:
        for name, message in messages_of(clip):
            if kind is not SegmentNode or name != "clip/mask":
                node.take(name, message)
        if kind is FitNode:
            node._on_splats(splats_of(clip))

    feed(first)
    until(node, lambda: len(got) == 1 and not node.worker.busy)
    node.draw(CLAMP_CLICK, click_at(3, 4))
    node._poll()
    assert node.complete, "one end is no line"
    node.draw(CLAMP_CLICK, click_at(13, 4))
    until(node, lambda: len(got) == 2 and not node.worker.busy)
    feed(replace(first, start_ns=first.start_ns + 60_000_000_000))
    until(node, lambda: len(got) == 3 and not node.worker.busy)
    assert [settings.scene.clamp_px for settings in got] == [None, [3, 4, 13, 4], None]
