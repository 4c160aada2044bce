"""The five nodes as processes, a camera that sends them tiny clips, and what is heard of each: for many_clips.py, kills.py and soak.py."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from processes import environment, node, start, stop

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.msg_schemas import TOPICS, clouds, messages
from diffphys_ros.nodes import middleware
from diffphys_ros.types import Clip

NODES = ("ingest_node", "segment_node", "splat_node", "fit_node", "inspect_node")
RESULTS = ("~/material_field", "~/force_field", "~/quality")
SMALLER = 4  # by which the sample's images are
TINY = {"fit.iterations": 1, "segment.max_parts": 1, "experiment.cells": 2, "experiment.max_splats": 300, "experiment.refine_frames": 2, "experiment.per_cell": 2.0, "experiment.splat_iterations": 3}
SILENCE_S = 1.0
START_S = 120.0  # longest wait for nodes that start
EVERY_SECOND_SLOWER = 1.25  # a clip that swings slower by this is softer by its square: a result shows whose it is


@dataclass
class Told:
    """What came of a clip."""

    number: int
    clip: int  # its first stamp [ns]
    sent_s: float  # steady clock
    results: set[str] = field(default_factory=set)  # topics whose message carries this stamp
    whole_s: float | None = None  # when the last of them came
    frames: int = 0  # that ingest_node says the clip has
    done_s: float | None = None  # when fit_node had ended with it
    how: str = ""  # it ended
    young_pa: float = float("nan")

    @property
    def whole(self) -> bool:
        """Whether all that fit_node latches came of this clip."""
        return self.results == set(RESULTS)

    @property
    def over(self) -> bool:
        """Whether nothing more is to come of it."""
        return self.whole or (self.done_s is not None and not self.how.endswith(": done"))


def tiny_clip() -> Clip:
    """The bundled sample with few pixels."""
    clip = read_clip(sample_folder() / "clip.mcap", config.build({}))
    assert clip.depth is not None
    k, width, height = clip.camera.pixel_from_camera / [[SMALLER], [SMALLER], [1.0]], clip.camera.width // SMALLER, clip.camera.height // SMALLER
    frames = clip.frames.reshape(len(clip), height, SMALLER, width, SMALLER, 3).mean((2, 4)).round().astype(np.uint8)
    depth = np.ascontiguousarray(clip.depth[:, ::SMALLER, ::SMALLER])
    return replace(clip, frames=frames, depth=depth, camera=replace(clip.camera, pixel_from_camera=k, width=width, height=height))


class Rig:
    """Nodes in a ROS domain of their own, and this process beside them."""

    def __init__(self, out: Path, **settings: Any) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.out, self.env = out, environment() | {middleware.VARIABLE: str(middleware.PROFILE), "OMP_NUM_THREADS": "1"}
        os.environ.update(self.env)
        out.mkdir(parents=True, exist_ok=True)
        given = yaml.safe_load((sample_folder() / "given.yaml").read_text())["scene"]
        given.pop("first_mask")
        (out / "given.yaml").write_text(yaml.safe_dump({f"scene.{name}": value for name, value in given.items()} | TINY | settings))
        self.running: dict[str, subprocess.Popen] = {}
        self.told: dict[int, Told] = {}
        self.clip = tiny_clip()
        rclpy.init(args=["--ros-args", "--log-level", "error"])
        self.node, self.executor = rclpy.create_node("camera"), SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._publishers()
        self._subscribe()

    def close(self) -> dict[str, int]:
        """Ends everything; the exit statuses of the nodes."""
        import rclpy

        statuses = {name: stop(process) for name, process in self.running.items()}
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
        return statuses

    def start(self, *names: str) -> None:
        """Start nodes; each writes NAME.log."""
        for name in names:
            own = {"ingest_node": {"reliability": "reliable", "silence_s": SILENCE_S}, "inspect_node": {"file": self.out / f"{name}_{time.monotonic_ns()}.rrd"}}.get(name, {})
            with (self.out / f"{name}.log").open("a") as log:
                self.running[name] = start(node(name, own | {"config": self.out / "given.yaml"}), log)

    def kill(self, *names: str) -> None:
        """SIGKILL."""
        for name in names:
            self.running[name].send_signal(signal.SIGKILL)
            self.running[name].wait()

    def said(self, name: str, since: int = 0) -> str:
        """What a node has written, from a character on."""
        return (self.out / f"{name}.log").read_text(errors="replace")[since:]

    def spin(self, until: Callable[[], Any], limit_s: float) -> bool:
        """Listen until something holds; false where it did not in time."""
        end = time.monotonic() + limit_s
        while not until():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def wait_for_nodes(self, limit_s: float) -> bool:
        """Until all listen to the camera, and all stages are heard."""
        return self.spin(lambda: all(each.get_subscription_count() for each in (self.image, self.depth, self.info)) and self.node.count_publishers("clip/done") >= 3, limit_s)

    def ears(self) -> set[bytes]:
        """Who listens to the camera; for a while a killed one is among them."""
        topics = ("image", "depth", "camera_info")
        return {bytes(info.endpoint_gid) for topic in topics for info in self.node.get_subscriptions_info_by_topic(self.node.resolve_topic_name(topic))}

    def send(self, number: int) -> Told:
        """The images of a clip, faster than they were filmed, with stamps of their own."""
        slower = EVERY_SECOND_SLOWER if number % 2 else 1.0
        first = time.time_ns() // 1000 * 1000
        told = self.told[first] = Told(number, first, time.monotonic())
        camera, frame_id = self.clip.camera, self.clip.camera.frame_id
        self.publish(self.info, "sensor_msgs/msg/CameraInfo", messages.camera_info(messages.header(first, frame_id), camera))
        for k, (pixels, depth) in enumerate(zip(self.clip.frames, self.clip.depth, strict=True)):  # type: ignore[arg-type]
            head = messages.header(first + round(k * self.clip.period_s * slower * 1e9), frame_id)
            self.publish(self.depth, "sensor_msgs/msg/Image", messages.image(head, depth, "32FC1"))
            self.publish(self.image, "sensor_msgs/msg/Image", messages.image(head, pixels, "rgb8"))
            self.executor.spin_once(timeout_sec=0.002)
        return told

    def publish(self, publisher: Any, kind: str, plain: dict[str, Any]) -> None:
        """A plain message."""
        from diffphys_ros.nodes.convert import to_ros

        publisher.publish(to_ros(kind, plain))

    def set_parameter(self, name: str, value: int, of: str) -> bool:
        """Of a node that runs; whether it was taken."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        client = self.node.create_client(SetParameters, f"/{of}/set_parameters")
        if not self.spin(client.service_is_ready, 20):
            return False
        future = client.call_async(SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
        return self.spin(future.done, 20) and all(result.successful for result in future.result().results)

    def _publishers(self) -> None:
        from geometry_msgs.msg import TransformStamped
        from sensor_msgs.msg import CameraInfo, Image

        from diffphys_ros.nodes.qos import latched, sensor

        self.image, self.depth = (self.node.create_publisher(Image, topic, sensor("reliable")) for topic in ("image", "depth"))
        self.info = self.node.create_publisher(CameraInfo, "camera_info", sensor("reliable"))
        self.pose = self.node.create_publisher(TransformStamped, "camera_pose", latched())
        self.publish(self.pose, "geometry_msgs/msg/TransformStamped", messages.camera_pose(0, self.clip.camera))

    def _subscribe(self) -> None:
        from functools import partial

        from diffphys_ros.nodes.convert import message_class
        from diffphys_ros.nodes.qos import profile

        for name, hear in (*((topic, partial(self._hear_result, topic)) for topic in RESULTS), ("clip/done", self._hear_done), ("clip/end", self._hear_end)):
            row = TOPICS[name]
            self.node.create_subscription(message_class(row.type_name), name.replace("~", "/fit_node"), hear, profile(row))

    def _hear_result(self, topic: str, message: Any) -> None:
        told = self.told.get(stamp_of(message))
        if told is None:
            return
        told.results.add(topic)
        if told.whole and told.whole_s is None:
            told.whole_s = time.monotonic()
        if topic == "~/material_field":
            told.young_pa = float(np.median(10.0 ** clouds.unpack(message)["intensity"].astype(float)))

    def _hear_end(self, message: Any) -> None:
        told = self.told.get(stamp_of(message))
        if told is not None:
            told.frames = len(message.poses)

    def _hear_done(self, message: Any) -> None:
        told = self.told.get(stamp_of(message))
        status = message.status[0]
        if told is not None and (status.name == "/fit_node" or status.level != b"\0"):
            told.done_s, told.how = time.monotonic(), f"{status.name.strip('/')}: {status.message}"


def stamp_of(message: Any) -> int:
    """Header stamp [ns]."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@contextmanager
def rig(out: Path, **settings: Any) -> Iterator[Rig]:
    """A rig whose processes end with the context."""
    made = Rig(out, **settings)
    try:
        yield made
    finally:
        made.close()


def rigged(out: Path, work: Callable[[Rig], bool]) -> int:
    """What is done with a rig as soon as its five nodes hear the camera, which takes START_S at most; the exit status."""
    with rig(out) as graph:
        graph.start(*NODES)
        if not graph.wait_for_nodes(START_S):
            print(f"the nodes do not listen after {START_S:g} s; see {out}", file=sys.stderr)
            return 1
        return 0 if work(graph) else 1
