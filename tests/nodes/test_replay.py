"""Claims about the replay that stands in for a camera."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
import rclpy.node
from std_msgs.msg import Empty

from diffphys_ros.nodes import replay
from diffphys_ros.nodes.qos import RELIABLE_DEPTH


@pytest.mark.parametrize(("words", "least"), [((), 10), (("--inputs",), RELIABLE_DEPTH)], ids=["as recorded", "in the place of a camera"])
def test_images_wait_for_a_subscriber_that_is_late(half_sample: Path, domain: int, monkeypatch, words: tuple[str, ...], least: int) -> None:
    """It is counted before it has found the publisher: ten frames, as recorded, were overwritten while a busy machine brought the two together."""
    monkeypatch.setattr(sys, "argv", ["replay", str(half_sample / "clip.mcap"), *words])
    rclpy.init(domain_id=domain)
    node = rclpy.node.Node("player")
    try:
        kept = {topic: output.qos_profile.depth for topic, output in replay._player(node, replay._options()).outputs.items() if topic != "/tf_static"}
    finally:
        node.destroy_node()
        rclpy.shutdown()
    assert kept
    assert set(kept.values()) == {least}


def test_a_recording_that_stands_in_for_no_camera_is_played_though_nobody_listens(domain: int) -> None:
    rclpy.init(domain_id=domain)
    node = rclpy.node.Node("player")
    stop, heard_at_start = SimpleNamespace(wanted=False), []
    try:
        output = node.create_publisher(Empty, "nobody_listens", 1)
        node.create_timer(1.0, lambda: setattr(stop, "wanted", True))
        player = SimpleNamespace(outputs={"nobody_listens": output}, start=lambda: heard_at_start.append(stop.wanted))
        replay._play(player, node, stop, waits=False)
    finally:
        node.destroy_node()
        rclpy.shutdown()
    assert heard_at_start == [False]
