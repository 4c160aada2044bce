"""A recovery as plain messages: the clouds, the markers, the resultant, the camera, the quality and the news of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..colours import stiffness_colours
from ..config import Settings
from ..progress import ForceSoFar
from ..types import Camera, Clip, Recovery, Scale
from . import clouds, markers
from .markers import vector
from .messages import ERROR, OK, WARN, camera_info, diagnostics, header, image, static_tree, status, world_frame
from .thinning import Thinned, thin
from .topics import FIT_NODE, own_name

CLAMP_PLANE_INSIDE_M = 0.005  # distance of the clamped plane from the box face through which the body leaves
MOST_MARKERS = 300  # cubes or arrows of an array: RViz draws so many at once, and hardly more can be told apart
ARROW_LENGTH = 0.25  # of the longest arrow, in extents of the object


@dataclass(frozen=True)
class Answer:
    """A recovery with what its messages need beside it: clock, frames of reference, sizes. Builds every message."""

    recovery: Recovery
    thinned: Thinned
    start_ns: int
    period_s: float
    camera: Camera
    reference: np.ndarray  # about which moments are taken, world frame [m], shape (3,)
    reference_text: str
    scale: Scale  # in which it is told
    node: str = FIT_NODE  # name of the node whose answer it is, with its namespace

    @property
    def world(self) -> str:
        """Name of the frame of everything but images."""
        return world_frame(self.camera)

    @cached_property
    def _peak(self) -> float:
        return _peak(self.thinned.force)

    def __len__(self) -> int:
        return len(self.recovery.force)

    def stamp_ns(self, frame: int) -> int:
        """Recorded stamp of a frame [ns]."""
        return self.start_ns + round(frame * self.period_s * 1e9)

    def material_field(self) -> dict[str, Any]:
        """PointCloud2 at rest positions, layout clouds.MATERIAL.

        young_modulus is NaN where a part is not identified, young_lower where no lower bound of it is known; both where their scale is not.
        """
        r, ids, scale = self.recovery, self.thinned.ids, self.scale
        part, young, known = r.part[ids], r.young[ids], r.known_young()[ids]
        columns = {
            **_xyz(r.points[ids]),
            "young_modulus": _where(scale.absolute, known),
            "log10_young_sd": r.log10_young_sd[ids],
            "young_lower": _where(scale.absolute, r.young_lower[ids]),
            "poisson_ratio": r.poisson[ids],
            "density": r.density[ids],
            "volume": self.thinned.volume,
            "part": part,
            "identified": r.identified[part - 1],
            "absolute": scale.absolute,
            "intensity": np.log10(young if scale.absolute else young / young.max()),
            "id": ids,
            "young_over_density": _where(scale.length, known / r.density[ids]),
            "log10_young_over_density_sd": r.log10_specific_sd[ids],
            "poisson_sd": r.poisson_sd[ids],
            "density_sd": r.density_sd[ids],
            "poisson_assumed": r.poisson_sd[ids] > 0,
            "density_assumed": r.density_sd[ids] > 0,
            "young_relative": r.stiffness(Scale(density=False, length=False)).values[ids],
        }
        return clouds.pack(header(self.start_ns, self.world), clouds.MATERIAL, columns, (1, len(ids)))

    def force_field(self) -> dict[str, Any]:
        """Organised PointCloud2, one row per frame, order and ids of the material field; layout clouds.FIELD."""
        ids, force = self.thinned.ids, self.thinned.force
        columns = {
            **_xyz(self.recovery.trajectory[:, ids]),
            "t": (np.arange(len(self)) * self.period_s)[:, None],
            "volume": self.thinned.volume,
            "id": ids,
            **_forces(force, self._peak, self.scale, self.recovery.density[ids, None]),
        }
        return clouds.pack(header(self.start_ns, self.world), clouds.FIELD, columns, force.shape[:2])

    def state(self, frame: int) -> dict[str, Any]:
        """PointCloud2 of one frame, layout clouds.STATE."""
        ids, force = self.thinned.ids, self.thinned.force[frame]
        columns = {
            **_xyz(self.recovery.trajectory[frame, ids]),
            "id": ids,
            **_forces(force, self._peak, self.scale, self.recovery.density[ids, None]),
        }
        return clouds.pack(header(self.stamp_ns(frame), self.world), clouds.STATE, columns, (1, len(ids)))

    def stiffness_markers(self) -> dict[str, Any]:
        """MarkerArray at rest positions: at most MOST_MARKERS cubes, coloured by log10 E, grey where not identified."""
        shown = thin(self.recovery, MOST_MARKERS)
        edge = float(np.cbrt(np.median(shown.volume)))
        return markers.cubes(header(self.start_ns, self.world), self.recovery.points[shown.ids], stiffness_colours(self.recovery.known_young())[shown.ids], edge_m=edge)

    def net_force(self, frame: int) -> dict[str, Any] | None:
        """WrenchStamped of the unclamped particles about `reference`: force [N], torque [N m]; None where no newtons are known."""
        if not self.scale.absolute:
            return None
        force, torque = self.wrench(frame)
        return {"header": header(self.stamp_ns(frame), self.world), "wrench": {"force": vector(force), "torque": vector(torque)}}

    def net_force_sd(self, frame: int) -> dict[str, Any] | None:
        """Vector3Stamped: standard deviations of the components of `net_force` [N]; None where no newtons are known."""
        if not self.scale.absolute:
            return None
        return {"header": header(self.stamp_ns(frame), self.world), "vector": vector(self.recovery.net_force_sd[frame])}

    def wrench(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and torque about `reference` [N m], shapes (3,)."""
        r = self.recovery
        loads = r.force[frame].astype(float) * (r.volume * ~r.clamped)[:, None]
        return loads.sum(0), np.cross(r.trajectory[frame].astype(float) - self.reference, loads).sum(0)

    def force_markers(self, frame: int) -> dict[str, Any]:
        """MarkerArray: one LINE_LIST of at most MOST_MARKERS arrows."""
        r, thinned = self.recovery, self.thinned
        chosen = np.linspace(0, len(thinned.ids) - 1, min(MOST_MARKERS, len(thinned.ids))).round().astype(int)
        tails, extent = r.trajectory[frame, thinned.ids[chosen]].astype(float), float(np.ptp(r.points, axis=0).max())
        tips = tails + thinned.force[frame, chosen] * (ARROW_LENGTH * extent / self._peak)
        return markers.lines(header(self.stamp_ns(frame), self.world), np.stack([tails, tips], 1), width_m=0.004 * extent)

    def rendered(self, frame: int) -> dict[str, Any] | None:
        """Image of one frame, rgb8; None where nothing was rendered."""
        frames = self.recovery.frames
        return None if frames is None else image(header(self.stamp_ns(frame), self.camera.frame_id), frames[frame], "rgb8")

    def camera_info(self, frame: int) -> dict[str, Any] | None:
        """CameraInfo of the rendered image of one frame; None where nothing was rendered."""
        return None if self.recovery.frames is None else camera_info(header(self.stamp_ns(frame), self.camera.frame_id), self.camera)

    def tree(self) -> dict[str, Any]:
        """TFMessage: the camera in the world."""
        return static_tree(self.start_ns, self.camera)

    def quality(self) -> dict[str, Any]:
        """DiagnosticArray, one status per part and one of the force; the assumptions of the recovery are the message."""
        r = self.recovery
        parts = [self._part_quality(number) for number in range(1, len(r.identified) + 1)]
        return diagnostics(self.start_ns, [*parts, self._force_quality()], self.world)

    def _force_quality(self) -> dict[str, Any]:
        r, scale = self.recovery, self.scale
        peak = float(np.linalg.norm(r.net_force(), axis=1).max())
        values = {
            "identified": r.force_identified,
            "reason": r.force_reason,
            "peak_net_force": r.net_force_peak if scale.absolute else float("nan"),
            "density_source": r.metrics.get("density_source", "unknown"),
            "peak_net_force_over_mass": peak / r.mass_kg if scale.length else float("nan"),
            "scale": scale.words,
            "peak_net_force_sd": r.net_force_peak_sd if scale.absolute else float("nan"),
        }
        return self._quality("force", values, good=r.force_identified)

    def _part_quality(self, number: int) -> dict[str, Any]:
        r, scale = self.recovery, self.scale
        own, known = r.part == number, bool(r.identified[number - 1])

        def median(values: np.ndarray, there: bool) -> float:
            return float(np.median(values[own])) if there and own.any() else float("nan")

        values = {
            "identified": known,
            "reason": r.reasons[number - 1],
            "young_modulus": median(r.young, known and scale.absolute),
            "log10_young_sd": median(r.log10_young_sd, True),
            "density_source": r.metrics.get("density_source", "unknown"),
            "metric_scale_source": r.metrics.get("metric_scale_source", "unknown"),
            "young_over_density": median(r.young / r.density, known and scale.length),
            "young_relative": median(r.stiffness(Scale(density=False, length=False)).values, known),
            "scale": scale.words,
        }
        return self._quality(f"part {number}", values, good=known)

    def _quality(self, what: str, values: dict[str, Any], *, good: bool) -> dict[str, Any]:
        run = {"run": self.recovery.metrics["run"]} if "run" in self.recovery.metrics else {}
        words = "; ".join(note.rstrip(".") for note in self.recovery.notes)
        return status(f"{own_name(self.node)}: {what}", values | run, level=OK if good else WARN, message=words, hardware_id=self.camera.frame_id)


