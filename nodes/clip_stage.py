"""A stage that listens to a clip on clip/* and works once it is complete."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from std_srvs.srv import Trigger

from diffphys_ros.msg_schemas import TOPICS

from .clip_topics import ClipBuffer
from .convert import message_class, stamp_ns
from .parameters import Own
from .qos import profile
from .stage import StageNode
from .worker import Job

CLIP = ("clip/camera_info", "clip/camera_pose", "clip/first_mask", "clip/image", "clip/depth", "clip/end")
MASK = "clip/mask"


class ClipStage(StageNode):
    """Buffers a clip; starts `job` when nothing is missing. Another clip begins with the next image; ~/reset forgets everything."""

    def __init__(self, name: str, own: Sequence[Own] = (), publishes: Sequence[str] = (), *, masks: bool, listens: bool = True) -> None:
        super().__init__(name, own, publishes)
        self.buffer = ClipBuffer()
        self.masks, self.complete, self.listens = masks, False, False
        if listens:
            self.listen()
        self.create_service(Trigger, "~/reset", self._reset)

    def listen(self) -> None:
        """Subscribe to the clip."""
        self.listens = True
        for topic in (*CLIP, MASK) if self.masks else CLIP:
            row = TOPICS[topic]
            self.create_subscription(message_class(row.type_name), topic, partial(self.take, topic), profile(row))

    def take(self, topic: str, message: Any) -> None:
        """Store a message; begin the job when it was the last one missing."""
        self.note_input()
        if self.complete and topic == "clip/image" and stamp_ns(message) not in self.buffer.images:
            self.forget()
        self.buffer.take(topic, message)
        self.begin()

    def begin(self) -> None:
        """Begin the job where the clip is complete and no job was begun for it."""
        if self.complete or self.waiting_for():
            return
        self.complete = True
        if self.worker.start(self.job()):
            self.state = "working"
        else:
            self.get_logger().warning("a new clip came while the last one is worked on; call ~/reset, or ~/fit when that is done")

    def job(self) -> Job:
        """What to do with the complete buffer, in the worker's thread."""
        raise NotImplementedError

    def forget(self) -> None:
        """Drop the buffered clip; a running job and its result stay."""
        self.buffer, self.complete = ClipBuffer(), False

    def waiting_for(self) -> str:
        return self.buffer.missing(masks=self.masks) if self.listens and not self.complete else ""

    def on_failed(self, reason: str) -> None:
        self.get_logger().error(reason)

    def _reset(self, request: Any, response: Any) -> Any:
        self.worker.cancel()
        self.forget()
        self.state = "waiting"
        response.success, response.message = True, "forgotten; waiting for a clip"
        return response
