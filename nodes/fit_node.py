"""fit_node: a bag, or the other nodes' clip, masks and splats in; stiffness and force fields out."""

from __future__ import annotations

import platform
import uuid
from collections.abc import Callable, Collection, Generator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.duration import Duration
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, fields, messages
from diffphys_ros.msg_schemas.recording import played, results
from diffphys_ros.msg_schemas.topics import PLAYED, RESULTS
from diffphys_ros.result import RECOVERY, check_writable
from diffphys_ros.splats.ply import to_raw
from diffphys_ros.types import Camera, Clip, Splats

from .child import steps
from .clip_buffer import ClipBuffer
from .clip_checks import in_world
from .clip_stage import ClipStage, assembled
from .convert import message_class, stamp_ns, to_ros
from .fit_job import OUT_FLAG, recover
from .parameters import Own, existing
from .playback import Playback
from .qos import profile
from .splat_topic import labels_crc_of, splats_of
from .tree import Tree
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
SPLATS, PROGRESS, QUALITY, SO_FAR = "splats", "~/progress", "~/quality", "~/force_so_far"
AT_ONCE = ("playback", "publish")  # groups of settings that hold for a result that is there
ACKNOWLEDGED_S = 5.0  # longest wait for subscribers before the process ends
MOST_SPLATS = 3  # clips of which Gaussians are kept: those of the next one may come before it
Steps = Generator[Any, None, list[str]]


class Gaussians(NamedTuple):
    """What came on `splats`."""

    splats: Splats
    labels_crc: int | None  # of the mask that they were fitted in, where that is known


class Published:
    """What the worker hands over when a recovery is there: every latched message, converted already."""

    def __init__(self, answer: fields.Answer) -> None:
        self.answer = answer
        self.messages = [(m.topic, to_ros(m.type_name, m.fields)) for m in results(answer)]


class FitNode(ClipStage):
    """Runs the inverse solver in a process of its own, latches the fields and plays the recovered motion."""

    def __init__(self) -> None:
        self.splats: dict[int, Gaussians] = {}  # by stamp of the clip that they belong to [ns]
        self.playback: Playback | None = None
        self.loss: float | None = None
        self.run = ""  # name of the fit that runs, or ran last
        self.begun_with: Any = None  # what it was begun with
        super().__init__("fit_node", OWN, (PROGRESS, SO_FAR, *RESULTS, *PLAYED), masks=True)
        self.tree = Tree(self)

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
        playing = self.playback is not None and self.playback.playing
        return super().health() | {"run": self.run, "loss": self.loss, "playing": playing, "net_force_reference": reference}

    def job(self) -> Job:
        settings, out, resume = self.parameters.settings(), self.parameters["out"], bool(self.parameters["resume"])
        source = Path(self.bag) if self.bag else self.buffer.copy()
        splats = None if self.bag or self.buffer.id is None else self.splats[self.buffer.id].splats
        return partial(_elsewhere, source, splats, settings, self.drawing(), out, resume, self.run, self.get_fully_qualified_name())

    def on_news(self, news: Any) -> None:
        if isinstance(news, Published):
            self._publish(news)
            return
        self.loss = news.loss if news.loss is not None else self.loss
        if news.force is not None:
            self.send(SO_FAR, fields.force_so_far(news.force, allow_assumed=self.parameters.settings().publish.allow_assumed_scale))
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
        self.send(PROGRESS, fields.progress(self.now_ns(), stage=self.state, text=reason, level=level, run=self.run, node=self.get_name()))
        if failed and self.playback is None:
            camera = "" if self.buffer.info is None else self.buffer.info.header.frame_id
            failed_of = {"run": self.run, "camera": camera, "hardware": camera or platform.node(), "node": self.get_name()}
            self.send(QUALITY, fields.failed_quality(self.now_ns(), reason, **failed_of))
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
        self.send(PROGRESS, fields.progress(self.now_ns(), text=text, run=self.run, node=self.get_name(), **news))

    def _publish(self, published: Published) -> None:
        self._latch(published)
        self._play(published.answer)
        self.get_logger().info(f"run {self.run}: fields published on {', '.join(map(self.resolve_topic_name, RESULTS))}")

    def _latch(self, published: Published) -> None:
        for name, message in published.messages:
            self.send(name, message)
        self.tree.announce(published.answer)

    def _play(self, answer: fields.Answer) -> None:
        if self.playback is not None:  # of the answer before nothing stays latched that this one does not carry, such as newtons
            carried = {message.topic for message in played(answer, 0)}
            self.advertise(*(name for name in PLAYED if name not in carried))
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
        found, clip = Gaussians(splats_of(message), labels_crc_of(message)), stamp_ns(message)
        before = self.splats.pop(clip, None)
        self.splats[clip] = found
        if len(self.splats) > MOST_SPLATS:
            del self.splats[next(iter(self.splats))]
        if self.complete and clip == self.buffer.id and not (before and _equal(before, found)):
            self.work_again("its Gaussians changed")
        self.begin()

    def _splats_missing(self) -> str:
        found = None if self.buffer.id is None else self.splats.get(self.buffer.id)
        if found is None:
            return f"{self.resolve_topic_name(SPLATS)} of this clip"
        known = found.labels_crc is None or not self.buffer.masks or found.labels_crc == self.buffer.first_labels_crc()
        return "" if known else f"{self.resolve_topic_name(SPLATS)} in the masks of this clip"

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

    def forget(self) -> None:
        self.splats = {}
        super().forget()

    def _reset(self, request: Any, response: Any) -> Any:
        self._stop_playback()
        self.begun_with = None
        self.advertise(SO_FAR, *RESULTS, *PLAYED)
        response = super()._reset(request, response)
        if self.bag:
            response.message = "forgotten; ~/fit reads the bag again"
            self.complete = True
        return response


def _equal(a: Gaussians, b: Gaussians) -> bool:
    return a.labels_crc == b.labels_crc and np.array_equal(to_raw(a.splats), to_raw(b.splats))


def _elsewhere(source: ClipBuffer | Path, splats: Any, settings: config.Settings, drawn: Callable[[config.Settings, Camera], config.Settings], *rest: Any) -> Steps:
    """The fit in a process of its own; what it publishes becomes messages here, beside the node's thread."""
    clip: Clip | Path
    if isinstance(source, Path):
        clip = source
    else:
        clip = in_world((yield from assembled(source)), settings)
        settings = drawn(settings, clip.camera)
    fit = steps(recover, clip, splats, settings, *rest)
    del source, clip
    with closing(fit):
        while True:
            try:
                news = next(fit)
            except StopIteration as stop:
                return list(stop.value)
            yield Published(news) if isinstance(news, fields.Answer) else news
            del news