def answer(recovery: Recovery, clip: Clip, settings: Settings, *, node: str = FIT_NODE) -> Answer:
    """The recovery of a clip, ready to be published within the limits of settings.publish by a node of this name."""
    reference, text = moment_reference(recovery.points, settings.scene.clamp_box_m)
    return Answer(
        recovery,
        thin(recovery, settings.publish.max_points),
        clip.start_ns,
        clip.period_s,
        clip.camera,
        reference,
        text,
        recovery.scale.taken(settings.publish.allow_assumed_scale),
        node,
    )


def limited(found: Answer, settings: Settings) -> Answer:
    """The same answer within the limits of other settings.publish."""
    return replace(found, thinned=thin(found.recovery, settings.publish.max_points), scale=found.recovery.scale.taken(settings.publish.allow_assumed_scale))


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
    node: str = FIT_NODE,
) -> dict[str, Any]:
    """DiagnosticArray with the news of a fit; `text` is one line for people, `run` names the fit."""
    values = {"run": run, "stage": stage, "iteration": iteration, "iterations": iterations, "loss": loss, "seconds_left": seconds_left}
    return diagnostics(now_ns, [status(f"{own_name(node)}: progress", values, level=level, message=text)])


def force_so_far(force: ForceSoFar, *, allow_assumed: bool = False) -> dict[str, Any]:
    """PointCloud2 of layout clouds.FIELD with one point a frame: the object's centre, its volume and, times that, its net force."""
    density = np.array(force.net)[:, None] / force.volume_m3
    scale = Scale(force.density_told, force.length_told).taken(allow_assumed)
    columns = {
        **_xyz(np.array(force.centre)),
        "t": (np.arange(len(density)) * force.period_s)[:, None],
        "volume": np.array(force.volume_m3),
        "id": np.array(0),
        **_forces(density, _peak(density), scale, np.array(force.mass_kg / force.volume_m3)),
    }
    return clouds.pack(header(force.start_ns, force.frame_id), clouds.FIELD, columns, density.shape[:2])


