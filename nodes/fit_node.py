"""fit_node: a bag, or the other nodes' clip, masks and splats in; stiffness and force fields out."""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS, fields, messages
from diffphys_ros.msg_schemas.recording import results
from diffphys_ros.msg_schemas.topics import PLAYED, RESULTS, relative
from diffphys_ros.splats.ply import to_raw
from diffphys_ros.types import Splats

from .clip_buffer import ClipBuffer
from .clip_checks import in_world
from .clip_stage import ClipStage, assembled
from .convert import message_class, stamp_ns, to_ros
from .parameters import Own, existing
from .playback import Playback
from .qos import profile
from .splat_topic import labels_crc_of, splats_of
from .worker import FAILED, Job

if TYPE_CHECKING:
    from diffphys_ros.inverse import Checkpoint

OWN = (
    Own("bag", "", "recording to recover from instead of topics: MCAP file, rosbag2 folder, video or image folder"),
    Own("out", "", "folder for recovery.npz, recovery.mcap, recovery.rrd and figures; empty: none are written"),
    Own("resume", False, "go on from the checkpoint of an interrupted fit in `out`, where there is one"),
)
SPLATS, PROGRESS, QUALITY = "splats", "~/progress", "~/quality"
MOST_SPLATS = 3  # clips of which Gaussians are kept: those of the next one may come before it
Steps = Generator[Any, None, Any]


class Gaussians(NamedTuple):
    """What came on `splats`."""

    splats: Splats
    labels_crc: int | None  # of the mask that they were fitted in, where that is known


class Published:
    """What the worker hands over when a recovery is there: every latched message, converted already."""

    def __init__(self, answer: fields.Answer) -> None:
        self.answer = answer
        self.messages = [(relative(m.topic), to_ros(m.type_name, m.fields)) for m in results(answer)]


class FitNode(ClipStage):
    """Runs the inverse solver in one worker thread, latches the fields and plays the recovered motion."""

    def __init__(self) -> None:
        self.splats: dict[int, Gaussians] = {}  # by stamp of the clip that they belong to [ns]
        self.playback: Playback | None = None
        self.loss: float | None = None
        super().__init__("fit_node", OWN, (PROGRESS, *RESULTS, *PLAYED), masks=True, listens=False)
        self.bag = existing(self.parameters["bag"])
        for name, answer in (("fit", self._on_fit), ("cancel", self._on_cancel)):
            self.create_service(Trigger, f"~/{name}", answer)
        if self.parameters["out"]:
            from diffphys_ros.result import check_writable

            check_writable(self.parameters["out"])
        if self.bag:
            self._start()
        else:
            self.listen()
            topic = TOPICS[SPLATS]
            self.create_subscription(message_class(topic.type_name), SPLATS, self._on_splats, profile(topic))

    def waiting_for(self) -> str:
        if not self.listens or self.complete:
            return ""
        return super().waiting_for() or self._splats_missing()

    def health(self) -> dict[str, Any]:
        reference = None if self.playback is None else self.playback.answer.reference_text
        return super().health() | {"loss": self.loss, "playing": self.playback is not None, "net_force_reference": reference}

    def job(self) -> Job:
        settings, out, resume = self.parameters.settings(), self.parameters["out"], bool(self.parameters["resume"])
        if self.bag:
            return lambda: _recover(partial(_from_bag, self.bag, settings), settings, out, resume)
        return partial(_recover, partial(_from_topics, self.buffer.copy(), self.splats[self.buffer.id].splats, settings), settings, out, resume)

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

    def on_failed(self, reason: str) -> None:
        super().on_failed(reason)
        failed = self.state == FAILED
        self._say(stage=self.state, text=reason, level=messages.ERROR if failed else messages.WARN)
        if failed and self.playback is None:
            self.send(QUALITY, fields.failed_quality(self.now_ns(), reason))

    def _say(self, *, text: str = "", **news: Any) -> None:
        if text:
            self.get_logger().info(f"{news['stage']}: {text}")
        self.send(PROGRESS, fields.progress(self.now_ns(), text=text, **news))

    def _publish(self, published: Published) -> None:
        for name, message in published.messages:
            self.send(name, message)
        self._stop_playback()
        settings = self.parameters.settings()
        self.playback = Playback(self, published.answer, settings.playback)

    def _stop_playback(self) -> None:
        if self.playback is not None:
            self.playback.stop()
            self.playback = None

    def _start(self) -> bool:
        if not super()._start():
            return False
        self.loss = None
        return True

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
            return f"{SPLATS} of this clip"
        known = found.labels_crc is None or not self.buffer.masks or found.labels_crc == self.buffer.first_labels_crc()
        return "" if known else f"{SPLATS} in the masks of this clip"

    def _on_fit(self, request: Any, response: Any) -> Any:
        missing = "" if self.bag else self.buffer.missing(masks=True) or self._splats_missing()
        response.success = not missing and self._start()
        response.message = "fit begun" if response.success else f"still waiting for {missing}" if missing else "a fit is running; call ~/cancel first"
        return response

    def _on_cancel(self, request: Any, response: Any) -> Any:
        response.success = self.worker.busy
        self.worker.cancel()
        response.message = "ends at its next step" if response.success else "no fit is running"
        return response

    def forget(self) -> None:
        self.splats = {}
        super().forget()

    def _reset(self, request: Any, response: Any) -> Any:
        self._stop_playback()
        self.advertise(*RESULTS, *PLAYED)
        response = super()._reset(request, response)
        if self.bag:
            response.message = "forgotten; ~/fit reads the bag again"
            self.complete = True
        return response


def _equal(a: Gaussians, b: Gaussians) -> bool:
    return a.labels_crc == b.labels_crc and np.array_equal(to_raw(a.splats), to_raw(b.splats))


def _from_bag(bag: str, settings: config.Settings, checkpoint: Checkpoint) -> Steps:
    from diffphys_ros.inverse import run

    return (yield from run(Path(bag), settings, checkpoint=checkpoint))


def _from_topics(buffer: ClipBuffer, splats: Any, settings: config.Settings, checkpoint: Checkpoint) -> Steps:
    from diffphys_ros.inverse import run

    clip = in_world((yield from assembled(buffer)), settings)
    return (yield from run(clip, settings, splats=splats, checkpoint=checkpoint))


def _recover(job: Callable[[Checkpoint], Steps], settings: config.Settings, out: str, resume: bool) -> Generator[Any, None, list[str]]:
    """News, then what is to be published, then the files; returns what was left out, one sentence each. Owns `out` as long as it runs."""
    from diffphys_ros.inverse import Checkpoint

    if not out:
        prepared, _, recovery = yield from job(Checkpoint(None))
        yield Published(fields.answer(recovery, prepared.clip, settings))
        return []
    from diffphys_ros import result

    with result.owned(out) as folder:
        path = folder / result.CHECKPOINT
        checkpoint = Checkpoint(path, every_s=settings.fit.checkpoint_every_s, resume=resume and path.exists())
        prepared, splats, recovery = yield from job(checkpoint)
        yield Published(fields.answer(recovery, prepared.clip, settings))
        left_out = result.write_all(recovery, prepared.clip, settings, folder, splats=splats)
        checkpoint.remove()
        return left_out
