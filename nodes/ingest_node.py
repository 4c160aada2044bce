"""ingest_node: raw camera topics or a bag in, a clean clip out."""

from __future__ import annotations

import time
from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.errors import InputError, shown
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Clip

from .clip_stage import CLIP
from .clip_topics import clip_messages, slot_stamps
from .convert import message_class, stamp_ns
from .intake import Intake, clip_of
from .limits import MAX_FRAMES, MAX_MIB, bounded, max_bytes
from .parameters import Own, existing
from .player import Part, Player, inputs, static_links
from .qos import RELIABILITY, latched, sensor
from .stage import StageNode
from .worker import FAILED, Job

BAG = Own("bag", "", "recording to read instead of topics: MCAP file, rosbag2 folder, video or image folder")
OWN = (
    BAG,
    Own("rate", 0.0, "speed relative to the recording at which the topics of `bag` are played, with /clock, and heard; 0: its clip is read at once"),
    Own("loop", False, "play `bag` again and again; every pass ends a clip"),
    Own("start", 0.0, "of `bag`, left out at the beginning [s]"),
    Own("duration", 0.0, "of `bag`, taken at most [s]; 0: to its end"),
    Own("reliability", "best_effort", "of the raw inputs", tuple(RELIABILITY)),
    Own("silence_s", 2.0, "the clip ends after this long without an image [s]"),
    Own("max_frames", 1200, "the clip ends after this many images; bounds the memory"),
    MAX_MIB,
)
MAX_SILENCE_S = 3600.0
MAX_RATE, MAX_PART_S = 100.0, 1e6  # of what is played
REPLAY_JUMP_NS = 10**9  # stamps that go back by more are a bag that starts over


