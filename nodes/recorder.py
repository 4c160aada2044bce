"""When a clip begins and ends, on a camera that need not stop: the state between single images and clips."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diffphys_ros.bags.thumbnail import thumbnail

from .convert import stamp_ns
from .intake import Intake
from .motion import LEAST_REST, LEAST_TAIL, Watch

ALWAYS, MANUAL, MOTION = "always", "manual", "motion"
PAUSE = "the images stopped"
FULL = "it is as large as max_frames and max_mib allow"
REPLAY_JUMP_NS = 10**9  # stamps that go back by more are a bag that starts over
REST_S = 1.0  # kept before the motion that opens a clip
STILL_S = 1.0  # without motion, after which a clip that motion opened ends
Closed = Callable[[Intake, str], None]


class Recorder:
    """Keeps a ring of `seconds` of images; from what opens a clip to what ends it, all of them.

    `always`: the first image opens a clip. What comes after one that did not end by silence is no clip of its own, it goes to the ring.
    `manual`: record() opens it. `motion`: what moves opens it, REST_S earlier; it ends when nothing has moved for STILL_S.
    With the last two a clip lasts `seconds` at most. `closed` is called with every clip and why it ended, `warn` with what is wrong with one.
    """

    def __init__(self, intake: Intake, trigger: str, seconds: float, closed: Closed, warn: Callable[[str], None]) -> None:
        self.intake, self.trigger, self.seconds = intake, trigger, seconds
        self.watch, self.recording, self.armed = Watch(), False, trigger != MANUAL
        self.fault = ""  # why the open clip, or the last one, cannot be identified
        self._closed, self._warn = closed, warn
        self.intake.one_mask = False

    def change(self, trigger: str, seconds: float) -> None:
        """Another trigger or length from here on; a clip that is open goes on."""
        if trigger != self.trigger:
            self.trigger, self.armed = trigger, trigger != MANUAL
        self.seconds = seconds

    def take(self, topic: str, message: Any) -> None:
        """An image. Raises InputError for one that can be part of no clip."""
        if self.intake.images and self.intake.images[-1].stamp - stamp_ns(message) > REPLAY_JUMP_NS:
            self._start_over()
        self.intake.take_image(topic, message)
        if self.intake.images[-1].message is message:
            self.watch.look(self.intake.images[-1].stamp, thumbnail(message))
        if self.recording:
            self._look_at_rest()
            self._end_where_due()
        elif self.armed and (self.trigger == ALWAYS or (self.trigger == MOTION and self.watch.moving)):
            self._open()
        else:
            self.intake.keep_latest(self.seconds)
            self.watch.forget_before(self.intake.images[0].stamp)

    def record(self) -> None:
        """Open a clip that begins with the next image."""
        self._forget()
        self._begin()

    def end(self, why: str) -> bool:
        """Close the open clip, or make one of the ring; whether there was anything."""
        if len(self.intake.images) < 2:
            return False
        self._close(why)
        return True

    def silence(self) -> None:
        """No image has come for a while."""
        if self.recording and not self.end(PAUSE):
            self._warn(f"a clip has 2 images or more, {len(self.intake.images)} came before the images stopped; it is dropped")
            self._stop()
        self._forget()
        self.armed = self.trigger != MANUAL

    def reset(self) -> None:
        """Forget the images; the next one may open a clip."""
        self._forget()
        self._stop()
        self.armed, self.fault = self.trigger != MANUAL, ""

    def health(self) -> dict[str, Any]:
        """For /diagnostics."""
        rest, tail = self.watch.rest(), self.watch.tail()
        return {"recording": self.recording, "ring_s": self.intake.span_s, "rest_frames": rest, "tail_frames": tail, "clip_warning": self.warning()}

    def warning(self) -> str:
        """What the clip, if it ended now, would lack for an identification."""
        if not self.recording or self.watch.rest() is None:
            return self.fault
        tail = self.watch.tail() or 0
        return self.fault or (_short_tail(tail) if tail < LEAST_TAIL else "")

    def _open(self) -> None:
        if self.trigger == MOTION:
            began = self.watch.motion_began() - round(REST_S * 1e9)
            self.intake.forget_before(began)
            self.watch.forget_before(self.intake.images[0].stamp)
        self._begin()
        self._look_at_rest()

    def _begin(self) -> None:
        self.recording, self.fault, self.intake.one_mask = True, "", True

    def _stop(self) -> None:
        self.recording = self.intake.one_mask = False

    def _forget(self) -> None:
        self.intake.begin()
        self.watch.clear()

    def _start_over(self) -> None:
        """The stamps jumped back."""
        if not (self.recording and self.end("its stamps jumped back")):
            self._forget()

    def _end_where_due(self) -> None:
        if self.trigger != ALWAYS and self.intake.span_s >= self.seconds:
            self._close("it is as long as clip.seconds allows")
        elif self.trigger == MOTION and self.watch.still_s() >= STILL_S:
            self._close("nothing moves any more")
        elif self.intake.full:
            self._close(FULL)

    def _close(self, why: str) -> None:
        tail = self.watch.tail()
        if tail is not None and tail < LEAST_TAIL:
            self._doubt(_short_tail(tail))
        elif tail is None and self.trigger != ALWAYS:
            self._doubt("nothing moves in this clip; push the object while it is recorded")
        clip = self.intake.closed()
        self._forget()
        self._stop()
        self.armed = self.trigger == MOTION
        self._closed(clip, why)

    def _look_at_rest(self) -> None:
        rest = self.watch.rest()
        if not self.fault and rest is not None and rest < LEAST_REST:
            self._doubt(f"the object moves {rest} frames after the clip began, needs {LEAST_REST} of rest; let it come to rest, record, then push (a plain object that swings freely needs none)")

    def _doubt(self, fault: str) -> None:
        if fault != self.fault:
            self.fault = fault
            self._warn(fault)


def _short_tail(frames: int) -> str:
    return f"{frames} frames follow the strongest motion, needs {LEAST_TAIL} of free swing; go on recording while it swings"
