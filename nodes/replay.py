"""Plays a recording without `ros2 bag`: `python -m diffphys_ros.nodes.replay clip.mcap [--rate 1] [--loop] [--start 0] [--duration 0]`.

Topics, qualities of service and pace are those of the recording, with /clock. With `--inputs` it stands in for a camera driver: colour, depth,
their camera_info, an IMU, /tf and, with `--mask TOPIC`, label images come under the names that ingest_node listens to, the static transforms
on `camera_pose`, and it begins when all of them are heard. It stays at the end, so that what is latched can be had, until a signal comes.
A video is played as the images of a camera that nobody calibrated: ingest_node needs camera.fov_deg then.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any, NoReturn

from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas.topics import TRANSFORM
from diffphys_ros.nodes import middleware
from diffphys_ros.nodes.executables import BAD_INPUT, SPIN_S, Stop, clean_up


def main() -> NoReturn:
    """Plays until the end, then waits for a signal."""
    options = _options()
    stop = Stop()
    middleware.prepare()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, scratch, status = rclpy.create_node("player"), tempfile.TemporaryDirectory(prefix="diffphys-replay-"), 0
    stop.spinning = True
    try:
        options.bag = _recording(options.bag, Path(scratch.name))
        _play(_player(node, options), node, stop, waits=options.inputs)
    except InputError as error:
        status = BAD_INPUT
        print(f"replay: {error}", file=sys.stderr)
    except Exception:
        status = 1
        sys.excepthook(*sys.exc_info())
    finally:
        stop.deafen()
        clean_up(status, scratch.cleanup, node.destroy_node, rclpy.try_shutdown)


def _play(player: Any, node: Any, stop: Stop, *, waits: bool) -> None:
    """Play until a signal comes; begin when all topics are heard where it `waits` for that: a driver would not, but a replay that nobody hears is of no use."""
    import rclpy

    if waits:
        node.get_logger().info(f"waiting until somebody subscribes to {', '.join(sorted(each.topic_name for each in player.outputs.values()))}")
    while waits and not stop.wanted and not all(each.get_subscription_count() for each in player.outputs.values()):
        rclpy.spin_once(node, timeout_sec=SPIN_S)
    player.start()
    while not stop.wanted:
        rclpy.spin_once(node, timeout_sec=SPIN_S)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Plays a recording: topics, qualities of service, pace and clock as recorded.")
    parser.add_argument("bag", type=Path)
    parser.add_argument("--rate", type=float, default=1.0, help="speed relative to the recording")
    parser.add_argument("--loop", action="store_true", help="start over at the end")
    parser.add_argument("--start", type=float, default=0.0, help="left out at the beginning [s]")
    parser.add_argument("--duration", type=float, default=0.0, help="played at most [s]; 0: to the end")
    parser.add_argument("--inputs", action="store_true", help="the camera's topics alone, called as ingest_node listens to them")
    parser.add_argument("--mask", metavar="TOPIC", help="of label images, with --inputs")
    options, _ = parser.parse_known_args()
    if not 0 < options.rate < float("inf") or options.start < 0 or options.duration < 0:
        parser.error("--rate must be above 0, --start and --duration must not be below; give such numbers")
    return options


def _recording(path: Path, scratch: Path) -> Path:
    """What a player can play: the path itself, or a recording of the video that it is, made in a folder of ours."""
    from diffphys_ros.bags.read import is_bag
    from diffphys_ros.bags.write import write_recording
    from diffphys_ros.nodes.video_topics import topics_of_video

    return path if is_bag(path) or path.is_dir() else write_recording(scratch / "video.mcap", topics_of_video(path))


def _player(node: Any, options: argparse.Namespace) -> Any:
    from diffphys_ros.nodes.camera_bag import inputs, static_trees
    from diffphys_ros.nodes.player import Part, Player
    from diffphys_ros.nodes.qos import RELIABLE_DEPTH

    names, kept = None, 0
    if options.inputs:
        kept = RELIABLE_DEPTH  # a subscriber is counted before it has found the publisher itself: what is sent meanwhile must wait for it
        names = inputs(options.bag, Topics(mask=options.mask))
        _tell_pose(node, [link for tree in static_trees(options.bag) for link in tree.transforms])
    return Player(node, options.bag, Part(options.rate, options.loop, options.start, options.duration), names=names, kept=kept)


def _tell_pose(node: Any, links: list[Any]) -> None:
    from diffphys_ros.nodes.convert import message_class, to_ros
    from diffphys_ros.nodes.qos import latched

    output = node.create_publisher(message_class(TRANSFORM), "camera_pose", latched())
    for link in links:
        output.publish(to_ros(TRANSFORM, plain(link)))
    node.camera_pose = output  # lives as long as the node


def plain(message: Any) -> Any:
    """Nested dicts of a message read from a bag."""
    if isinstance(message, list):
        return [plain(item) for item in message]
    if not hasattr(message, "__dataclass_fields__"):
        return message
    return {name: plain(getattr(message, name)) for name in message.__dataclass_fields__ if not name.startswith("__")}


if __name__ == "__main__":
    main()