def failed_quality(now_ns: int, reason: str, *, run: str = "", camera: str = "", hardware: str = "", node: str = FIT_NODE) -> dict[str, Any]:
    """DiagnosticArray that says in one sentence why there is no recovery of what `camera` (its frame, where it is known) saw."""
    values = {"identified": False, "reason": reason, "run": run}
    return diagnostics(now_ns, [status(f"{own_name(node)}: recovery", values, level=ERROR, message=reason, hardware_id=hardware)], camera)


def _xyz(vectors: np.ndarray, prefix: str = "") -> dict[str, np.ndarray]:
    return {prefix + axis: vectors[..., i] for i, axis in enumerate("xyz")}


def _peak(force: np.ndarray) -> float:
    return float(np.linalg.norm(force, axis=-1).max(initial=0.0)) or 1.0


def _forces(force: np.ndarray, peak: float, scale: Scale, density: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of force densities [N/m^3] (..., 3), of them over the mass of their volume and over the largest, as far as a scale tells them."""
    relative = force / peak
    shown = force if scale.absolute else relative
    columns = {**_xyz(_where(scale.absolute, force), "f"), **_xyz(_where(scale.length, force / density), "a"), **_xyz(relative, "r")}
    return columns | {"intensity": np.linalg.norm(shown, axis=-1)}


def _where(known: bool, values: np.ndarray) -> np.ndarray:
    return values if known else np.full(np.shape(values), np.nan)
