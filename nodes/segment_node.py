"""segment_node: clip in, part labels out; a click or a mask may say what the object is."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PointStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

from diffphys_ros.types import Camera

from .child import steps
from .clicks import pixel_of, place_of
from .clip_buffer import MASK
from .clip_checks import check_labels, in_world, labels_of
from .clip_stage import ClipStage, assembled
from .clip_topics import mask_messages, slot_stamps
from .parameters import Own
from .segment_job import label
from .worker import Job

if TYPE_CHECKING:
    from diffphys_ros.segment import Mark

CLICK, FIRST_MASK = "click", "first_mask"
OWN = (Own("wait_for", "", "what to wait for before a clip is labelled, beside the clip itself: click, first_mask; empty: nothing", ("", CLICK, FIRST_MASK)),)


class SegmentNode(ClipStage):
    """Publishes clip/mask, one mono8 label image per frame, when the clip is complete; again when a click or a mask comes later."""

    def __init__(self) -> None:
        self.told: dict[str, Any] = {}  # the latest click and mask
        self.wait_for = ""
        super().__init__("segment_node", OWN, publishes=[MASK], masks=False)

    def configure(self) -> None:
        super().configure()
        self.wait_for = self.parameters["wait_for"]
        self.names = {what: self.resolve_topic_name(what) for what in (CLICK, FIRST_MASK)}

    def activate(self) -> None:
        super().activate()
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self.create_subscription(PointStamped, CLICK, lambda message: self.tell(CLICK, message), reliable)
        self.create_subscription(Image, FIRST_MASK, lambda message: self.tell(FIRST_MASK, message), reliable)

    def tell(self, what: str, message: Any) -> None:
        """A person, or another node, says what the object in frame 0 is; the last word counts."""
        self.note_input()
        if what == FIRST_MASK:
            check_labels(message, self.names[what])
        else:
            place_of(message, self.names[what])
        self.told = {what: message}
        self.work_again(f"{what} came")
        self.begin()

    def waiting_for(self) -> str:
        wanted = self.wait_for
        return super().waiting_for() or (self.names[wanted] if wanted and wanted not in self.told and not self.complete else "")

    def renew(self) -> None:
        super().renew()
        self.told = {}

    def job(self) -> Job:
        buffer, settings, told, drawn = self.buffer.copy(), self.parameters.settings(), dict(self.told), self.drawing()

        def labelled() -> Generator[Any, None, list[Any]]:
            from diffphys_ros.depth import placed

            clip = in_world((yield from assembled(buffer)), settings)
            told_here = drawn(settings, clip.camera)
            clip = placed(clip, told_here)
            labels = yield from steps(label, clip, told_here, mark_of(told, clip.camera, self.names))
            return list(mask_messages(clip.with_labels(labels), slot_stamps(clip, buffer.stamps())))

        return labelled

    def on_news(self, news: str) -> None:
        self.get_logger().info(news)

    def on_done(self, masks: list[Any]) -> None:
        self.advertise(MASK)
        for name, fields in masks:
            self.send(name, fields)
        self.get_logger().info(f"published {len(masks)} label images")


def mark_of(told: Mapping[str, Any], camera: Camera, names: Mapping[str, str]) -> Mark:
    """What the messages of CLICK and FIRST_MASK mark in frame 0; either may be missing. Raises InputError with the topic's resolved name."""
    from diffphys_ros.segment import Mark

    return Mark(
        point=pixel_of(told[CLICK], camera, names[CLICK]) if CLICK in told else None,
        labels=labels_of(told[FIRST_MASK], names[FIRST_MASK]) if FIRST_MASK in told else None,
    )
