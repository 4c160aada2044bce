"""ingest_node: raw camera topics or a bag in, a clean clip out."""

from __future__ import annotations

import time
from collections.abc import Generator
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.transforms import MOVING, STATIC
from diffphys_ros.bags.world import NotYetError
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Clip

from .beside import COLOUR_INFO, DEPTH_INFO, IMU, POSE, Beside
from .clip_stage import CLIP
from .clip_topics import clip_messages, slot_stamps
from .convert import stamp_ns
from .intake import DEPTH, PRESSED_DEPTH, Intake, clip_of, images_of
from .limits import MAX_FRAMES, MAX_MIB, bounded, max_bytes
from .parameters import Own, existing
from .qos import RELIABILITY, latched, moving, sensor
from .stage import StageNode
from .worker import Job

BAG = Own("bag", "", "recording to read instead of topics: MCAP file, rosbag2 folder, video or image folder")
OWN = (
    BAG,
    Own("reliability", "best_effort", "of the raw inputs", tuple(RELIABILITY)),
    Own("silence_s", 2.0, "the clip ends after this long without an image [s]"),
    Own("patience_s", 10.0, "how long a clip that has ended waits for the camera_info or the transform that it lacks [s]"),
    Own("max_frames", 1200, "the clip ends after this many images; bounds the memory"),
    MAX_MIB,
)
MAX_SILENCE_S = 3600.0
LOOK_AGAIN_S = 0.1
IMAGE, PRESSED, MASK = "image", "image/compressed", "mask"
REPLAY_JUMP_NS = 10**9  # stamps that go back by more are a bag that starts over


class IngestNode(StageNode):
    """Collects raw images until they stop, or ~/end is called, and publishes one clip; ~/reset begins another."""

    def __init__(self) -> None:
        super().__init__("ingest_node", OWN, CLIP)
        self.silence_s = bounded(self.parameters, "silence_s", 0.0, MAX_SILENCE_S)
        self.patience_s = bounded(self.parameters, "patience_s", 0.0, MAX_SILENCE_S)
        names = (IMAGE, PRESSED, DEPTH, PRESSED_DEPTH, MASK, COLOUR_INFO, DEPTH_INFO, POSE, IMU)
        beside = Beside({name: self.resolve_topic_name(name) for name in names})
        self.intake = Intake(int(bounded(self.parameters, "max_frames", 2, MAX_FRAMES)), max_bytes(self.parameters), beside)
        self.lacking = ""  # what a clip that ended waits for
        self.clear()
        self.create_service(Trigger, "~/end", self._on_end)
        self.create_service(Trigger, "~/reset", self._on_reset)
        if existing(self.parameters["bag"]):
            self.start(self._read_job())
        else:
            self._subscribe()

    @property
    def beside(self) -> Beside:
        """What is heard beside the images."""
        return self.intake.beside

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
        self.state, self.lacking = "working", ""

    def waiting_for(self) -> str:
        if self.closed:
            return self.lacking
        if not self.collected:
            return f"{self.beside.name(IMAGE)} or {self.beside.name(PRESSED)}"
        return "the end of the clip" if self.beside.infos(COLOUR_INFO) else self.beside.name(COLOUR_INFO)

    def health(self) -> dict[str, Any]:
        return {"frames": self.collected, "frequency_hz": self._frequency(), "dropped": self.ignored}

    def on_news(self, news: str) -> None:
        """The clip that ended cannot be made yet, or (empty) still not."""
        if not news:
            return
        self.lacking = news
        self.get_logger().warning(f"{news}; waiting for it for {self.patience_s:g} s")

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
        for topic, kind in ((IMAGE, Image), (PRESSED, CompressedImage)):
            self.create_subscription(kind, topic, partial(self._on_image, topic), qos)
        for topic, kind in ((DEPTH, Image), (PRESSED_DEPTH, CompressedImage), (MASK, Image)):
            self.create_subscription(kind, topic, partial(self._on_beside, topic), qos)
        for info in (COLOUR_INFO, DEPTH_INFO):
            self.create_subscription(CameraInfo, info, partial(self._on_info, topic=info), qos)
        self.create_subscription(Imu, IMU, self._on_imu, sensor("best_effort"))
        self.create_subscription(TransformStamped, POSE, self._on_pose, latched())
        try:
            from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
        except ImportError:
            self.get_logger().info(f"tf2_msgs is not installed: transforms come from {self.beside.name(POSE)} alone")
        else:
            for topic, profile in ((STATIC, latched()), (MOVING, moving())):
                self.create_subscription(TFMessage, topic, partial(self._on_tree, kind=topic), profile)
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
            (self.intake.take_mask if topic == MASK else self.intake.take_depth)(message)

    def _on_info(self, message: Any, topic: str = COLOUR_INFO) -> None:
        after_ns = self.last_ns if self.collected else 0
        self.beside.take_info(message, topic, after_ns=after_ns, fov_known=lambda: self.get_parameter("camera.fov_deg").value is not None)

    def _on_imu(self, message: Any) -> None:
        self.beside.take_imu(message)

    def _on_pose(self, link: Any) -> None:
        self.beside.take_link(link)

    def _on_tree(self, tree: Any, kind: str = STATIC) -> None:
        for link in tree.transforms:
            self.beside.take_link(link, kind)

    def _look_for_silence(self) -> None:
        if not self.closed and self.last_image is not None and time.monotonic() - self.last_image > self.silence_s:
            self._finish()

    def _finish(self) -> None:
        settings = self.parameters.settings()
        self.start(partial(_assemble, self.intake.closed(), settings, self.patience_s))

    def _read_job(self) -> Job:
        bag, settings = self.parameters["bag"], self.parameters.settings()

        def read() -> Generator[None, None, tuple[Clip, np.ndarray, None]]:
            yield
            clip = read_clip(bag, settings)
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
        response.success = not self.worker.busy and not self.parameters["bag"]
        response.message = "collecting" if response.success else "busy, or reading a bag; start the node again"
        if response.success:
            self.clear()
            self.state = "waiting"
        return response


def _assemble(intake: Intake, settings: config.Settings, patience_s: float) -> Generator[str, None, tuple[Clip, np.ndarray, dict[str, Any] | None]]:
    """The clip of raw messages, its stamps, and the camera's pose as it was received where it is a single transform. What it lacks may
    still come for a while, and is news."""
    yield ""
    until, said, images = time.monotonic() + patience_s, "", images_of(intake, settings)
    while True:
        try:
            clip, received = clip_of(intake, settings, images)
            return clip, slot_stamps(clip, received), _single(intake.beside, clip)
        except NotYetError as error:
            if time.monotonic() >= until:
                raise
            if str(error) != said:
                said = str(error)
                yield said
        time.sleep(LOOK_AGAIN_S)
        yield ""


def _single(beside: Beside, clip: Clip) -> dict[str, Any] | None:
    """The camera's transform as a plain message where it is the whole chain; a product of several has no exact quaternion."""
    link = beside.transforms.single(clip.camera.frame_id, clip.camera.world_frame_id)
    if link is None:
        return None
    t, r = link.transform.translation, link.transform.rotation
    return {
        "header": messages.header(stamp_ns(link), link.header.frame_id),
        "child_frame_id": link.child_frame_id,
        "transform": {"translation": {"x": t.x, "y": t.y, "z": t.z}, "rotation": {"x": r.x, "y": r.y, "z": r.z, "w": r.w}},
    }
