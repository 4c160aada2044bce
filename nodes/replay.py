"""A camera driver's stand-in: publishes the raw topics of a bag at the recorded rate.

`python -m diffphys_ros.nodes.replay clip.mcap` gives image or image/compressed, camera_info, depth, with `--mask TOPIC` label images on
`mask`, and the pose on `camera_pose` (latched); then stays, so that latched messages can be had, until a signal comes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from diffphys_ros.bags.storage import Bag, open_bag
from diffphys_ros.bags.topics import COMPRESSED, choose_topics
from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas.topics import CAMERA_INFO, IMAGE, TRANSFORM
from diffphys_ros.nodes import middleware
from diffphys_ros.nodes.executables import BAD_INPUT, SPIN_S, Stop


def raw_messages(bag: Bag, source: str, topics: Topics) -> Iterator[tuple[str, str, int, Any]]:
    """(topic, type, log time [ns], plain fields) of what a driver would publish, poses first."""
    image, depth, info = choose_topics(bag, topics, source)
    for _, log_ns, tree in bag.messages(["/tf_static"]):
        for link in tree.transforms:
            yield "camera_pose", TRANSFORM, log_ns, plain(link)
    compressed = bag.types[image] == COMPRESSED
    names = {image: ("image/compressed", COMPRESSED) if compressed else ("image", IMAGE), depth: ("depth", IMAGE), info: ("camera_info", CAMERA_INFO)}
    names |= {topics.mask: ("mask", IMAGE)}
    for topic, log_ns, message in bag.messages([t for t in names if t]):
        yield *names[topic], log_ns, plain(message)


def plain(message: Any) -> Any:
    """Nested dicts of a message read from a bag."""
    if isinstance(message, list):
        return [plain(item) for item in message]
    if not hasattr(message, "__dataclass_fields__"):
        return message
    return {name: plain(getattr(message, name)) for name in message.__dataclass_fields__ if not name.startswith("__")}


def main() -> int:
    """Replays until the end, then waits for a signal."""
    parser = argparse.ArgumentParser(description="Publishes the raw topics of a bag at the recorded rate.")
    parser.add_argument("bag", type=Path)
    parser.add_argument("--rate", type=float, default=1.0, help="speed relative to the recording")
    parser.add_argument("--mask", metavar="TOPIC", help="of label images")
    options, _ = parser.parse_known_args()
    stop = Stop()
    middleware.prepare()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    try:
        with open_bag(options.bag) as bag:
            messages = list(raw_messages(bag, str(options.bag), Topics(mask=options.mask)))
    except InputError as error:
        print(f"replay: {error}", file=sys.stderr)
        return BAD_INPUT
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("camera")
    stop.spinning = True
    _publish(node, messages, options.rate, stop)
    while not stop.wanted:
        rclpy.spin_once(node, timeout_sec=SPIN_S)
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


def _publish(node: Any, messages: list[tuple[str, str, int, Any]], rate: float, stop: Stop) -> None:
    from diffphys_ros.nodes.convert import message_class, to_ros
    from diffphys_ros.nodes.qos import latched, sensor

    outputs = {
        topic: node.create_publisher(message_class(kind), topic, latched() if topic == "camera_pose" else sensor("reliable"))
        for topic, kind in {m[0]: m[1] for m in messages}.items()
    }
    ready = [(topic, log_ns, to_ros(kind, fields)) for topic, kind, log_ns, fields in messages]
    # a driver would not wait; a replay that nobody hears is of no use
    while not stop.wanted and not all(publisher.get_subscription_count() for publisher in outputs.values()):
        time.sleep(SPIN_S)
    began, first = time.monotonic(), min(log_ns for topic, log_ns, _ in ready if topic != "camera_pose")
    for topic, log_ns, message in ready:
        time.sleep(max(0.0, (log_ns - first) * 1e-9 / rate - (time.monotonic() - began)))
        if stop.wanted:
            return
        outputs[topic].publish(message)


if __name__ == "__main__":
    sys.exit(main())
