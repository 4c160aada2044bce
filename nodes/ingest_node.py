"""ingest_node: raw camera topics or a bag in, clean clips out."""

from __future__ import annotations

import time
from collections.abc import Collection
from functools import partial
from pathlib import Path
from typing import Any

from std_srvs.srv import SetBool, Trigger

from diffphys_ros.errors import shown
from diffphys_ros.msg_schemas import TOPICS

from . import camera_bag, camera_topics, clip_job
from .beside import COLOUR_INFO, DEPTH_INFO, IMU, POSE, Beside
from .camera_topics import ANY, IMAGE, MASK, PRESSED, TRANSPORTS
from .clip_buffer import INFO
from .clip_job import LOOK_S, Hand, News
from .clip_out import Sent
from .clip_stage import CLIP, CLIP_DONE
from .convert import message_class, stamp_ns
from .dispatch import MOST_WAITING, Dispatch
from .intake import DEPTH, PRESSED_DEPTH, Intake
from .limits import MAX_FRAMES, MAX_MIB, max_bytes
from .managed import UNCONFIGURED
from .memory import give_back
from .parameters import Own, existing
from .player import Part, Player
from .qos import RELIABILITY, profile
from .recorder import ALWAYS, FULL, MANUAL, MOTION, PAUSE, Recorder
from .stage import StageNode
from .worker import FAILED, Job

BAG = Own("bag", "", "recording to read instead of topics: MCAP file, rosbag2 folder, video or image folder", check=existing)
MAX_SILENCE_S = 3600.0
MAX_RATE, MAX_PART_S = 100.0, 1e6  # of what is played
OWN = (
    BAG,
    Own("rate", 0.0, "speed relative to the recording at which the topics of `bag` are played, with /clock, and heard; 0: its clip is read at once", low=0.0, high=MAX_RATE),
    Own("loop", False, "play `bag` again and again; every pass ends a clip"),
    Own("start", 0.0, "of `bag`, left out at the beginning [s]", low=0.0, high=MAX_PART_S),
    Own("duration", 0.0, "of `bag`, taken at most [s]; 0: to its end", low=0.0, high=MAX_PART_S),
    Own("reliability", "best_effort", "of the raw inputs", tuple(RELIABILITY)),
    Own("image_transport", ANY, "in which the camera's images are heard; any: both, and the one that comes first is used", (ANY, *TRANSPORTS[IMAGE])),
    Own("depth_transport", ANY, "in which depth images are heard; any: both, and the one that comes first is used", (ANY, *TRANSPORTS[DEPTH])),
    Own("clip.trigger", ALWAYS, "what opens a clip: always, the first image; manual, ~/record; motion, what moves", (ALWAYS, MANUAL, MOTION), fixed=False),
    Own("clip.seconds", 10.0, "how much of a camera that does not stop is kept, and the longest clip that ~/record or motion opens [s]", low=0.1, high=600.0, fixed=False),
    Own("silence_s", 2.0, "a clip ends after this long without an image [s]", low=0.0, high=MAX_SILENCE_S, fixed=False),
    Own("patience_s", 10.0, "how long a clip that has ended waits for the transform that it lacks [s]", low=0.0, high=MAX_SILENCE_S, fixed=False),
    Own("max_frames", 1200, "a clip ends after this many images", low=2, high=MAX_FRAMES),
    MAX_MIB._replace(doc="most that is kept of images [MiB]: half of it for what comes in and waits, half for the clip that is out; 218 frames of 640x480 px with depth"),
)


MOST_PASSED_S = 2 * LOOK_S  # between two looks for silence; more means that the node was held up
AT_ONCE = {"clip.trigger", "clip.seconds", "silence_s"}  # hold for a clip that is open, too


