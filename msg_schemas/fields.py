"""A recovery as plain messages: the clouds, the arrows, the resultant, the quality and the news of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..config import Settings
from ..types import Clip, Recovery
from . import clouds
from .messages import ERROR, OK, WARN, diagnostics, header, image, stamp, status, world_frame
from .thinning import Thinned, thin
from .topics import FIT_NODE

CLAMP_PLANE_INSIDE_M = 0.005  # distance of the clamped plane from the box face through which the body leaves
ARROW_LENGTH = 0.25  # of the longest arrow, in extents of the object
DELETE_ALL, ADD, LINE_LIST = 3, 0, 5  # visualization_msgs/msg/Marker
ARROW_COLOR = {"r": 1.0, "g": 0.375, "b": 0.125, "a": 1.0}


@dataclass(frozen=True)
class Answer:
    """A recovery with what its messages need beside it: clock, frames of reference, sizes. Builds every message."""

    recovery: Recovery
    thinned: Thinned
    start_ns: int
    period_s: float
    world: str
    camera: str
    reference: np.ndarray  # about which moments are taken, world frame [m], shape (3,)
    reference_text: str
    max_markers: int

    def __len__(self) -> int:
        return len(self.recovery.force)

    def stamp_ns(self, frame: int) -> int:
        """Recorded stamp of a frame [ns]."""
        return self.start_ns + round(frame * self.period_s * 1e9)

    def material_field(self) -> dict[str, Any]:
        """PointCloud2 at rest positions, layout clouds.MATERIAL; young_modulus is NaN where a part is not identified."""
        r, ids = self.recovery, self.thinned.ids
        part = r.part[ids]
        columns = {
            **_xyz(r.points[ids]),
            "young_modulus": np.where(r.identified[part - 1], r.young[ids], np.nan),
            "poisson_ratio": r.poisson[ids],
            "density": r.density[ids],
            "volume": self.thinned.volume,
            "log10_young_sd": r.log10_young_sd[ids],
            "intensity": np.log10(r.young[ids]),
            "id": ids,
            "part": part,
        }
        return clouds.pack(header(self.start_ns, self.world), clouds.MATERIAL, columns, (1, len(ids)))

    def force_field(self) -> dict[str, Any]:
        """Organised PointCloud2, one row per frame, order and ids of the material field; layout clouds.FORCE."""
        ids, force = self.thinned.ids, self.thinned.force
        columns = {
            **_xyz(self.recovery.trajectory[:, ids]),
            "t": (np.arange(len(self)) * self.period_s)[:, None],
            **_xyz(force, "f"),
            "volume": self.thinned.volume,
            "id": ids,
        }
        return clouds.pack(header(self.start_ns, self.world), clouds.FORCE, columns, force.shape[:2])

    def state(self, frame: int) -> dict[str, Any]:
        """PointCloud2 of one frame, layout clouds.STATE."""
        r, ids = self.recovery, self.thinned.ids
        columns = {
            **_xyz(r.trajectory[frame, ids]),
            "id": ids,
            **_xyz(self.thinned.force[frame], "f"),
            "intensity": np.log10(r.young[ids]),
        }
        return clouds.pack(header(self.stamp_ns(frame), self.world), clouds.STATE, columns, (1, len(ids)))

    def net_force(self, frame: int) -> dict[str, Any]:
        """WrenchStamped of the unclamped particles about `reference`: force [N], torque [N m]."""
        force, torque = self.wrench(frame)
        return {"header": header(self.stamp_ns(frame), self.world), "wrench": {"force": _vector(force), "torque": _vector(torque)}}

    def wrench(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and torque about `reference` [N m], shapes (3,)."""
        r = self.recovery
        loads = r.force[frame].astype(float) * (r.volume * ~r.clamped)[:, None]
        return loads.sum(0), np.cross(r.trajectory[frame].astype(float) - self.reference, loads).sum(0)

    def force_markers(self, frame: int) -> dict[str, Any]:
        """MarkerArray: one LINE_LIST of at most `max_markers` arrows, after the deletion of what was shown before."""
        r, thinned = self.recovery, self.thinned
        chosen = np.linspace(0, len(thinned.ids) - 1, min(self.max_markers, len(thinned.ids))).round().astype(int)
        tails, extent = r.trajectory[frame, thinned.ids[chosen]].astype(float), float(np.ptp(r.points, axis=0).max())
        peak = float(np.linalg.norm(thinned.force, axis=-1).max()) or 1.0
        tips = tails + thinned.force[frame, chosen] * (ARROW_LENGTH * extent / peak)
        ends = np.stack([tails, tips], 1).reshape(-1, 3)
        head = header(self.stamp_ns(frame), self.world)
        markers = [_marker(head, action=DELETE_ALL)]
        if len(ends):
            markers.append(_marker(head, width=0.004 * extent, points=[_vector(p) for p in ends]))
        return {"markers": markers}

    def rendered(self, frame: int) -> dict[str, Any] | None:
        """Image of one frame, rgb8; None where nothing was rendered."""
        frames = self.recovery.frames
        return None if frames is None else image(header(self.stamp_ns(frame), self.camera), frames[frame], "rgb8")

    def quality(self) -> dict[str, Any]:
        """DiagnosticArray, one status per part and one of the force; the assumptions of the recovery are the message."""
        r = self.recovery
        parts = [self._part_quality(number) for number in range(1, len(r.identified) + 1)]
        return diagnostics(self.start_ns, [*parts, self._force_quality()], self.world)

    def _force_quality(self) -> dict[str, Any]:
        r = self.recovery
        values = {
            "identified": r.force_identified,
            "reason": r.force_reason,
            "peak_net_force": float(np.linalg.norm(r.net_force(), axis=1).max()),
            "density_source": r.metrics.get("density_source", "unknown"),
        }
        return self._quality("force", values, good=r.force_identified)

    def _part_quality(self, number: int) -> dict[str, Any]:
        r = self.recovery
        own, known = r.part == number, bool(r.identified[number - 1])
        values = {
            "identified": known,
            "reason": r.reasons[number - 1],
            "young_modulus": float(np.median(r.young[own])) if known and own.any() else float("nan"),
            "log10_young_sd": float(np.median(r.log10_young_sd[own])) if own.any() else float("nan"),
            "density_source": r.metrics.get("density_source", "unknown"),
            "metric_scale_source": r.metrics.get("metric_scale_source", "unknown"),
        }
        return self._quality(f"part {number}", values, good=known)

    def _quality(self, what: str, values: dict[str, Any], *, good: bool) -> dict[str, Any]:
        run = {"run": self.recovery.metrics["run"]} if "run" in self.recovery.metrics else {}
        words = " ".join(self.recovery.notes)
        return status(f"{FIT_NODE}: {what}", values | run, level=OK if good else WARN, message=words, hardware_id=self.camera)


