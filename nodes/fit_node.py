"""fit_node: a bag, or the other nodes' clip, masks and splats in; stiffness and force fields out."""

from __future__ import annotations

import platform
import uuid
from collections.abc import Callable, Collection, Generator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, fields, messages
from diffphys_ros.msg_schemas.recording import results
from diffphys_ros.msg_schemas.topics import PLAYED, RESULTS, relative
from diffphys_ros.result import RECOVERY, check_writable
from diffphys_ros.types import Clip

from .child import steps
from .clip_stage import ClipStage
from .convert import message_class, stamp_ns, to_ros
from .fit_job import OUT_FLAG, recover
from .parameters import Own, existing
from .playback import Playback
from .qos import profile
from .splat_topic import splats_of
from .worker import FAILED, Job


def writable(folder: str) -> None:
    """Raises InputError where a folder is named and nothing can be written in it."""
    try:
        if folder:
            check_writable(folder)
    except InputError as error:
        raise InputError(f"parameter out: {str(error).replace(OUT_FLAG, '')}") from error


OWN = (
    Own("bag", "", "recording to recover from instead of topics: MCAP file, rosbag2 folder, video or image folder", fixed=False, check=existing),
    Own("out", "", "folder for recovery.npz, recovery.mcap, recovery.rrd and figures; empty: none are written", fixed=False, check=writable),
    Own("resume", False, "go on from the checkpoint of an interrupted fit in `out`, where there is one", fixed=False),
    Own("exit_when_done", False, "end the process when the result is published and written: status 0; 1 where the fit failed or was cancelled", fixed=False),
)
SPLATS, PROGRESS, QUALITY = "splats", "~/progress", "~/quality"
AT_ONCE = ("playback", "publish")  # groups of settings that hold for a result that is there
ACKNOWLEDGED_S = 5.0  # longest wait for subscribers before the process ends
Steps = Generator[Any, None, list[str]]


class Published:
    """What the worker hands over when a recovery is there: every latched message, converted already."""

    def __init__(self, answer: fields.Answer) -> None:
        self.answer = answer
        self.messages = [(relative(m.topic), to_ros(m.type_name, m.fields)) for m in results(answer)]


