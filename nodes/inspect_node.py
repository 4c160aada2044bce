"""inspect_node: everything that the other nodes say, into a rerun recording or viewer."""

from __future__ import annotations

from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diffphys_ros.errors import InputError, shown
from diffphys_ros.msg_schemas import TOPICS, clouds, messages

from .clip_checks import camera_of, check, colour_of, labels_of
from .convert import message_class, stamp_ns
from .limits import MAX_FRAMES
from .parameters import Own
from .qos import profile
from .splat_topic import splats_of
from .stage import StageNode

if TYPE_CHECKING:
    from diffphys_ros.report.rerun_log import Stream, Web

MAX_PORT = 65534
OWN = (
    Own("file", "diffphys.rrd", "rerun recording to write; its folder must exist. Earlier ones are kept: a start, or another clip, that finds one adds _2, _3, ... to its name"),
    Own("viewer", "", "rerun viewer to stream to instead: a grpc URL, 'spawn' for a new one, or 'web' to serve one for web browsers"),
    Own("web_port", 9090, "of the viewer for web browsers; its data come from the next port", low=1, high=MAX_PORT),
    Own("fit_node", "fit_node", "name of the fit node to look at"),
)
INFO = "clip/camera_info"  # opens a clip
MAX_LOG10_PA = 30.0  # of a modulus that is shown
MAX_S = 1e6  # of a frame after the first one