class IngestNode(StageNode):
    """Collects raw images until they stop, or ~/end is called, and publishes one clip; ~/reset begins another."""

    def __init__(self) -> None:
        super().__init__("ingest_node", OWN, CLIP)
        self.silence_s = bounded(self.parameters, "silence_s", 0.0, MAX_SILENCE_S)
        self.intake = Intake(int(bounded(self.parameters, "max_frames", 2, MAX_FRAMES)), max_bytes(self.parameters))
        self.clear()
        self.create_service(Trigger, "~/end", self._on_end)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.player: Player | None = None
        if existing(self.parameters["bag"]):
            self._read_or_play()
        else:
            self._subscribe()

    def clear(self) -> None:
        """Begin to collect."""
        self.intake.begin()
        self.closed, self.collected, self.ignored = False, 0, 0
        self.first_ns = self.last_ns = 0  # stamps of the collected images
        self.last_image: float | None = None

    def start(self, job: Job) -> None:
        """Close the clip and make it in the worker's thread."""
        self.closed = True
        self.worker.start(job)
        self.state = "working"

    def waiting_for(self) -> str:
        if self.closed:
            return ""
        return "image or image/compressed" if not self.collected else "the end of the clip" if self.intake.infos else "camera_info"

    def health(self) -> dict[str, Any]:
        return {"frames": self.collected, "frequency_hz": self._frequency(), "dropped": self.ignored}

    def on_done(self, result: tuple[Clip, np.ndarray, Any]) -> None:
        clip, stamps, pose = result
        self.advertise(*CLIP)
        for name, fields in clip_messages(clip, stamps, pose):
            self.send(name, fields)
        for note in clip.notes:
            self.get_logger().warning(note)
        self.get_logger().info(f"published a clip of {len(clip)} frames, {clip.period_s * 1e3:.1f} ms apart")

    def on_failed(self, reason: str) -> None:
        self.get_logger().error(reason)
        if not self.parameters["bag"]:
            self.clear()  # what comes next may make a clip

    def _subscribe(self) -> None:
        qos = sensor(self.parameters["reliability"])
        for topic, kind in (("image", Image), ("image/compressed", CompressedImage)):
            self.create_subscription(kind, topic, partial(self._on_image, topic), qos)
        for beside in ("depth", "mask"):
            self.create_subscription(Image, beside, partial(self._on_beside, beside), qos)
        self.create_subscription(CameraInfo, "camera_info", self._on_info, qos)
        self.create_subscription(TransformStamped, "camera_pose", self.intake.take_link, latched())
        try:
            from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
        except ImportError:
            pass  # an installation without tf2_msgs has camera_pose
        else:
            self.create_subscription(TFMessage, "/tf_static", self._on_tree, latched())
        self.create_timer(0.1, self._look_for_silence)

    def _on_image(self, topic: str, message: Any) -> None:
        self.note_input()
        if self.closed or self.intake.topic not in ("", topic):
            self.ignored += 1
            return
        if self.collected and self.last_ns - stamp_ns(message) > REPLAY_JUMP_NS:
            self.get_logger().info("stamps jumped back; the clip ends here")
            self._finish()
            return
        self.intake.take_image(topic, message)
        self.collected, self.last_image, self.last_ns = self.collected + 1, time.monotonic(), stamp_ns(message)
        self.first_ns = self.first_ns if self.collected > 1 else self.last_ns
        if self.intake.full:
            self.get_logger().warning(f"the clip ends here: {self.collected} images are what max_frames and max_mib allow")
            self._finish()

    def _on_beside(self, topic: str, message: Any) -> None:
        if not self.closed:
            (self.intake.take_depth if topic == "depth" else self.intake.take_mask)(message)

    def _on_info(self, message: Any) -> None:
        self.intake.take_info(message, fov_known=lambda: self.get_parameter("camera.fov_deg").value is not None)

    def _on_tree(self, tree: Any) -> None:
        for link in tree.transforms:
            self.intake.take_link(link)

    def _look_for_silence(self) -> None:
        if not self.closed and self.last_image is not None and time.monotonic() - self.last_image > self.silence_s:
            self._finish()

    def _finish(self) -> None:
        settings = self.parameters.settings()
        self.start(partial(_assemble, self.intake.closed(), settings))

    def _read_or_play(self) -> None:
        """Read the clip of the bag, or play it and hear what is played as if a camera sent it."""
        part = Part(bounded(self.parameters, "rate", 0.0, MAX_RATE), bool(self.parameters["loop"]), *(bounded(self.parameters, n, 0.0, MAX_PART_S) for n in ("start", "duration")))
        if not part.rate:
            self.start(self._read_job(part))
            return
        path, settings = Path(self.parameters["bag"]), self.parameters.settings()
        roles = inputs(path, settings.topics)
        for link in static_links(path):
            self.intake.take_link(link)

        def hear(topic: str, kind: str, raw: bytes) -> None:
            if topic not in roles:
                return
            try:
                message = deserialize_message(raw, message_class(kind))
            except Exception as error:
                raise InputError(f"topic {topic}: a message that cannot be read; record it again") from error
            self._hear(roles[topic], topic, message)

        self.player = Player(self, path, part, hear=self.net.around(hear, "bag"), ended=self._on_played)
        self.player.start()

    def _hear(self, role: str, topic: str, message: Any) -> None:
        if role.startswith("image"):
            self._on_image(topic, message)
        elif role == "camera_info":
            self._on_info(message)
        else:
            self._on_beside(role, message)

    def _on_played(self, again: bool) -> None:
        self.get_logger().info("the recording ends here" + ("; it is played again" if again else ""))
        if self.collected and not self.closed:
            self._finish()
        elif not self.closed:
            self.closed, self.state = True, FAILED
            self.on_failed(f"{shown(self.parameters['bag'])}: no image was played; choose another start and duration")

    def _read_job(self, part: Part) -> Job:
        bag, settings = self.parameters["bag"], self.parameters.settings()

        def read() -> Generator[None, None, tuple[Clip, np.ndarray, None]]:
            yield
            clip = read_clip(bag, settings, start_s=part.start_s, duration_s=part.duration_s or None)
            return clip, slot_stamps(clip), None

        return read

    def _frequency(self) -> float | None:
        span = self.last_ns - self.first_ns
        return 1e9 * (self.collected - 1) / span if span > 0 else None

    def _on_end(self, request: Any, response: Any) -> Any:
        response.success = bool(self.collected) and not self.closed
        response.message = f"clip of {self.collected} images closed" if response.success else "there is no open clip; call ~/reset to begin one"
        if response.success:
            self._finish()
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        response.success = not self.worker.busy and not (self.parameters["bag"] and self.player is None)
        response.message = "collecting" if response.success else "busy, or reading a bag; start the node again"
        if response.success:
            self.clear()
            self.state = "waiting"
        return response


def _assemble(intake: Intake, settings: config.Settings) -> Generator[None, None, tuple[Clip, np.ndarray, dict[str, Any] | None]]:
    """The clip of raw messages, its stamps, and the camera's pose as it was received where it is a single transform."""
    yield
    clip, received = clip_of(intake, settings)
    return clip, slot_stamps(clip, received), _single(intake.links, clip.camera.frame_id)


def _single(links: dict[str, Any], frame_id: str) -> dict[str, Any] | None:
    """The camera's transform as a plain message where it is the whole chain; a product of several has no exact quaternion."""
    link = links.get(frame_id)
    if link is None or link.header.frame_id in links:
        return None
    t, r = link.transform.translation, link.transform.rotation
    return {
        "header": messages.header(stamp_ns(link), link.header.frame_id),
        "child_frame_id": link.child_frame_id,
        "transform": {"translation": {"x": t.x, "y": t.y, "z": t.z}, "rotation": {"x": r.x, "y": r.y, "z": r.z, "w": r.w}},
    }
