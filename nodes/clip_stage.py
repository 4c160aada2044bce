"""A stage that listens to a clip on clip/* and works once it is complete."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from diffphys_ros.config import Settings
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.types import Camera, Clip

from .clicks import LINES, POINT, Drawn, place_of
from .clip_buffer import DEPTH, END, FIRST_MASK, GRAVITY, IMAGE, INFO, MASK, POSE, ClipBuffer
from .convert import message_class
from .limits import MAX_MIB, max_bytes
from .memory import give_back
from .parameters import Own
from .qos import profile
from .stage import StageNode
from .worker import DONE, FAILED, NEWS, Event, Job

CLIP = (INFO, POSE, GRAVITY, FIRST_MASK, IMAGE, DEPTH, END)
CLIP_DONE = "clip/done"


class Assembled(NamedTuple):
    """News of a job: the clip that it made of the buffer's images, which need not be kept twice."""

    of: tuple[int | None, int | None]  # first stamp, and when it was sent [ns]
    clip: Clip


def assembled(buffer: ClipBuffer, frames: int | None = None) -> Generator[Any, None, Clip]:
    """The clip of a job's own copy of the buffer, in memory that its process can share, or its first `frames`; lets the messages go.
    Raises InputError."""
    clip = buffer.clip()
    if frames is not None:
        cut = {name: getattr(clip, name)[:frames].copy() for name in ("frames", "depth", "labels", "observed") if getattr(clip, name) is not None}
        clip = replace(clip, **cut)
    buffer.settle(clip)
    yield Assembled((buffer.id, buffer.opened_ns), clip)
    return clip