def answer(recovery: Recovery, clip: Clip, settings: Settings) -> Answer:
    """The recovery of a clip, ready to be published within the limits of settings.publish."""
    reference, text = moment_reference(recovery.points, settings.scene.clamp_box_m)
    return Answer(
        recovery,
        thin(recovery, settings.publish.max_points),
        clip.start_ns,
        clip.period_s,
        world_frame(clip.camera),
        clip.camera.frame_id,
        reference,
        text,
        settings.publish.max_markers,
    )


def limited(found: Answer, settings: Settings) -> Answer:
    """The same answer within the limits of other settings.publish."""
    return replace(found, thinned=thin(found.recovery, settings.publish.max_points), max_markers=settings.publish.max_markers)


def moment_reference(points: np.ndarray, clamp_box_m: Sequence[float] | None) -> tuple[np.ndarray, str]:
    """Point about which moments are taken (3,) [m] and its name: the centre of the clamped plane, else the origin.

    The plane lies inside the face of the box through which the body leaves it.
    """
    if clamp_box_m is None:
        return np.zeros(3), "origin of the frame"
    low, high = np.array(clamp_box_m, float).reshape(2, 3)
    center = (low + high) / 2
    outside = np.where(points > high, points - high, np.minimum(points - low, 0)).mean(0)
    axis = int(np.argmax(np.abs(outside)))
    face, inward = (high, -1) if outside[axis] > 0 else (low, 1)
    center[axis] = face[axis] + inward * min(CLAMP_PLANE_INSIDE_M, (high - low)[axis])
    return center, "centre of the clamp plane"


def progress(
    now_ns: int,
    *,
    stage: str,
    iteration: int = 0,
    iterations: int = 0,
    loss: float | None = None,
    seconds_left: float | None = None,
    text: str = "",
    level: int = OK,
    run: str = "",
) -> dict[str, Any]:
    """DiagnosticArray with the news of a fit; `text` is one line for people, `run` names the fit."""
    values = {"run": run, "stage": stage, "iteration": iteration, "iterations": iterations, "loss": loss, "seconds_left": seconds_left}
    return diagnostics(now_ns, [status(f"{FIT_NODE}: progress", values, level=level, message=text)])


def failed_quality(now_ns: int, reason: str, *, run: str = "", camera: str = "", hardware: str = "") -> dict[str, Any]:
    """DiagnosticArray that says in one sentence why there is no recovery of what `camera` (its frame, where it is known) saw."""
    values = {"identified": False, "reason": reason, "run": run}
    return diagnostics(now_ns, [status(f"{FIT_NODE}: recovery", values, level=ERROR, message=reason, hardware_id=hardware)], camera)


def _xyz(vectors: np.ndarray, prefix: str = "") -> dict[str, np.ndarray]:
    return {prefix + axis: vectors[..., i] for i, axis in enumerate("xyz")}


def _vector(values: np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _marker(head: Mapping[str, Any], *, action: int = ADD, width: float = 0.0, points: Sequence[Mapping[str, float]] = ()) -> dict[str, Any]:
    return {
        "header": head,
        "ns": "force",
        "id": 0,
        "type": LINE_LIST,
        "action": action,
        "pose": {"position": _vector(np.zeros(3)), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
        "scale": {"x": width, "y": 0.0, "z": 0.0},
        "color": ARROW_COLOR,
        "lifetime": stamp(0),
        "points": list(points),
    }