class IngestNode(StageNode):
    """Cuts clips out of what a camera sends and publishes them, one after the other; listens on while the other nodes work."""

    sparse = (MASK,)

    def __init__(self) -> None:
        super().__init__("ingest_node", OWN, CLIP)

    def configure(self) -> None:
        beside = Beside(camera_topics.resolved(self))
        self.intake = Intake(int(self.parameters["max_frames"]), max_bytes(self.parameters) // 2, beside)
        self.lacking = ""  # what the clip that is next waits for
        self.recorder = Recorder(self.intake, self.parameters["clip.trigger"], self.parameters["clip.seconds"], self._on_closed, self._doubt)
        self.dispatch = Dispatch()
        self.collected = self.ignored = 0  # images taken, and of another topic
        self.first_ns = self.last_ns = 0  # stamps of those that were taken
        self.quiet_s: float | None = None  # how long it was looked in vain for another image, by the looks alone; None where none is expected
        self._looked = time.monotonic()
        self.player: Player | None = None
        self._hand = Hand()
        self.create_service(Trigger, "~/end", self._on_end)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/record", self._on_record)

    def activate(self) -> None:
        if not self.parameters["bag"]:
            camera_topics.subscribe(self, self.take, self.parameters["reliability"], self._transports())
            self._say_unused()
            self._attend()
        elif self.state != "done":
            self._read_or_play()

    def on_deactivated(self) -> None:
        super().on_deactivated()
        if self.player is not None:
            self.player.close()
            self.player = None

    def on_parameters(self, names: Collection[str]) -> Collection[str]:
        if self.lifecycle != UNCONFIGURED:
            self.recorder.change(self.parameters["clip.trigger"], self.parameters["clip.seconds"])
        return AT_ONCE & set(names)

    @property
    def reading(self) -> bool:
        """Whether the clip is that of a bag that is read at once."""
        return bool(self.parameters["bag"]) and not self.parameters["rate"]

    @property
    def beside(self) -> Beside:
        """What is heard beside the images."""
        return self.intake.beside

    def waiting_for(self) -> str:
        if self.reading or self.worker.busy:
            return self.lacking
        held_up_by = self.dispatch.held_up_by(self._stages()) if self.dispatch.waiting else []
        if held_up_by:
            return f"{', '.join(held_up_by)} to end with the clip before; {len(self.dispatch.waiting)} wait"
        if not self.intake.images and not self.dispatch.waiting:
            if self.parameters["bag"] and (self.player is None or self.player.over):
                return ""
            return " or ".join(self.beside.name(name) for name in (IMAGE, PRESSED) if name not in camera_topics.unwanted(self._transports()))
        if self._camera_missing():
            return self.beside.name(COLOUR_INFO)
        return "the end of the clip" if self.recorder.recording else ""

    def health(self) -> dict[str, Any]:
        waiting = {"clips_waiting": len(self.dispatch.waiting), "clips_dropped": self.dispatch.dropped, "held_mib": (self.intake.bytes + self.dispatch.bytes) / 2**20}
        return {"frames": len(self.intake.images), "frequency_hz": self._frequency(), "ignored": self.ignored, **self.recorder.health(), **waiting}

    def doubtful(self) -> bool:
        return bool(self.recorder.recording and self.recorder.warning())

    def on_news(self, news: News) -> None:
        """A message of a clip that is ready, or what it still lacks."""
        if news is None:
            return
        if isinstance(news, str):
            self.lacking = news
            self.get_logger().warning(f"{news}; waiting for it for {self.parameters['patience_s']:g} s")
            return
        self.lacking = ""
        topic, fields = news
        if topic == INFO:
            self.advertise(*CLIP)  # of the clip before nothing is latched any more
            stamp = fields["header"]["stamp"]
            self.dispatch.sent(stamp["sec"] * 10**9 + stamp["nanosec"])
        self.send(topic, fields)
        self._hand.published()

    def on_done(self, sent: Sent) -> None:
        give_back()
        for note in sent.notes:
            self.get_logger().warning(note)
        self.get_logger().info(f"published a clip of {sent.frames} frames, {sent.period_s * 1e3:.1f} ms apart, with{'' if sent.with_depth else 'out'} depth")
        if not sent.with_depth and not self.parameters["bag"] and camera_topics.is_renamed(self, DEPTH):
            self.get_logger().warning(f"{self.beside.name(DEPTH)}: no depth image came, though the topic was named; check its name, and that it is published")

    def _attend(self) -> None:
        """To stages that have ended with a clip, and to silence."""
        done = TOPICS[CLIP_DONE]
        self.create_subscription(message_class(done.type_name), CLIP_DONE, self._on_clip_done, profile(done))
        self.create_timer(LOOK_S, self._look)

    def take(self, name: str, message: Any) -> None:
        """A message of a camera, live or played, by the name of camera_topics. Raises InputError for one that is of no use."""
        if name in (IMAGE, PRESSED):
            self._take_image(name, message)
        elif name in (DEPTH, PRESSED_DEPTH):
            self.intake.take_depth(message)
        elif name == MASK:
            self.intake.take_mask(message)
        elif name in (COLOUR_INFO, DEPTH_INFO):
            self.beside.take_info(message, name, after_ns=self.last_ns, fov_known=self._fov_known)
        elif name == IMU:
            self.beside.take_imu(message)
        elif name == POSE:
            self.beside.take_link(message)
        else:
            for link in message.transforms:
                self.beside.take_link(link, name)

    def _take_image(self, topic: str, message: Any) -> None:
        self.note_input()
        if self.intake.topic not in ("", topic):
            self._ignore(topic)
            return
        self.intake.elsewhere = self.dispatch.bytes
        self.recorder.take(topic, message)
        self.collected, self.quiet_s, self.last_ns = self.collected + 1, 0.0, stamp_ns(message)
        self.first_ns = self.first_ns if self.collected > 1 else self.last_ns

    def _say_unused(self) -> None:
        """Settings that choose topics of a recording choose none of a camera."""
        topics = self.parameters.settings().topics
        for name, value in ((name, getattr(topics, name)) for name in ("image", "depth", "camera_info", "imu", "mask")):
            if value not in (None, "none"):
                self.get_logger().warning(f"topics.{name} chooses a topic of a recording and changes nothing here; of a camera: -r {name}:={value}")

    def _ignore(self, topic: str) -> None:
        """An image that another topic has brought already."""
        if not self.ignored:
            used, other = self.beside.name(self.intake.topic), self.beside.name(topic)
            self.get_logger().warning(f"{used} and {other} bring the same images: the latter are ignored; set image_transport, so that they are neither made nor sent")
        self.ignored += 1

    def _transports(self) -> dict[str, str]:
        return {IMAGE: self.parameters["image_transport"], DEPTH: self.parameters["depth_transport"]}

    def _on_clip_done(self, message: Any) -> None:
        for status in message.status[:1]:
            self.dispatch.hear(status.name, stamp_ns(message), status.level[0])

    def _look(self) -> None:
        """For silence, and whether a clip that waits may go. What this node was held up is no silence: images wait that it has not taken yet."""
        passed, self._looked = time.monotonic() - self._looked, time.monotonic()
        if self.quiet_s is not None:
            self.quiet_s += min(passed, MOST_PASSED_S)
            if self.quiet_s > self.parameters["silence_s"]:
                self.quiet_s, self.collected = None, 0
                self.recorder.silence()
        self._send_next()

    def _on_closed(self, clip: Intake, why: str) -> None:
        count, span_s = len(clip.images), clip.span_s
        if not self.dispatch.add(clip):
            self.get_logger().warning(
                f"a clip of {count} images is dropped, the {self.dispatch.dropped}. so far: {MOST_WAITING} wait for {', '.join(self.dispatch.held_up_by(self._stages())) or 'this node'}; "
                "call ~/reset of a stage to let the next one pass"
            )
            return
        words = f"a clip of {count} images, {span_s:.2f} s, ends: {why}"
        if why == FULL:
            self.get_logger().warning(f"{words}; what comes after them is no part of it, raise these parameters for a longer one")
        else:
            self.get_logger().info(words)
        if self.recorder.trigger == ALWAYS and why != PAUSE:
            self.get_logger().info("what the camera sends on is kept for ~/end and ~/record; a clip begins by itself after a pause, or with clip.trigger motion")
        self._send_next()

    def _send_next(self) -> None:
        if self.worker.busy or not self.dispatch.waiting or self._camera_missing():
            return
        clip = self.dispatch.next(self._stages())
        if clip is not None:
            self._start(partial(clip_job.collected, clip, self.parameters.settings(), self.parameters["patience_s"], self._hand))

    def _camera_missing(self) -> bool:
        """Whether what the camera is may still be told: a clip that ended before waits for it."""
        return not (self.beside.infos(COLOUR_INFO) or self.beside.unusable or self._fov_known())

    def _fov_known(self) -> bool:
        return self.get_parameter("camera.fov_deg").value is not None

    def _start(self, job: Job) -> None:
        self.worker.start(job)
        self.state, self.lacking = "working", ""

    def _read_or_play(self) -> None:
        """Read the clip of the bag, or play it and hear what is played as if a camera sent it."""
        part = Part(*(self.parameters[name] for name in ("rate", "loop", "start", "duration")))
        if not part.rate:
            self._start(partial(clip_job.read, self.parameters["bag"], self.parameters.settings(), part, self._hand))
            return
        path = Path(self.parameters["bag"])
        names = camera_bag.inputs(path, self.parameters.settings().topics)
        self.beside.rename({name: topic for topic, name in names.items()})
        self.player = camera_bag.play(self, path, part, names, self.take, self._on_played)
        self._attend()
        self.player.start()

    def _on_played(self, again: bool) -> None:
        self.get_logger().info("the recording ends here" + ("; it is played again" if again else ""))
        if not self.collected:
            self.state = FAILED
            self.on_failed(f"{shown(self.parameters['bag'])}: no image was played; choose another start and duration")
        self.recorder.silence()  # the next pass begins another clip

    def _stages(self) -> set[str]:
        """Who listens to clips, by full name."""
        found = self.get_publishers_info_by_topic(self.resolve_topic_name(CLIP_DONE))
        return {f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in found}

    def _doubt(self, fault: str) -> None:
        self.get_logger().warning(fault)

    def _frequency(self) -> float | None:
        span = self.last_ns - self.first_ns
        return 1e9 * (self.collected - 1) / span if span > 0 else None

    def _on_record(self, request: Any, response: Any) -> Any:
        if self.reading:
            response.success, response.message = False, "reading a bag; start the node without one"
        elif request.data:
            self.recorder.record()
            response.success, response.message = True, "recording; ~/end closes the clip"
        else:
            self._end(response, "~/record false was called")
        return response

    def _on_end(self, request: Any, response: Any) -> Any:
        return self._end(response, "~/end was called")

    def _end(self, response: Any, why: str) -> Any:
        count, dropped = len(self.intake.images), self.dispatch.dropped
        response.success = self.recorder.end(why) and self.dispatch.dropped == dropped
        response.message = f"clip of {count} images closed" if response.success else "dropped, two clips wait" if self.dispatch.dropped > dropped else f"{count} images, a clip has 2 or more"
        if response.success and self.recorder.fault:
            response.message += f"; {self.recorder.fault}"
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        response.success = not self.reading
        if not response.success:
            response.message = "reading a bag; start the node again"
            return response
        self.recorder.reset()
        self.dispatch.dropped += (waited := self.dispatch.release())
        self.state = "working" if self.worker.busy else "waiting"
        response.message = f"forgotten, with {waited} clips that waited; collecting"
        return response
