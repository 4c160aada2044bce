"""What ingest_node hears beside the images of a camera: its camera_info, transforms, accelerations. Kept from clip to clip, bounded."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from diffphys_ros.bags.decode import MAX_PIXELS
from diffphys_ros.bags.gravity import Imu
from diffphys_ros.bags.lens import calibration, image_size, lens_of
from diffphys_ros.bags.transforms import HELD, Transforms
from diffphys_ros.errors import InputError, named

from .convert import stamp_ns

COLOUR_INFO, DEPTH_INFO, POSE, IMU = "camera_info", "depth_camera_info", "camera_pose", "imu"
MAX_INFOS = 16  # different ones that are kept of a camera
MAX_ACCELERATIONS = 10_000  # fifty seconds of an IMU of 200 Hz
MARGIN_NS = 10**9
NO_NAMES: Mapping[str, str] = MappingProxyType({})


class Beside:
    """Every `take_...` raises InputError for a message that is of no use, and keeps nothing of it.

    Args:
        names: resolved names of topics, for people.
    """

    def __init__(self, names: Mapping[str, str] = NO_NAMES) -> None:
        self.names = names
        self.transforms = Transforms()
        self.unusable = ""  # why the latest camera_info of the images that was refused was
        self._infos: dict[str, deque[tuple[int, Any]]] = {topic: deque(maxlen=MAX_INFOS) for topic in (COLOUR_INFO, DEPTH_INFO)}
        self._accelerations: deque[Any] = deque(maxlen=MAX_ACCELERATIONS)

    def name(self, topic: str) -> str:
        """A topic's resolved name."""
        return self.names.get(topic, topic)

    def rename(self, names: Mapping[str, str]) -> None:
        """These topics have other names from here on."""
        self.names = {**self.names, **names}

    def infos(self, topic: str) -> list[tuple[int, Any]]:
        """(stamp [ns] of the image after which it came, CameraInfo) of the different ones of a topic, in the order of these stamps: when a
        driver fills in its header says less of when the node could know."""
        return sorted(self._infos[topic], key=lambda item: item[0])

    def imu(self, first: int, last: int) -> Imu | None:
        """What was measured from a second before to a second after these stamps [ns], without which lately; None where nothing was."""
        during = [message for message in self._accelerations if first - MARGIN_NS <= stamp_ns(message) <= last + MARGIN_NS]
        messages = during or list(self._accelerations)
        return Imu(self.name(IMU), messages) if messages else None

    def take_info(self, message: Any, topic: str = COLOUR_INFO, *, after_ns: int = 0, fov_known: Callable[[], bool] = lambda: False) -> None:
        """A camera_info that came after the image of a stamp; one without focal length is of use where the field of view is known."""
        latest = next((info for _, info in reversed(self._infos[topic]) if image_size(info) == image_size(message)), None)
        if latest is not None and calibration(latest) == calibration(message):
            return
        if message.width * message.height > MAX_PIXELS:
            raise InputError(f"topic {self.name(topic)}: is for {message.width}x{message.height} px, at most {MAX_PIXELS} pixels are read; record smaller images")
        if not (message.k[0] == 0 and fov_known()):
            self._check(message, topic)
        self._infos[topic].append((after_ns, message))

    def take_link(self, link: Any, kind: str = HELD) -> None:
        """A TransformStamped of /tf, /tf_static or camera_pose; one that closes a circle is refused."""
        self.transforms.add(link, kind)

    def take_imu(self, message: Any) -> None:
        """A sensor_msgs/Imu."""
        self._accelerations.append(message)

    def _check(self, message: Any, topic: str) -> None:
        size = image_size(message)
        try:
            if message.width and message.height and not all(size):
                raise InputError(f"its region of interest and bins leave no pixel of {message.width}x{message.height}; correct the driver")
            lens_of(message, size if all(size) else (1, 1), topic)
        except InputError as error:
            words = f"topic {named(self.name(topic))}: {error}"
            if topic == COLOUR_INFO:
                self.unusable = words
            raise InputError(words) from error
