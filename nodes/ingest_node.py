"""ingest_node: raw camera topics or a bag in, a clean clip out."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.bags.assemble import assemble
from diffphys_ros.bags.read import decoded, edge, nearest, read_clip, seen_through
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Clip

from .clip_stage import CLIP
from .clip_topics import clip_messages, labels_of, slot_stamps
from .convert import stamp_ns
from .parameters import Own, existing
from .qos import RELIABILITY, latched, sensor
from .stage import StageNode
from .worker import Job

BAG = Own("bag", "", "recording to read instead of topics: MCAP file, rosbag2 folder, video or image folder")
OWN = (
    BAG,
    Own("reliability", "best_effort", "of the raw inputs", tuple(RELIABILITY)),
    Own("silence_s", 2.0, "the clip ends after this long without an image [s]"),
    Own("max_frames", 1200, "the clip ends after this many images; bounds the memory"),
)
SOURCE = "raw topics"
REPLAY_JUMP_NS = 10**9  # stamps that go back by more are a bag that starts over


class IngestNode(StageNode):
    """Collects raw images until they stop, or ~/end is called, and publishes one clip; ~/reset begins another."""

    def __init__(self) -> None:
        super().__init__("ingest_node", OWN, CLIP)
        self.clear()
        self.create_service(Trigger, "~/end", self._on_end)
        self.create_service(Trigger, "~/reset", self._on_reset)
        if existing(self.parameters["bag"]):
            self.start(self._read_job())
        else:
            self._subscribe()

    def clear(self) -> None:
        """Begin to collect."""
        self.images: list[tuple[str, Any]] = []  # topic, message
        self.depths: list[Any] = []
        self.masks: list[Any] = []
        self.info: Any = None
        self.links: dict[str, Any] = {}  # TransformStamped by child frame
        self.closed, self.ignored = False, 0

    def start(self, job: Job) -> None:
        """Close the clip and make it in the worker's thread."""
        self.closed = True
        self.worker.start(job)
        self.state = "working"

    def waiting_for(self) -> str:
        if self.closed:
            return ""
        return "image or image/compressed" if not self.images else "camera_info" if self.info is None else "the end of the clip"

    def health(self) -> dict[str, Any]:
        return {"frames": len(self.images), "frequency_hz": self._frequency(), "dropped": self.ignored}

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

    def _subscribe(self) -> None:
        qos = sensor(self.parameters["reliability"])
        for topic, kind in (("image", Image), ("image/compressed", CompressedImage)):
            self.create_subscription(kind, topic, partial(self._on_image, topic), qos)
        for beside in ("depth", "mask"):
            self.create_subscription(Image, beside, partial(self._on_beside, beside), qos)
        self.create_subscription(CameraInfo, "camera_info", self._on_info, qos)
        self.create_subscription(TransformStamped, "camera_pose", self._on_link, latched())
        try:
            from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
        except ImportError:
            pass  # an installation without tf2_msgs has camera_pose
        else:
            self.create_subscription(TFMessage, "/tf_static", self._on_tree, latched())
        self.create_timer(0.1, self._look_for_silence)

    def _on_image(self, topic: str, message: Any) -> None:
        self.note_input()
        if self.closed or (self.images and self.images[0][0] != topic):
            self.ignored += 1
            return
        if self.images and stamp_ns(self.images[-1][1]) - stamp_ns(message) > REPLAY_JUMP_NS:
            self.get_logger().info("stamps jumped back; the clip ends here")
            self._finish()
            return
        self.images.append((topic, message))
        if len(self.images) >= self.parameters["max_frames"]:
            self._finish()

    def _on_beside(self, topic: str, message: Any) -> None:
        if not self.closed:
            (self.depths if topic == "depth" else self.masks).append(message)

    def _on_info(self, message: Any) -> None:
        self.info = self.info or message

    def _on_tree(self, tree: Any) -> None:
        for link in tree.transforms:
            self._on_link(link)

    def _on_link(self, link: Any) -> None:
        self.links[link.child_frame_id] = link

    def _look_for_silence(self) -> None:
        if not self.closed and self.images and self.last_input and time.monotonic() - self.last_input > self.parameters["silence_s"]:
            self._finish()

    def _finish(self) -> None:
        settings = self.parameters.settings()
        self.start(partial(_assemble, self.images, self.depths, self.masks, self.info, dict(self.links), settings))

    def _read_job(self) -> Job:
        bag, settings = self.parameters["bag"], self.parameters.settings()

        def read() -> Generator[None, None, tuple[Clip, np.ndarray, None]]:
            yield
            clip = read_clip(bag, settings)
            return clip, slot_stamps(clip), None

        return read

    def _frequency(self) -> float | None:
        if len(self.images) < 2:
            return None
        span = stamp_ns(self.images[-1][1]) - stamp_ns(self.images[0][1])
        return 1e9 * (len(self.images) - 1) / span if span > 0 else None

    def _on_end(self, request: Any, response: Any) -> Any:
        response.success = bool(self.images) and not self.closed
        response.message = f"clip of {len(self.images)} images closed" if response.success else "there is no open clip; call ~/reset to begin one"
        if response.success:
            self._finish()
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        response.success = not self.worker.busy and not self.parameters["bag"]
        response.message = "collecting" if response.success else "busy, or reading a bag; start the node again"
        if response.success:
            self.clear()
            self.state = "waiting"
        return response


def _assemble(
    images: list[tuple[str, Any]], depths: list[Any], masks: list[Any], info: Any, links: dict[str, Any], settings: config.Settings
) -> Generator[None, None, tuple[Clip, np.ndarray, dict[str, Any] | None]]:
    """The clip of raw messages, its stamps, and the camera's pose as it was received where it is a single transform."""
    yield
    topic, first = images[0]
    frames = [(stamp_ns(m), decoded(m, SOURCE, topic)) for _, m in images]
    metres = [] if settings.topics.depth == "none" else [(stamp_ns(m), decoded(m, SOURCE, "depth")) for m in depths]
    view = (frames[0][1].shape[1], frames[0][1].shape[0], first.header.frame_id)
    edges = dict(edge(link) for link in links.values())
    camera, undistort, notes = seen_through(info, edges, settings, view, SOURCE, image_topic=topic, info_topic="camera_info")
    mask = nearest([(stamp_ns(m), labels_of(m, "mask")) for m in masks], frames[0][0]) if masks else None
    if undistort:
        mask = None if mask is None else undistort(mask)
        frames, metres = ([(stamp, undistort(image)) for stamp, image in some] for some in (frames, metres))
    clip = replace(assemble(frames, metres, camera, SOURCE, notes=notes), first_labels=mask)
    return clip, slot_stamps(clip, np.array([stamp for stamp, _ in frames])), _single(links, camera.frame_id)


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
