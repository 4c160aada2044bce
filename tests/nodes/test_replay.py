"""Claims about the replay that stands in for a camera."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import rclpy
import rclpy.node

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