class FitNode(ClipStage):
    """Runs the inverse solver in a process of its own, latches the fields and plays the recovered motion."""

    def __init__(self) -> None:
        self.splats: Any = None
        self.splats_ns = 0  # stamp of the clip that they belong to; 0: of any
        self.playback: Playback | None = None
        self.loss: float | None = None
        self.run = ""  # name of the fit that runs, or ran last
        self.begun_with: Any = None  # what it was begun with
        super().__init__("fit_node", OWN, (PROGRESS, *RESULTS, *PLAYED), masks=True)

    def configure(self) -> None:
        super().configure()
        for name, answer in (("fit", self._on_fit), ("cancel", self._on_cancel)):
            self.create_service(Trigger, f"~/{name}", answer)

    def activate(self) -> None:
        if not self.bag:
            self.listen()
        elif not self._unchanged():
            self._start()

    def listen(self) -> None:
        super().listen()
        topic = TOPICS[SPLATS]
        self.create_subscription(message_class(topic.type_name), SPLATS, self._on_splats, profile(topic))

    @property
    def bag(self) -> str:
        """The recording to recover from; empty: topics."""
        return str(self.parameters["bag"])

    def waiting_for(self) -> str:
        if not self.listens or self.complete or self.bag:
            return ""
        return super().waiting_for() or self._splats_missing()

    def health(self) -> dict[str, Any]:
        reference = None if self.playback is None else self.playback.answer.reference_text
        return {"run": self.run, "loss": self.loss, "playing": self.playback is not None and self.playback.playing, "net_force_reference": reference}

    def job(self) -> Job:
        settings, out, resume = self.parameters.settings(), self.parameters["out"], bool(self.parameters["resume"])
        source: Callable[[], Clip | Path] = partial(Path, self.bag) if self.bag else self.buffer.copy().clip
        return partial(_elsewhere, source, None if self.bag else self.splats, settings, out, resume, self.run)

    def on_news(self, news: Any) -> None:
        if isinstance(news, Published):
            self._publish(news)
            return
        self.loss = news.loss if news.loss is not None else self.loss
        self._say(stage=news.stage, iteration=news.iteration, iterations=news.iterations, loss=news.loss, seconds_left=news.seconds_left, text=news.text)

    def on_done(self, left_out: list[str]) -> None:
        for sentence in left_out:
            self.get_logger().warning(sentence)
        self._say(stage="done", loss=self.loss, text=f"results in {self.parameters['out']}" if self.parameters["out"] else "fields are latched")
        self._exit(0)

    def on_failed(self, reason: str) -> None:
        failed, reason = self.state == FAILED, reason.replace(OUT_FLAG, " with the parameter out")
        super().on_failed(f"run {self.run}: {reason}")
        level = messages.ERROR if failed else messages.WARN
        self.send(PROGRESS, fields.progress(self.now_ns(), stage=self.state, text=reason, level=level, run=self.run))
        if failed and self.playback is None:
            camera = "" if self.buffer.info is None else self.buffer.info.header.frame_id
            self.send(QUALITY, fields.failed_quality(self.now_ns(), reason, run=self.run, camera=camera, hardware=camera or platform.node()))
        self.begun_with = None
        self._exit(1)

    def on_parameters(self, names: Collection[str]) -> Collection[str]:
        at_once = {name for name in names if name.partition(".")[0] in AT_ONCE}
        if at_once and self.playback is not None:
            answer = fields.limited(self.playback.answer, self.parameters.settings())
            if any(name.startswith("publish.") for name in at_once):
                self._latch(Published(answer))
            self._play(answer)
        if "bag" in names and not self.bag and self.active and not self.listens:
            self.listen()
        return {*at_once, "exit_when_done"}

    def on_deactivated(self) -> None:
        super().on_deactivated()
        if self.playback is not None:
            self.playback.pause()

    def on_cleaned(self) -> None:
        super().on_cleaned()
        self._stop_playback()
        self.begun_with = None

    def _say(self, *, text: str = "", **news: Any) -> None:
        if text:
            self.get_logger().info(f"{news['stage']}: {text}")
        self.send(PROGRESS, fields.progress(self.now_ns(), text=text, run=self.run, **news))

    def _publish(self, published: Published) -> None:
        self._latch(published)
        self._play(published.answer)
        self.get_logger().info(f"run {self.run}: fields published on {', '.join(map(self.resolve_topic_name, RESULTS))}")

    def _latch(self, published: Published) -> None:
        for name, message in published.messages:
            self.send(name, message)

    def _play(self, answer: fields.Answer) -> None:
        self._stop_playback()
        self.playback = Playback(self, answer, self.parameters.settings().playback)

    def _stop_playback(self) -> None:
        if self.playback is not None:
            self.playback.pause()
            self.playback = None

    def _poll(self) -> None:
        super()._poll()
        if self.playback is not None and self.active:
            self.playback.look()

    def _exit(self, status: int) -> None:
        if self.parameters["exit_when_done"]:
            self.acknowledged(*RESULTS, PROGRESS, within=Duration(seconds=ACKNOWLEDGED_S))
            self.exit_status = status

    def _start(self) -> bool:
        if self.worker.busy:
            return False
        self.run = uuid.uuid4().hex[:8]
        self.begun_with = self._given()
        if not super()._start():
            return False
        self.loss = None
        self._say(stage="start", text=f"run {self.run} begun")  # libraries take seconds, and what is latched is of the run before
        return True

    def _given(self) -> Any:
        """What a fit that begins now is of; equal where nothing has changed."""
        bag = existing(self.bag)
        stat = Path(bag).stat() if bag else None
        source = self.received if stat is None else (bag, stat.st_mtime_ns, stat.st_size)
        return source, config.flat(self.parameters.settings()), self.parameters["out"]

    def _unchanged(self) -> bool:
        out = self.parameters["out"]
        return self.state == "done" and self.begun_with == self._given() and (not out or Path(out, RECOVERY).exists())

    def _on_splats(self, message: Any) -> None:
        self.note_input()
        self.splats, self.splats_ns = splats_of(message), stamp_ns(message)
        self.begin()

    def _splats_missing(self) -> str:
        stamps = self.buffer.stamps()
        there = self.splats is not None and (not self.splats_ns or (len(stamps) > 0 and self.splats_ns == stamps[0]))
        return "" if there else f"{SPLATS} of this clip"

    def _on_fit(self, request: Any, response: Any) -> Any:
        missing = "" if self.bag else self.buffer.missing(masks=True) or self._splats_missing()
        if not self.active:
            response.message = f"the node is {self.lifecycle}; activate it first"
        elif missing:
            response.message = f"still waiting for {missing}"
        elif self.worker.busy:
            response.message = f"run {self.run} is running; call ~/cancel first"
        elif self._unchanged():
            response.success, response.message = True, f"run {self.run} stands: nothing has changed since; ~/reset forgets it"
        else:
            response.success = self._start()
            response.message = f"run {self.run} begun"
        return response

    def _on_cancel(self, request: Any, response: Any) -> Any:
        response.success = self.worker.busy
        self.worker.cancel()
        response.message = f"run {self.run} ends" if response.success else "no fit is running"
        return response

    def renew(self) -> None:
        self.splats = None
        super().renew()

    def _reset(self, request: Any, response: Any) -> Any:
        self._stop_playback()
        self.begun_with = None
        self.advertise(*RESULTS, *PLAYED)
        response = super()._reset(request, response)
        if self.bag:
            response.message = "forgotten; ~/fit reads the bag again"
            self.complete = True
        return response


def _elsewhere(source: Callable[[], Clip | Path], splats: Any, *rest: Any) -> Steps:
    """The fit in a process of its own; what it publishes becomes messages here, beside the node's thread."""
    fit = steps(recover, source(), splats, *rest)
    del source
    with closing(fit):
        while True:
            try:
                news = next(fit)
            except StopIteration as stop:
                return list(stop.value)
            yield Published(news) if isinstance(news, fields.Answer) else news
            del news
