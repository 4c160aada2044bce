"""A clip of an object without texture, prepared by its outline: its calm frames, how it hangs in its picture, and at what scale.

Where the clamp lies beyond the picture, its place is found together with the scale: of several bodies, each continued straight to a clamp
further out and as long as it is told to be, the one is taken whose leading mode has the shape that the outline shows. Where its sides lean at
the picture's edge, what is hidden may lean on or not: it is taken to lean half as much, and what parallel sides would make of clamp and modulus is in their
standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..config import Settings
from ..errors import InputError
from ..picture import along_border, extent_px, length_at_unit_depth
from ..progress import Progress
from ..start.values import widened
from ..types import Body, Camera, Clip, Hanging, StartValues, Tracks, object_mask
from .steadied import Steadied, steadied

if TYPE_CHECKING:
    from ..depth import DepthSource
    from ..outline import Sway
    from ..start.hang import Hung
    from ..tracks import CameraMotion

FAR_FOV_DEG = 2.0  # of the camera that stands for one of which nothing is told: its rays are parallel to within a degree [numerical]
ASSUMED_DISTANCE_M = 1.0  # of the object from the camera as it was assumed, where nothing tells a length [numerical]
BEHIND, STEP = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25), 0.05  # places of the clamp behind its line that are tried, over the object's length in the picture, and on from there [numerical]
FURTHEST = 1.0  # of that length, where the search ends: half of the object is then beyond the picture [chosen]
INDEPENDENT = 8.0  # pieces of an outline whose errors do not go together: what a mode's shape misses is smooth along it [chosen]
SURELY = 2.0  # standard deviations by which the shape of a swing contradicts a clamp's line [chosen]
EDGE_PX = 0.5  # of an end face [chosen]
SCALE_POWER = 2.5  # of the scale, by which E of a beam of that length falls: 4 of its length less 2 of its width, more with its weight [derived]
DEPTH_SD = 0.015  # of log10 E where the depth across the picture is not told: a thin sheet and a square bar differ by .01 to .03 [derived: half of the larger]


@dataclass(frozen=True)
class Outlined:
    """What the outline makes of a clip."""

    clip: Clip  # its calm frames, with labels; frame 0 is the one nearest to rest
    depth0: np.ndarray  # [m], (H, W)
    source: DepthSource
    tracks: Tracks
    body: Body
    settings: Settings  # with what was assumed of the scene
    hanging: Hanging
    whole: Clip  # all frames, with labels; as they were filmed
    moved: CameraMotion | None = None  # how the camera did, as far as that was not taken off


def outlined(clip: Clip, settings: Settings) -> Generator[Progress, None, Outlined | None]:
    """The clip seen by its outline; None where points on the object are to be followed. Raises InputError where an outline is asked for that
    tells nothing."""
    from ..plain_swing import is_looked_for, plain_swing

    if is_looked_for(clip, settings):
        yield Progress("segment", text="whether the object is plain")
    chosen = plain_swing(clip, settings)
    if chosen is None:
        return None
    whole, calm = chosen
    if settings.frames.predict:
        raise InputError(
            f"frames.predict is {settings.frames.predict}, must be 0 where the outline is followed: its calm frames are chosen among all; leave it out, the swing before them is predicted by itself"
        )
    first, end, count, periods = calm.rest, calm.end, len(whole), calm.periods
    clip = whole.part(first, end)
    settings, held_at = _with_clamp(clip, settings)
    _require_whole(clip, settings)
    clip = replace(clip, camera=_camera(clip.camera))
    hanging = Hanging(first, end, count, periods, 0.0, 0.0, 0.0, 0.0, settings.scene.size_m is not None, 0.0)
    yield Progress("tracks", text=f"too little texture for points: the outline is followed through frames {first}..{end - 1} of {count}, {periods:.1f} periods about rest")
    steady = _steadied(clip, settings)
    if steady.sway is not None and settings.scene.rest_frame is None and steady.sway.to_rest:  # the hand had made another frame seem nearest to rest
        first = max(first + steady.sway.to_rest, 0)
        steady = _steadied(replace(whole.part(first, end), camera=clip.camera), settings)
        hanging = replace(hanging, rest_frame=first, periods=periods * (end - 1 - first) / (end - 1 - hanging.rest_frame))
    note = f"frames {first} to {end - 1} of {count}, about rest, are fitted by the object's outline"
    clip = replace(steady.clip, notes=(*steady.clip.notes, note))
    trials = _Trials(clip, settings, steady.sway)
    places, misfits = yield from _tried(trials)
    behind, sd, bend = trials.best(places, misfits, drawn=not held_at)
    hidden_px, hidden_log = yield from _hidden(trials, behind, _log_young(places, misfits, behind))
    if steady.sway is not None:
        swayed, *_ = trials.best(places, [replace(one, misfit=one.misfit_swayed) for one in misfits], drawn=not held_at)
        sd = math.hypot(sd, swayed - behind)
    z, tracks, body, settings = trials.at(behind)
    length_px = trials.end_px + behind
    scale_sd, log_sd = (math.hypot(*pair) for pair in zip(_doubts(sd, bend, length_px, steady.sway, depth_told=trials.depth_told), (hidden_px / length_px, hidden_log), strict=True))
    sd = math.hypot(sd, hidden_px)
    px_per_m = clip.camera.focal_px / z
    hanging = replace(hanging, behind_px=behind, behind_px_sd=sd, px_per_m=px_per_m, px_per_m_sd=px_per_m * scale_sd, log10_young_sd=log_sd)
    from ..depth import DepthSource

    source = DepthSource("a plane across the line of sight", trials.scale_words(hanging))
    body = replace(body, sources=body.sources | trials.words(hanging, held_at or "clamp_px"))
    return Outlined(clip, trials.depth(z), source, tracks, body, settings, hanging, whole, steady.moved)


def _tried(trials: _Trials) -> Generator[Progress, None, tuple[list[float], list[Hung]]]:
    """Places of the clamp behind its line [px], and how the body hangs from each."""
    places: list[float] = []
    found: list[Hung] = []
    for behind in trials.places(found):
        places.append(behind)
        found.append(trials.hung(behind))
        hidden = ", with parallel sides there" if trials.parallel else ""
        yield Progress("body", text=f"clamp {behind:.0f} px behind its line{hidden}: shape missed by {100 * math.sqrt(found[-1].misfit / found[-1].points):.1f} %")
    return places, found


def _hidden(trials: _Trials, behind: float, log_young: float) -> Generator[Progress, None, tuple[float, float]]:
    """By how much the clamp's place [px] and log10 E change where the sides are parallel beyond the picture: leaning as they do beside its edge they change by
    as much to the other side."""
    if not trials.lean():
        return 0.0, 0.0
    places, found = yield from _tried(trials.upright())
    elsewhere, *_ = trials.best(places, found, drawn=True)
    return elsewhere - behind, _log_young(places, found, elsewhere) - log_young


def _log_young(places: list[float], found: list[Hung], behind: float) -> float:
    """log10 E [Pa] of a body that is held so far behind its line."""
    return float(np.interp(behind, places, np.log10([one.young for one in found])))


def _doubts(behind_sd_px: float, bend: float, length_px: float, sway: Sway | None, *, depth_told: bool) -> tuple[float, float]:
    """Relative standard deviation of the scale, and standard deviation of log10 E: by the clamp's place, which moves that by `bend` a pixel, by where the end
    lies, along an object of that length, and by its depth across the picture."""
    end_sd_px = 0.0 if sway is None else sway.along_sd_px
    scale_sd = math.hypot(behind_sd_px, EDGE_PX, end_sd_px) / length_px
    return scale_sd, math.hypot(bend * behind_sd_px, 0.0 if depth_told else DEPTH_SD, SCALE_POWER * math.log10(1 + end_sd_px / length_px))


def _camera(camera: Camera) -> Camera:
    """The camera, or where its lens was assumed one so far away that its rays are parallel."""
    if camera.lens_told:
        return camera
    focal = camera.width / 2 / math.tan(math.radians(FAR_FOV_DEG) / 2)
    matrix = camera.pixel_from_camera.copy()
    matrix[0, 0] = matrix[1, 1] = focal
    return replace(camera, pixel_from_camera=matrix)


def _with_clamp(clip: Clip, settings: Settings) -> tuple[Settings, str]:
    """With the clamp's line where none is told: where the object leaves the picture or meets what is still, else the side of the picture that most of
    it touches; and what was seen, one clause."""
    from ..body import with_edge

    scene, seen = with_edge(clip, settings.scene)
    if scene.clamp_px is not None:
        return replace(settings, scene=scene), seen
    assert clip.labels is not None
    mask = object_mask(clip.labels[0])
    height, width = mask.shape
    right, low = width - 1.0, height - 1.0
    sides = {"upper": (mask[0], [0.0, 0.0, right, 0.0]), "lower": (mask[-1], [0.0, low, right, low]), "left": (mask[:, 0], [0.0, 0.0, 0.0, low]), "right": (mask[:, -1], [right, 0.0, right, low])}
    edge = max(sides, key=lambda name: int(sides[name][0].sum()))
    if not sides[edge][0].any():
        return settings, ""
    return replace(settings, scene=replace(settings.scene, clamp_px=sides[edge][1])), f"not told: the {edge} edge of the picture, which most of the object touches; set scene.clamp_px where that is wrong"


def _require_whole(clip: Clip, settings: Settings) -> None:
    """Raises InputError where the object leaves the picture elsewhere than at its clamp: how long it is nothing shows then."""
    from ..body import cut_off_at

    assert clip.labels is not None
    edge = cut_off_at(object_mask(clip.labels[0]), settings.scene.clamp_px)
    if edge:
        raise InputError(f"{clip.source or 'clip'}: the object leaves the picture at its {edge} edge too, away from its clamp, so that its free end is not seen; film it whole")


def _steadied(clip: Clip, settings: Settings) -> Steadied:
    from ..outline import follow_outline

    depth0 = _Trials(clip, settings).depth(ASSUMED_DISTANCE_M)
    return steadied(clip, lambda seen: follow_outline(seen, depth0))


class _Trials:
    """Bodies that hang from clamps at several places."""

    def __init__(self, clip: Clip, settings: Settings, sway: Sway | None = None):
        from ..outline import end_of, rest_cover, rest_outline

        self.clip, self.settings, self.sway, self.parallel = clip, settings, sway, False
        assert clip.labels is not None
        self.mask = object_mask(clip.labels[0])
        self.line = None if settings.scene.clamp_px is None else np.reshape(np.array(settings.scene.clamp_px, float), (2, 2))
        outline = rest_outline(clip)
        self.soft = rest_cover(clip, outline)
        self.end_px = end_of(outline.pixels, self.line) if self.line is not None else extent_px(self.mask)
        self.depth_told = settings.scene.thickness_m is not None

    def places(self, found: Sequence[Hung]) -> Iterator[float]:
        """Of the clamp behind its line [px], on from the last as long as that fits best of all `found` so far; where it is in the picture the line
        itself, and one more that says what its place does to E."""
        shares = BEHIND if self._beyond() else BEHIND[: 1 if self.line is None else 2]
        yield from (share * self.end_px for share in shares)
        share = shares[-1]
        while share and share + STEP <= FURTHEST + STEP / 2 and _falls(found):
            share += STEP
            yield share * self.end_px

    def _beyond(self) -> bool:
        """Whether the clamp may lie beyond the picture."""
        line = self.settings.scene.clamp_px
        return line is not None and along_border(line, self.mask.shape)

    def best(self, places: list[float], found: list[Hung], *, drawn: bool) -> tuple[float, float, float]:
        """Where the clamp is behind its line, the standard deviation of that [px], and by how much log10 E changes a pixel; `drawn`: by a person."""
        from ..body import line_sd_px

        if self._beyond():
            return _best(places, found)
        line = self.settings.scene.clamp_px
        if line is None:
            return 0.0, 0.0, 0.0
        sd = line_sd_px(line, self.mask, drawn=drawn)
        return 0.0, math.hypot(sd, _contradicted_px(places, found, sd)), _slope(places, found)

    def distance(self, behind: float) -> float:
        """Of the object from the camera [m]."""
        size, focal = self.settings.scene.size_m, self.clip.camera.focal_px
        if size is not None and self.settings.scene.length_px is not None:
            return size / length_at_unit_depth(self.clip.camera, self.settings.scene.length_px)
        if size is not None:
            return size * focal / (self.end_px + behind)
        return ASSUMED_DISTANCE_M * focal / (self.clip.camera.width / 2 / math.tan(math.radians(25.0)))

    def depth(self, z: float) -> np.ndarray:
        """Of the object's surface [m], float32 (H, W)."""
        return np.where(self.mask, z, 0.0).astype(np.float32)

    def at(self, behind: float) -> tuple[float, Tracks, Body, Settings]:
        """Distance, outline, body and settings for a clamp so far behind its line [px]."""
        from ..body import build_body
        from ..outline import follow_outline

        z = self.distance(behind)
        depth0, settings = self.depth(z), self.settings
        if settings.scene.thickness_m is None:  # as deep as it is wide
            wide_m = float(self.soft.sum()) / self.end_px * z / self.clip.camera.focal_px
            settings = replace(settings, scene=replace(settings.scene, thickness_m=wide_m))
        return z, follow_outline(self.clip, depth0), build_body(self.clip, depth0, settings, behind_px=behind, soft=self.soft, parallel=self.parallel), settings

    def upright(self) -> _Trials:
        """The same with sides that are parallel where they are not seen."""
        other = copy(self)
        other.parallel = True
        return other

    def lean(self) -> bool:
        """Whether the body's sides lean where it leaves the picture."""
        if not self._beyond():
            return False
        furthest = BEHIND[-1] * self.end_px
        leaning, upright = (trials.at(furthest)[2].inside for trials in (self, self.upright()))
        return not np.array_equal(leaning, upright)

    def hung(self, behind: float) -> Hung:
        """How well that body hangs."""
        from ..start.hang import hung

        z, tracks, body, settings = self.at(behind)
        return hung(body, tracks, self.clip.period_s, settings, camera=self.clip.camera, swayed_m=self._with_swing(z))

    def _with_swing(self, z: float) -> np.ndarray | None:
        """What of the camera's motion may go with the swing, at distance z, (3,), world [m]."""
        if self.sway is None:
            return None
        camera, shift = self.clip.camera, self.sway.as_swing_px * self.sway.direction
        return np.asarray((camera.rays(shift) - camera.rays(0 * shift)) * z)

    def scale_words(self, hanging: Hanging) -> str:
        """What fixed the scale."""
        if not hanging.length_told:
            return "unknown: no length is told (scene.size_m), so that Young's modulus and force hold relative to the object's size alone"
        place = f"{hanging.behind_px:.1f} +- {hanging.behind_px_sd:.1f} px behind the clamp's line"
        return f"size_m {self.settings.scene.size_m:g} m from the held face, {place}, to the free end: {hanging.px_per_m / 1e3:.3g} px/mm"

    def words(self, hanging: Hanging, line: str) -> dict[str, str]:
        """Of the body's sources; `line` says where the clamp's comes from."""
        told = "thickness_m" if self.depth_told else "not told: as deep as it is wide in the picture"
        held = f"{line}; the held face lies {hanging.behind_px:.1f} +- {hanging.behind_px_sd:.1f} px behind this line" if self.line is not None else "none"
        return {"metric_scale": self.scale_words(hanging), "thickness": told, "clamp": held}