class InspectNode(StageNode):
    """Logs clip, masks, splats and the results of a fit node."""

    def __init__(self) -> None:
        self.log = rerun_log()  # imported before any transition, which must not take seconds
        self.stream: Any = None
        self.web: Any = None
        self.camera_from: dict[str, Any] = {}  # the latest camera_info and camera_pose, by topic
        self._forget()
        super().__init__("inspect_node", OWN)

    def configure(self) -> None:
        self.web = self._web()
        self.stream = self._opened()
        self._forget()

    def activate(self) -> None:
        for name, show in self._views().items():
            topic = TOPICS[name]
            absolute = name.replace("~", self.parameters["fit_node"], 1)
            self.create_subscription(message_class(topic.type_name), absolute, partial(self._take, name, show), profile(topic))

    def close(self) -> None:
        super().close()
        self.on_cleaned()

    def on_cleaned(self) -> None:
        super().on_cleaned()
        for each in (self.stream, self.web):
            if each is not None:
                each.close()
        self.stream = self.web = None

    def _forget(self) -> None:
        """Nothing of a clip has been shown yet."""
        self.images, self.shown = 0, set[str]()
        self.colours, self.radius_m = np.zeros((0, 3), np.uint8), 0.0

    def health(self) -> dict[str, Any]:
        return {"frames": self.images}

    def _web(self) -> Web | None:
        if self.parameters["viewer"] != "web":
            return None
        web = self.log.Web(int(self.parameters["web_port"]))
        self.get_logger().info(f"open {web.url}")
        return web

    def _opened(self) -> Stream:
        viewer, streams = self.parameters["viewer"], self.log
        if viewer:
            return streams.Stream(viewer=viewer if self.web is None else self.web.uri)
        file = unused(Path(self.parameters["file"]))
        self.get_logger().info(f"recording to {file}")
        return streams.Stream(file=file)

    def _views(self) -> dict[str, Any]:
        return {
            INFO: partial(self._show_camera, INFO),
            "clip/camera_pose": partial(self._show_camera, "clip/camera_pose"),
            "clip/image": self._show_image,
            "clip/mask": lambda m: self.stream.log_labels(labels_of(m, "clip/mask")),
            "splats": lambda m: self.stream.log_splats(splats_of(m)),
            "~/material_field": self._show_material,
            "~/force_field": self._show_force_field,
            "~/force_so_far": self._show_force_so_far,
            "~/quality": self._show_text,
            "~/progress": self._show_progress,
            "~/rendered": lambda m: self.stream.log_rendered(colour_of(m, "~/rendered")),
        }

    def _take(self, name: str, show: Any, message: Any) -> None:
        self.note_input()
        if name == INFO and INFO in self.shown:
            self.stream.close()
            self.stream = self._opened()
            self._forget()
        if getattr(message, "header", None) is not None and stamp_ns(message):
            self.stream.at(stamp_ns(message))
        show(message)
        if name not in self.shown:
            self.shown.add(name)
            self.get_logger().info(f"showing {name}")

    def _show_camera(self, name: str, message: Any) -> None:
        check(name, message, self.resolve_topic_name(name))
        self.camera_from[name] = message
        if len(self.camera_from) == 2:
            self.stream.log_camera(camera_of(self.camera_from[INFO], self.camera_from["clip/camera_pose"]))

    def _show_image(self, message: Any) -> None:
        self.stream.log_image(colour_of(message, "clip/image"))
        self.images += 1

    def _show_material(self, message: Any) -> None:
        from diffphys_ros.colours import stiffness_colours
        from diffphys_ros.report.rerun_log import point_radius

        points = clouds.particles(message, clouds.MATERIAL).ravel()
        if not (np.abs(points["intensity"]) <= MAX_LOG10_PA).all():
            raise InputError(f"topic ~/material_field: intensity must be log10 of a modulus within {MAX_LOG10_PA:g} of 0; publish the modulus that was used")
        self.colours, self.radius_m = stiffness_colours(np.where(points["identified"], 10.0 ** points["intensity"].astype(float), np.nan)), point_radius(points["volume"])
        self.stream.log_cloud(clouds.xyz(points), self.colours, radius_m=self.radius_m)

    def _show_force_field(self, message: Any) -> None:
        from diffphys_ros.report.rerun_log import force_arrows

        rows, start = clouds.particles(message, clouds.FIELD), stamp_ns(message)
        if len(rows) > MAX_FRAMES or np.abs(rows["t"]).max() > MAX_S:
            raise InputError(f"topic ~/force_field: {len(rows)} frames, must be at most {MAX_FRAMES} within {MAX_S:g} s; publish one row per frame")
        where, (force, name, unit) = clouds.xyz(rows), clouds.known_force(rows)
        index, arrows = force_arrows(where[0], force, np.zeros(rows.shape[1], bool))
        self.stream.name_net_force(f"net {name}", unit)
        for k, row in enumerate(rows):
            self.stream.at(start + round(float(row["t"][0]) * 1e9))
            if len(self.colours) == len(row):
                self.stream.log_cloud(where[k], self.colours, radius_m=self.radius_m)
            self.stream.log_arrows(where[k][index], arrows[k])
            self.stream.log_net_force((force[k] * row["volume"][:, None]).sum(0))

    def _show_force_so_far(self, message: Any) -> None:
        rows = clouds.particles(message, clouds.FIELD)
        self.stream.log_force_so_far(np.linalg.norm((clouds.known_force(rows)[0] * rows["volume"][..., None]).sum(1), axis=1))

    def _show_progress(self, message: Any) -> None:
        for status in message.status:
            loss = messages.number(messages.values_of(status).get("loss", ""))
            if loss is not None:
                self.stream.log_loss(loss)
        self._show_text(message)

    def _show_text(self, message: Any) -> None:
        for status in message.status:
            said = ", ".join(f"{key} {value}" for key, value in messages.values_of(status).items() if value)
            self.stream.log_text(f"{status.name}: {status.message} ({said})")


def rerun_log() -> Any:
    """The module that writes for rerun. Raises InputError where rerun is not installed."""
    try:
        from diffphys_ros.report import rerun_log
    except ModuleNotFoundError as error:
        raise InputError(f"inspect_node: needs the package {error.name!r}; install diffphys_ros with the extra [rerun]") from error
    except ImportError as error:
        raise InputError(f"inspect_node: rerun is installed and cannot be used here: {error}") from error
    return rerun_log


def unused(path: Path) -> Path:
    """The path, or with the first number at its name for which there is no file yet; the file is made. What is no regular file, such as a device,
    stays as it is. Raises InputError where no file can be made."""
    if path.exists() and not path.is_file():
        return path
    for number in count(1):
        candidate = path if number == 1 else path.with_stem(f"{path.stem}_{number}")
        try:
            with candidate.open("xb"):
                return candidate
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"parameters of inspect_node: file {shown(path)}: cannot be written ({error.strerror}); choose a file in a folder that can be") from error
    raise AssertionError
