"""A process that has published an answer and stays, as fit_node does after a fit: the made-up recovery of the tests, latched."""

from __future__ import annotations

import rclpy

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS, fields
from diffphys_ros.msg_schemas.recording import results
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.qos import profile
from tests.conftest import make_clip, make_recovery


def main() -> None:
    """Publishes, says so, and waits for a signal."""
    rclpy.init()
    node = rclpy.create_node("fit_node")
    clip = make_clip()
    for topic, kind, _, values, _ in results(fields.answer(make_recovery(clip), clip, config.Settings())):
        message = to_ros(kind, values)
        node.create_publisher(type(message), topic, profile(TOPICS[topic])).publish(message)
    print("published", flush=True)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
