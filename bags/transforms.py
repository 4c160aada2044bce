"""A small transform tree over time, of /tf, /tf_static and camera_pose: for recordings and, as tf2_ros is in no wheel, for live topics too."""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from diffphys_ros.bags.camera import MOST_DISTANCE_M, matrix_from_transform
from diffphys_ros.errors import InputError, listed, named

MAX_LINKS = 1000
MAX_SAMPLES = 5000  # of a moving link; a joint that stands still needs two
REACH_NS = 500_000_000  # how long before its first and after its last sample a link of /tf is taken to stand still
FOR_EVER_NS = 2**63  # of one that is published once, or when it changes
STATIC, MOVING, HELD = "/tf_static", "/tf", "camera_pose"  # how links are published: once; all the time; once or when they change
FIXED = ("world", "map", "odom", "earth")  # frames that stand still by REP-105


@dataclass
class _Link:
    """Where a frame lies in its parent."""

    parent: str
    kind: str  # STATIC, MOVING or HELD
    stamps: list[int] = field(default_factory=list)  # [ns], ascending
    poses: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)  # translation (3,) [m], unit quaternion xyzw (4,)
    received: Any = None  # the latest message

    def add(self, stamp: int, pose: tuple[np.ndarray, np.ndarray]) -> None:
        at = bisect_right(self.stamps, stamp)
        if at and self.stamps[at - 1] == stamp:
            self.poses[at - 1] = pose
            return
        if at == len(self.stamps) >= 2 and all(np.array_equal(a, b) for p in self.poses[-2:] for a, b in zip(p, pose, strict=True)):
            self.stamps[-1] = stamp  # still where it was: the first and the last time say it
            return
        self.stamps.insert(at, stamp)
        self.poses.insert(at, pose)
        if len(self.stamps) > MAX_SAMPLES:
            del self.stamps[0], self.poses[0]

    def at(self, stamp: int | None) -> np.ndarray | None:
        """parent_from_child (4, 4) [m] at a time [ns], the latest without one; None where nothing is known of that time."""
        if stamp is None or self.still:
            return _matrix(*self.poses[-1])
        if not self._near(stamp):
            return None
        if len(self.stamps) == 1:
            return _matrix(*self.poses[0])
        after = min(max(bisect_right(self.stamps, stamp), 1), len(self.stamps) - 1)
        before, until = self.stamps[after - 1], self.stamps[after]
        share = min(max((stamp - before) / (until - before), 0.0), 1.0)
        (t0, q0), (t1, q1) = self.poses[after - 1], self.poses[after]
        return _matrix((1 - share) * t0 + share * t1, _slerp(q0, q1, share))

    @property
    def still(self) -> bool:
        """Whether it can be said of every time where it is."""
        return self.kind == STATIC or (self.kind == HELD and all(np.array_equal(*each) for p in self.poses for each in zip(p, self.poses[-1], strict=True)))

    def _near(self, stamp: int) -> bool:
        reach = REACH_NS if self.kind == MOVING else FOR_EVER_NS
        return self.stamps[0] - reach <= stamp <= self.stamps[-1] + reach


class Transforms:
    """Frames and where they lie in each other; names are taken without a leading slash, as tf2 has it. May be used by several
    threads."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._lock = threading.RLock()  # who asks works beside who hears

    def __len__(self) -> int:
        return len(self._links)

    def add(self, message: Any, kind: str) -> None:
        """A geometry_msgs/TransformStamped, published as STATIC, MOVING or HELD. Raises InputError for one without a rotation, one that closes a circle, and one link too many."""
        with self._lock:
            child, parent, pose = _plain(message.child_frame_id), _plain(message.header.frame_id), pose_of(message)
            known = self._links.get(child)
            if known is None or (known.parent, known.kind) != (parent, kind):
                self._check(child, parent)
                known = _Link(parent, kind)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if kind == STATIC:
                known.stamps, known.poses = [stamp], [pose]
            else:
                known.add(stamp, pose)
            known.received = message
            self._links[child] = known

    def root(self, frame: str) -> str:
        """The last frame above a frame; itself where it has no parent."""
        with self._lock:
            return list(self._chain(_plain(frame)))[-1]

    def between(self, target: str, source: str, stamp: int | None = None) -> np.ndarray | None:
        """target_from_source (4, 4) [m] at a time [ns]; None where no transforms connect them, or those of a moving link are of another time.

        Raises InputError for frames that lie absurdly far from each other.
        """
        with self._lock:
            target, source = _plain(target), _plain(source)
            if target == source:
                return np.eye(4)
            above = list(self._chain(target))
            meeting = next((frame for frame in self._chain(source) if frame in above), None)
            if meeting is None:
                return None
            down, up = self._up(target, meeting, stamp), self._up(source, meeting, stamp)
            if down is None or up is None:
                return None
            pose = np.linalg.inv(down) @ up if target != meeting else up
            if not np.abs(pose).max() < MOST_DISTANCE_M:
                raise InputError(
                    f"transforms: {named(source)} lies {np.abs(pose).max():.3g} m from {named(target)}, must be nearer than {MOST_DISTANCE_M:g} m; "
                    "correct the publisher"
                )
            return pose

    def single(self, frame: str, target: str) -> Any:
        """The message that is the whole way from a frame to another, where one that stands still is; else None."""
        with self._lock:
            link = self._links.get(_plain(frame))
            return link.received if link is not None and link.parent == _plain(target) and link.still else None

    def frames(self) -> str:
        """Some of the frames that are known, in words."""
        with self._lock:
            return listed(sorted({name for child, link in self._links.items() for name in (child, link.parent)}), 6) or "none"

    def _up(self, frame: str, end: str, stamp: int | None) -> np.ndarray | None:
        pose = np.eye(4)
        while frame != end:
            link = self._links[frame]
            step = link.at(stamp)
            if step is None:
                return None
            pose, frame = step @ pose, link.parent
        return pose

    def _chain(self, frame: str) -> Iterator[str]:
        yield frame
        while frame in self._links:
            frame = self._links[frame].parent
            yield frame

    def _check(self, child: str, parent: str) -> None:
        if child not in self._links and len(self._links) >= MAX_LINKS:
            raise InputError(f"the transform tree has {MAX_LINKS} links, no more are kept; publish the camera's alone")
        chain = list(self._chain(parent))
        if child in chain:
            names = " <- ".join(named(name, 40) for name in [child, *chain[: chain.index(child) + 1][:4]])
            raise InputError(f"the transforms {names} form a circle; correct the publisher")


def _plain(frame: str) -> str:
    return frame.removeprefix("/")


def pose_of(message: Any) -> tuple[np.ndarray, np.ndarray]:
    """Translation [m] and unit quaternion xyzw of a TransformStamped. Raises InputError, naming its frames."""
    t, r = message.transform.translation, message.transform.rotation
    try:
        matrix_from_transform((t.x, t.y, t.z), (r.x, r.y, r.z, r.w))
    except InputError as error:
        raise InputError(f"{named(message.child_frame_id)} in {named(message.header.frame_id)}: {error}") from error
    return np.array([t.x, t.y, t.z], float), np.array([r.x, r.y, r.z, r.w], float)


def _matrix(translation: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    return matrix_from_transform(translation, quaternion)  # type: ignore[arg-type]


def _slerp(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """Between two quaternions of any length, at a constant rate of turning (Shoemake 1985)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine = float(a @ b)
    b, cosine = (-b, -cosine) if cosine < 0 else (b, cosine)
    angle = np.arccos(min(cosine, 1.0))
    if angle < 1e-6:
        return (1 - share) * a + share * b
    return (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