def _best(places: list[float], found: list[Hung]) -> tuple[float, float, float]:
    """The place whose shape fits best by a parabola through the best three, its standard deviation [px], and by how much log10 E changes a pixel."""
    misfit = np.array([one.misfit for one in found])
    if _falls(found):  # it lies further out
        return places[-1], places[-1], _slope(places, found)
    k = int(np.clip(misfit.argmin(), 1, len(places) - 2))
    x, y = np.array(places[k - 1 : k + 2]), misfit[k - 1 : k + 2]
    a, b, c = np.polyfit(x, y, 2)
    if a <= 0:
        return places[int(misfit.argmin())], (places[-1] - places[0]) / 2, _slope(places, found)
    best = float(np.clip(-b / (2 * a), places[0], places[-1]))
    least = max(float(np.polyval([a, b, c], best)), 0.25 * float(misfit.min()))
    return best, math.sqrt(least / INDEPENDENT / a), _slope(places, found)


def _contradicted_px(places: list[float], found: list[Hung], sd_px: float) -> float:
    """How far behind a line in the picture, known to `sd_px`, the shape of the swing says that the object is held; 0 where it need not be."""
    if len(found) < 3:  # it is missed by less at the line than anywhere behind it
        return 0.0
    behind, own_sd, _ = _best(places, found)
    return behind if behind > SURELY * math.hypot(sd_px, own_sd) else 0.0


def _falls(found: Sequence[Hung]) -> bool:
    """Whether the last fits best."""
    return min(found, key=lambda one: one.misfit) is found[-1]


def _slope(places: list[float], found: list[Hung]) -> float:
    return float(np.polyfit(places, np.log10([one.young for one in found]), 1)[0])


def with_hanging(start: StartValues, hanging: Hanging) -> StartValues:
    """Start values with what the clamp's place and the depth leave open of E, and said to be relative where no length is told."""
    start = widened(start, hanging.log10_young_sd, "where it is held, behind the line that is told or seen, is not known well enough")
    reasons = start.reasons if hanging.length_told else tuple(f"{r.removesuffix('.')}; no length is told, so E holds relative to the object's size alone." for r in start.reasons)
    return replace(start, reasons=reasons)