class ClipStage(StageNode):
    """Buffers a clip; starts `job` when nothing is missing, and again when what it worked on was replaced.

    Another clip begins with its camera_info; ~/reset forgets everything. How a clip ended is said on clip/done.
    """

    def __init__(self, name: str, own: Sequence[Own] = (), publishes: Sequence[str] = (), *, masks: bool, first_alone: bool = False) -> None:
        self.drawn = Drawn()
        self.first_alone = first_alone  # of a clip's frames
        self.masks, self.complete, self.pending, self.listens = masks, False, False, False
        self.buffer = ClipBuffer()
        self.outdated = False  # the job at work is of no use any more: nothing that it still says counts
        self.at_work: int | None = None  # the clip of the latest job
        self.clips_dropped, self.reason = 0, ""  # why the latest job that ended badly did
        super().__init__(name, (MAX_MIB, *own), publishes)

    def configure(self) -> None:
        names = {topic: self.resolve_topic_name(topic) for topic in (*CLIP, MASK)}
        self.buffer = ClipBuffer(max_bytes(self.parameters), self.first_alone, names)
        self.create_service(Trigger, "~/reset", self._reset)

    def activate(self) -> None:
        self.listen()

    def on_deactivated(self) -> None:
        super().on_deactivated()
        self.listens = False

    def on_cleaned(self) -> None:
        super().on_cleaned()
        self.forget()

    def listen(self) -> None:
        """Subscribe to the clip."""
        self.listens = True
        self.advertise(CLIP_DONE)
        for topic in (*CLIP, MASK) if self.masks else CLIP:
            row = TOPICS[topic]
            self.create_subscription(message_class(row.type_name), topic, partial(self._heard, topic), profile(row))
        reliable = QoSProfile(depth=2, reliability=ReliabilityPolicy.RELIABLE)
        for topic in LINES:
            self.create_subscription(message_class(POINT), topic, partial(self.draw, topic), reliable)

    def draw(self, topic: str, click: Any) -> None:
        """A person clicks an end of a line; when it is whole, the work on the clip begins again. Raises InputError for a point that is none."""
        self.note_input()
        place_of(click, self.resolve_topic_name(topic))
        before, self.drawn = self.drawn.whole, self.drawn.clicked(topic, click)
        if self.drawn.whole != before:
            self.work_again(f"{topic} came")
            self.begin()

    def drawing(self) -> Callable[[Settings, Camera], Settings]:
        """Puts the lines that were drawn in the clip of a job that begins now onto settings, for its camera."""
        return partial(self.drawn.on, names={topic: self.resolve_topic_name(topic) for topic in LINES})

    def _heard(self, topic: str, message: Any, about: Mapping[str, Any]) -> None:
        self.take(topic, message, about.get("source_timestamp") or None)

    def take(self, topic: str, message: Any, sent_ns: int | None = None) -> None:
        """Store a message; begin the job when it was the last one missing. Raises InputError for one that can be part of no clip."""
        self.note_input()
        before = (self.buffer.id, self._unfinished()) if topic == INFO else (None, "")
        mask_set = self.buffer.mask_set
        if self.buffer.take(topic, message, sent_ns):
            self._say_dropped(*before)
            self.renew()
        elif self.masks and self.complete and self.buffer.mask_set != mask_set:
            self.work_again("its masks changed")
        self.begin()

    def renew(self) -> None:
        """Another clip comes in the place of the one before."""
        self.complete = self.pending = False
        self.drawn = Drawn()

    def work_again(self, why: str) -> None:
        """What was told of the buffered clip changed: what was made of it is outdated."""
        self.complete = self.pending = False
        if self.worker.busy and self.at_work == self.buffer.id and not self.outdated:
            self.get_logger().info(f"{said(self.buffer.id)}: {why}; the work on it begins again")
            self.outdated = True
            self.worker.cancel()

    def begin(self) -> None:
        """Begin the job where the clip is complete and no job was begun for it; after the job that runs, where one does."""
        if self.complete or self.waiting_for():
            return
        self.complete = True
        if not self.worker.busy:
            self._start()
            return
        self.pending = True
        if not self.outdated:
            self.get_logger().warning("a new clip came while the last one is worked on; it is next")

    def _start(self) -> bool:
        """Begin a job; false where one runs."""
        if not self.worker.start(self.job()):
            return False
        self.complete, self.pending, self.outdated, self.state = True, False, False, "working"
        self.at_work = self.buffer.id
        return True

    def _handle(self, event: Event) -> None:
        if isinstance(event.value, Assembled):
            if event.value.of == (self.buffer.id, self.buffer.opened_ns):
                self.buffer.settle(event.value.clip)
            give_back()
        elif not self.outdated:
            super()._handle(event)
        elif event.kind != NEWS:
            self.outdated, self.state = False, "waiting"
            self._go_on()

    def on_idle(self) -> None:
        level = messages.OK if self.state == DONE else messages.ERROR if self.state == FAILED else messages.WARN
        give_back()
        self.end_with(self.at_work, level, self.state if self.state == DONE else self.reason)
        self._go_on()

    def _go_on(self) -> None:
        if self.pending:
            self._start()

    def end_with(self, clip: int | None, level: int, how: str) -> None:
        """Say that this stage is done with a clip, so that who sends clips sends the next."""
        if self.listens and clip is not None:
            status = messages.status(self.get_fully_qualified_name(), {"clip": clip}, level=level, message=how)
            self.send(CLIP_DONE, messages.diagnostics(clip, [status]))

    def job(self) -> Job:
        """What to do with the complete buffer, in the worker's thread."""
        raise NotImplementedError

    def forget(self) -> None:
        """Drop the buffered clip; what a running job still says counts no more."""
        self.renew()
        self.outdated = self.worker.busy
        self.buffer = ClipBuffer(self.buffer.max_bytes, self.buffer.first_alone, self.buffer.names)
        give_back()

    def waiting_for(self) -> str:
        return self.buffer.missing(masks=self.masks) if self.listens and not self.complete else ""

    def health(self) -> dict[str, Any]:
        return {"clip": self.buffer.id, "clips_dropped": self.clips_dropped, "of_no_clip": self.buffer.strangers()}

    def on_failed(self, reason: str) -> None:
        self.reason = reason
        super().on_failed(reason)

    def _unfinished(self) -> str:
        """Why the buffered clip was not worked on; empty where it was, or there is none."""
        if self.buffer.id is None or (self.complete and not self.pending):
            return ""
        return "another one was worked on" if self.pending else f"it still lacked {self.waiting_for()}"

    def _say_dropped(self, clip: int | None, why: str) -> None:
        if why and clip != self.buffer.id:
            self.clips_dropped += 1
            self.get_logger().warning(f"{said(clip)} is dropped for the next one, {why}; {self.clips_dropped} dropped so far")
            self.end_with(clip, messages.WARN, "dropped")

    def _reset(self, request: Any, response: Any) -> Any:
        clip = self.buffer.id
        self.worker.cancel()
        self.forget()
        self.state = "waiting"
        self.end_with(clip, messages.WARN, "forgotten")
        response.success, response.message = True, "forgotten; waiting for a clip"
        return response


def said(clip: int | None) -> str:
    """A clip by its first stamp, for people."""
    return "no clip" if clip is None else f"the clip of {clip // 10**9}.{clip % 10**9:09d} s"
