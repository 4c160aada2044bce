"""A stage that listens to a clip on clip/* and works once it is complete."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from std_srvs.srv import Trigger

from diffphys_ros.msg_schemas import TOPICS

from .clip_buffer import INFO, MASK, ClipBuffer
from .convert import message_class
from .limits import MAX_MIB, max_bytes
from .parameters import Own
from .qos import profile
from .stage import StageNode
from .worker import CANCELLED, Job

CLIP = (INFO, "clip/camera_pose", "clip/gravity", "clip/first_mask", "clip/image", "clip/depth", "clip/end")


class ClipStage(StageNode):
    """Buffers a clip; starts `job` when nothing is missing. Another clip begins with its camera_info; ~/reset forgets everything."""

    def __init__(self, name: str, own: Sequence[Own] = (), publishes: Sequence[str] = (), *, masks: bool, listens: bool = True) -> None:
        super().__init__(name, (MAX_MIB, *own), publishes)
        self.buffer = ClipBuffer(max_bytes(self.parameters))
        self.masks, self.complete, self.pending, self.listens = masks, False, False, False
        if listens:
            self.listen()
        self.create_service(Trigger, "~/reset", self._reset)

    def listen(self) -> None:
        """Subscribe to the clip."""
        self.listens = True
        for topic in (*CLIP, MASK) if self.masks else CLIP:
            row = TOPICS[topic]
            self.create_subscription(message_class(row.type_name), topic, partial(self._heard, topic), profile(row))

    def _heard(self, topic: str, message: Any, about: Mapping[str, Any]) -> None:
        self.take(topic, message, about.get("source_timestamp") or None)

    def take(self, topic: str, message: Any, sent_ns: int | None = None) -> None:
        """Store a message; begin the job when it was the last one missing. Raises InputError for one that can be part of no clip."""
        self.note_input()
        if self.buffer.take(topic, message, sent_ns):
            self.renew()
        self.begin()

    def renew(self) -> None:
        """Another clip comes in the place of the one before."""
        self.complete = self.pending = False

    def begin(self) -> None:
        """Begin the job where the clip is complete and no job was begun for it; after the job that runs, where one does."""
        if self.complete or self.waiting_for():
            return
        self.complete = True
        if self.worker.busy:
            self.pending = True
            self.get_logger().warning("a new clip came while the last one is worked on; it is next")
        else:
            self._start()

    def _start(self) -> bool:
        """Begin a job; false where one runs."""
        if not self.worker.start(self.job()):
            return False
        self.complete, self.pending, self.state = True, False, "working"
        return True

    def on_idle(self) -> None:
        if self.pending and self.state != CANCELLED:
            self._start()
        self.pending = False

    def job(self) -> Job:
        """What to do with the complete buffer, in the worker's thread."""
        raise NotImplementedError

    def forget(self) -> None:
        """Drop the buffered clip; a running job and its result stay."""
        self.renew()
        self.buffer = ClipBuffer(self.buffer.max_bytes)

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
