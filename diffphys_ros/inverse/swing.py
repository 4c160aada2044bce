"""The large swing before the calm part: where the body is in it, and whether the modulus of the calm part predicts it.

The outline is followed by a flat body that bends as far as it must (elements.plane): springs along the normals of its own present outline pull it
onto the edges of each picture, from a frame in which it passes rest to both sides in time. Pose and velocity of frame 0 are read from its first frames;
let go from there, without any force but its weight, it must swing as the picture shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..types import Body, Clip, StartValues, Swing, object_mask
from .yielding import CalmSwing, Yielding, fitted

if TYPE_CHECKING:
    from ..elements.plane import FlatSolid
    from .outlined import Outlined

SECONDS = 1.0  # that are predicted [chosen]
FIRST_SHARE, LEAST_FIRST, MOST_FIRST = 0.14, 4, 7  # of a period, and frames, that pose and velocity of the first are read from, by a parabola [chosen]
SPRING = 1.0  # of a point, over E / density: a tip bent by 60 degrees then lies .1 px off its edges, at .1 one pixel and more [chosen]
ROUNDS, SETTLED_PX = 8, 0.02  # of casting normals anew, and the change that ends them [numerical]
REACH_PX = 14.0  # of an edge from where the frame before leads one to expect it [chosen]
BORDER_PX = 4.0  # of the picture, within which no edge counts [chosen]
ALONG = (0.25, 0.75)  # where on a side of an element edges are looked for [numerical]
LEAST_SEEN = 0.5  # of the points, of which an edge must be seen for a frame to count [chosen]
TUNINGS = 3  # of the modulus [numerical]
GIVES = 0.5  # share of the modulus over the strain, for differences [numerical]
SOFTENING_PERIODS, SMALL = 3.0, 0.02  # that are simulated to see how a frequency falls with the swing, and the share of the swing that counts as small [numerical]
TIP_OVER_LAST = 1.15  # motion of the free end over that of the last points that are followed, a tenth of the length before it [chosen]
STEPS_A_PERIOD = 90.0  # of the integration, at the least [numerical]
LEADING_STEPS = 40.0  # a period, where the next picture shows how far off they lead [numerical]
HELD = 0.02  # of the way from side to side, by which an object that is held still is seen to move: let go, it passes that within a twentieth of a period [chosen]
LEAST_SWING_PX = 1.0  # of the tip: less is no large swing [chosen]


def swing_of(whole: Clip, seen: Outlined, start: StartValues) -> Swing | None:
    """What the modulus of the calm part makes of the first second of the whole labelled clip; None where the body cannot be followed there, or
    bends under its weight as no elements do."""
    from ..elements.plane import DivergedError

    try:
        return _swing_of(whole, seen, start)
    except DivergedError:
        return None


def _swing_of(whole: Clip, seen: Outlined, start: StartValues) -> Swing | None:
    from ..elements.plane import FlatSolid

    body = seen.body
    if not body.clamped:
        return None
    hz = float(start.frequencies_hz[np.abs(start.frequencies_hz - start.observed_hz[0]).argmin()])  # of the whole fit, not of a few differences
    first = first_frames(hz, whole.period_s)
    begin = _let_go_at(_aside(whole, seen.hanging.rest_frame), first)
    whole, seen = whole.part(begin, len(whole)), replace(seen, hanging=seen.hanging.cut(begin))
    follower = Follower.of(FlatSolid.of(body), whole, seen, float(start.young[0] / body.density[0]), body).tuned(hz)
    count = min(len(whole), round(SECONDS / whole.period_s) + first)
    poses = follower.poses(count)
    if poses is None:
        return None
    told = follower.tip(poses[first // 2 :])
    motion = float(np.sqrt(((told - told.mean(0)) ** 2).sum(1).mean()))
    if motion < LEAST_SWING_PX:
        return None
    times = (np.arange(first) - first // 2) * whole.period_s
    _, v, u = np.polyfit(times, poses[:first], 2)
    calm = calm_swing(follower, seen, start, hz)

    def let_go(law: Yielding) -> np.ndarray | None:
        under = follower.obeying(law, calm)
        free = under.let_go(u, v, drag_per_s=calm.drag(law), drag_per_m=law.drag_per_m, hz=hz, frames=len(told))
        return None if free is None else under.tip(free)

    found = fitted(let_go, told)
    if found is None:
        return None
    error, constant = (float(np.sqrt(((tip - told) ** 2).sum(1).mean())) for tip in (found.tip, found.constant))
    return Swing(len(told), motion, error, error / motion, constant / motion, found.law.softens, found.law.drag_per_m, hz / calm.small_hz(found.law), begin)


def first_frames(hz: float, period_s: float) -> int:
    """How many frames pose and velocity of the first are read from, where a swing has that frequency: along more of a fast one no parabola lies."""
    return int(np.clip(round(FIRST_SHARE / (hz * period_s)), LEAST_FIRST, MOST_FIRST))


def calm_swing(follower: Follower, seen: Outlined, start: StartValues, hz: float) -> CalmSwing:
    """What the calm frames say of a swing, with the frequency of their leading mode."""
    drag = float(start.damping.mass_per_s + start.damping.stiffness_s * (2 * np.pi * hz) ** 2)  # all of it as of the mass: of strain it would brake what turns
    return follower.calm(hz, drag, _tip_amplitude(seen), seen.hanging.periods)


@dataclass(frozen=True)
class Follower:
    """A flat body and the pictures that it is laid onto."""

    plane: FlatSolid  # without load
    whole: Clip
    load: np.ndarray
    specific: float  # E / density [m^2/s^2]
    rest: np.ndarray  # displacements under the weight
    to_picture: np.ndarray  # (3, 2): of plane coordinates x, y, 1 [px]
    level: np.ndarray  # grey level of the edge at each point, (P,)
    contrast: np.ndarray  # (P,)
    aside: np.ndarray  # of the object's centroid from where it is at rest in each frame [px], (T, 2)
    from_rest: int  # frame in which it passes rest

    @classmethod
    def of(cls, plane: FlatSolid, whole: Clip, seen: Outlined, specific: float, body: Body) -> Follower:
        """Its levels are those of the calm part's first frame, whose outline it has; it rests where the calm part swings about, half of a frame's way off."""
        from ..outline import edge_levels, middle

        load = plane.weight(body.gravity[:2])
        sag = plane.balanced(specific, load, np.zeros(2 * len(plane.nodes)))
        unloaded = replace(plane, nodes=plane.nodes - sag.reshape(-1, 2))
        load = unloaded.weight(body.gravity[:2])
        rest = unloaded.balanced(specific, load, sag)
        height = float(body.half_thickness[body.inside].max())
        corners = np.array([[0.0, 0.0, height], [1.0, 0.0, height], [0.0, 1.0, height]])
        pixels = seen.clip.camera.project(body.to_world(corners))[0]
        to_picture = np.stack([pixels[1] - pixels[0], pixels[2] - pixels[0], pixels[0]])
        aside = _aside(whole, seen.hanging.rest_frame)
        begun = cls(unloaded, whole, load, specific, rest, to_picture, np.zeros(0), np.zeros(0), aside, _passes_rest(aside))
        points, normals, _ = begun.edges(rest)
        level, contrast = edge_levels(seen.clip.frames[0], points, normals)
        calm = aside[seen.hanging.rest_frame : seen.hanging.end_frame]
        hz, _ = begun._mode_by_centroid()
        return replace(begun, level=level, contrast=contrast).resting_at(middle(calm, hz * whole.period_s))

    def resting_at(self, aside: np.ndarray) -> Follower:
        """The same whose centroid in the picture is at rest so far (2,) [px] from where it is now, along its leading mode."""
        moved = self._mode_by_centroid()[1] @ aside
        still = self.aside - aside
        return replace(self, plane=replace(self.plane, nodes=self.plane.nodes + moved.reshape(-1, 2)), aside=still, from_rest=_passes_rest(still))

    def tuned(self, hz: float) -> Follower:
        """The same at the modulus at which its own small swing has the calm part's frequency: what its elements are off by must not add up over
        many periods. Gravity's share does not change with the modulus, so that the tangent is known at both ends."""
        specific, still = self.specific, 0 * self.load
        for _ in range(TUNINGS):
            square, elastic = self.plane.frequency(specific, self.load) ** 2, self.plane.frequency(specific, still) ** 2
            specific *= max(1 + (hz**2 - square) / elastic, 0.5)
        rest = self.plane.balanced(specific, self.load, self.rest)
        return replace(self, specific=specific, rest=rest)

    def let_go(self, u: np.ndarray, v: np.ndarray, *, drag_per_s: float, drag_per_m: float = 0.0, hz: float, frames: int) -> np.ndarray | None:
        """Displacements (frames, 2 N) of the free motion from u with velocity v at the clip's frames; None where no steps are short enough."""
        from ..elements.plane import DivergedError

        period_s = self.whole.period_s
        substeps = max(int(np.ceil(STEPS_A_PERIOD * hz * period_s)), 1)
        try:
            return self.plane.march(self.specific, self.load, u, v, drag_per_s=drag_per_s, drag_per_m=drag_per_m, step_s=period_s / substeps, steps=(frames - 1) * substeps)[::substeps]
        except DivergedError:
            return None

    def obeying(self, law: Yielding, calm: CalmSwing) -> Follower:
        """The same of a material that gives way, with the calm frames' frequency."""
        return replace(self, plane=replace(self.plane, softens=law.softens)).tuned(calm.small_hz(law))

    def calm(self, hz: float, drag_per_s: float, tip_px: float, periods: float) -> CalmSwing:
        """The swing of the calm frames: frequency, drag, amplitude of the tip [px] at its begin, and how many periods."""
        mode = self.plane.slowest(self.specific, self.load, self.rest)[1]
        moved = np.hypot(*((self._bent(mode, tip_px) - self.rest).reshape(-1, 2).T))
        weight = np.asarray(self.plane.mass.sum(1)).ravel()[::2]
        usual = float((weight * moved**3).sum() / max((weight * moved**2).sum(), 1e-30))  # of an amplitude, as drag of squared speed weighs it
        constant, giving = (replace(self, plane=replace(self.plane, softens=share)).softening(hz, mode, tip_px, periods) for share in (0.0, GIVES))
        return CalmSwing(hz, drag_per_s, 8 / (3 * np.pi) * 2 * np.pi * hz * usual, (constant, (giving - constant) / GIVES))

    def _bent(self, mode: np.ndarray, tip_px: float) -> np.ndarray:
        """Displacements (2 N,) with the tip so far aside along a mode."""
        size = np.linalg.norm(self.tip((self.rest + mode)[None]) - self.tip(self.rest[None]))
        return self.rest + mode * tip_px / max(float(size), 1e-12)

    def softening(self, hz: float, mode: np.ndarray, tip_px: float, periods: float) -> float:
        """By how much the leading frequency of a swing that begins with such a tip's amplitude [px] is lower than that of a small one, as a factor."""
        step_s = 1 / (STEPS_A_PERIOD * hz)
        steps = round(STEPS_A_PERIOD * min(periods, SOFTENING_PERIODS))
        moved = [self.plane.march(self.specific, self.load, self._bent(mode, share * tip_px), 0 * mode, drag_per_s=0.0, step_s=step_s, steps=steps) for share in (SMALL, 1.0)]
        small, large = (self._frequency(u, step_s) for u in moved)
        return large / small

    def _frequency(self, u: np.ndarray, step_s: float) -> float:
        """Of the tip in a free motion (T, 2 N) [Hz], by where it passes its middle."""
        moved = self.tip(u) - self.tip(self.rest[None])
        along = moved @ np.linalg.svd(moved, full_matrices=False)[2][0]
        k = np.flatnonzero(along[:-1] * along[1:] < 0)
        at = k + along[k] / (along[k] - along[k + 1])
        return float((len(at) - 1) / 2 / ((at[-1] - at[0]) * step_s))

    def edges(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, sp.csr_matrix]:
        """Points (P, 2) [px] on the outline of a pose, unit normals out of it (P, 2), and the matrix (2 P, 2 N) that takes displacements to theirs."""
        border, place = self.plane.border, self.plane.nodes + u.reshape(-1, 2)
        shape = np.array([[(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)] for s in ALONG])
        slope = np.array([[4 * s - 3, 4 - 8 * s, 4 * s - 1] for s in ALONG])
        points = np.einsum("qk,bkc->bqc", shape, place[border]).reshape(-1, 2)
        along = np.einsum("qk,bkc->bqc", slope, place[border]).reshape(-1, 2) @ self.to_picture[:2]
        normal = np.stack([along[:, 1], -along[:, 0]], 1) / np.linalg.norm(along, axis=1, keepdims=True)
        pixels = points @ self.to_picture[:2] + self.to_picture[2]
        turned = np.linalg.det(self.to_picture[:2]) < 0  # the picture's y points down
        rows = np.arange(len(points))
        nodes = np.repeat(border, len(ALONG), 0)
        values = np.tile(shape, (len(border), 1))
        single = sp.csr_matrix((values.ravel(), (np.repeat(rows, 3), nodes.ravel())), (len(points), len(place)))
        return pixels, -normal if turned else normal, sp.kron(single, sp.identity(2)).tocsr()

    def poses(self, count: int) -> np.ndarray | None:
        """Displacements (count, 2 N) in the first frames; None where the outline is lost."""
        begin, period_s = self.from_rest, self.whole.period_s
        hz, mode = self._mode_by_centroid()
        expected = self.rest + mode @ self.aside[begin]
        around = np.clip([begin - 1, begin + 1], 0, len(self.aside) - 1)
        v = mode @ np.subtract(*self.aside[around[::-1]]) / max(np.ptp(around) * period_s, period_s)
        first = self.laid_onto(self.whole.frames[begin], expected)
        if first is None:
            return None
        found = {begin: first}
        for frames, velocity in ((range(begin + 1, count), v), (range(begin - 1, -1, -1), -v)):
            pose = first
            for k in frames:
                expected, velocity = self._a_frame_on(pose, velocity, hz)
                seen = self.laid_onto(self.whole.frames[k], expected)
                if seen is None:
                    return None
                velocity = velocity + (seen - expected) / period_s
                found[k] = pose = seen
        return np.stack([found[k] for k in range(count)])

    def _a_frame_on(self, u: np.ndarray, v: np.ndarray, hz: float) -> tuple[np.ndarray, np.ndarray]:
        """Pose and velocity (2 N,) a frame later, let go: at few frames a second no line through the poses before leads to the edges."""
        from ..elements.plane import DivergedError

        period_s = self.whole.period_s
        steps = max(int(np.ceil(LEADING_STEPS * hz * period_s)), 1)
        try:
            path = self.plane.march(self.specific, self.load, u, v, drag_per_s=0.0, step_s=period_s / steps, steps=steps + 1)
        except DivergedError:
            return u + period_s * v, v
        return path[steps], (path[steps + 1] - path[steps - 1]) * steps / (2 * period_s)

    def _mode_by_centroid(self) -> tuple[float, np.ndarray]:
        """Frequency of the leading mode [Hz], and displacements along it by a motion of the centroid of what the picture shows [1/px], (2 N, 2)."""
        hz, mode = self.plane.slowest(self.specific, self.load, self.rest)
        place = (self.plane.nodes + self.rest.reshape(-1, 2)) @ self.to_picture[:2] + self.to_picture[2]
        shown = ((place >= 0) & (place < np.array(self.whole.frames.shape[2:0:-1]))).all(1)
        weight = np.where(shown, np.asarray(self.plane.mass.sum(1)).ravel()[::2], 0.0)
        centroid = weight @ mode.reshape(-1, 2) / weight.sum() @ self.to_picture[:2]
        return hz, np.outer(mode, centroid / (centroid @ centroid))

    def laid_onto(self, frame: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        """The pose in a picture near an expected one; None where too little of its outline is seen."""
        from ..elements.plane import DivergedError

        try:
            return self._laid_onto(frame, start)
        except DivergedError:  # by edges of something else
            return None

    def _laid_onto(self, frame: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        from ..outline import edge_distances

        u, free = start, self.plane.free
        stiff = SPRING * self.specific
        height, width = frame.shape[:2]
        for _ in range(ROUNDS):
            pixels, normals, sampled = self.edges(u)
            off = edge_distances(frame, pixels, normals, self.level, self.contrast, REACH_PX)
            inside = ((pixels > BORDER_PX) & (pixels < np.array([width, height]) - 1 - BORDER_PX)).all(1)
            known = np.isfinite(off) & inside
            if known.sum() < LEAST_SEEN * max(inside.sum(), 1):
                return None
            own = normals @ self.to_picture[:2].T  # gradient of the distance by plane coordinates [px/m]
            size = np.linalg.norm(own, axis=1)
            direction, off_m = own / size[:, None], off / size
            rows = np.arange(len(off))
            along = sp.csr_matrix((direction.ravel(), (np.repeat(rows, 2), (2 * rows[:, None] + np.arange(2)).ravel())), (len(off), 2 * len(off))) @ sampled
            weight = sp.diags(np.where(known, stiff, 0.0))
            springs = (along.T @ weight @ along).tocsc()
            pull = along.T @ (weight @ (along @ u + np.where(known, off_m, 0.0)))
            new = self.plane.balanced(self.specific, self.load, u, springs, np.asarray(pull).ravel())
            moved = np.abs((new - u)[free]).max() * np.abs(self.to_picture[:2]).max()
            u = new
            if moved < SETTLED_PX:
                break
        return u

    def tip(self, u: np.ndarray) -> np.ndarray:
        """Middle of the free end (T, 2) [px] in poses (T, 2 N)."""
        x = self.plane.nodes[:, 0]
        end = x > x.max() - 0.02 * np.ptp(x)
        return (self.plane.nodes[end] + u.reshape(len(u), -1, 2)[:, end]).mean(1) @ self.to_picture[:2] + self.to_picture[2]


def _tip_amplitude(seen: Outlined) -> float:
    """Of the calm frames on the whole [px]: what moves most of the outline, continued to the free end along the leading mode of a beam."""
    moved = ((seen.tracks.pixels - seen.tracks.pixels.mean(0)) ** 2).sum(-1)
    far = moved.mean(0).max()
    return float(np.sqrt(2 * far)) * TIP_OVER_LAST


def _aside(whole: Clip, rest_frame: int) -> np.ndarray:
    """How far the object's centroid is from where it is in a frame (T, 2) [px]."""
    assert whole.labels is not None
    inside = object_mask(whole.labels)
    size = np.maximum(inside.sum((1, 2)), 1)
    centre = np.stack([(inside.sum(axis) @ np.arange(inside.shape[3 - axis])) / size for axis in (1, 2)], 1)
    return np.asarray(centre - centre[rest_frame])


def _let_go_at(aside: np.ndarray, least: int) -> int:
    """The frame from which an object moves that is held still for `least` frames and more; 0 where it moves from the start."""
    along = aside @ np.linalg.svd(aside - aside.mean(0), full_matrices=False)[2][0]
    moves = int((np.abs(along - along[0]) > HELD * np.ptp(along)).argmax())
    return moves if moves > least else 0


def _passes_rest(aside: np.ndarray) -> int:
    """The first frame in which the object passes its pose at rest."""
    along = aside @ np.linalg.svd(aside - aside.mean(0), full_matrices=False)[2][0]
    crossing = np.flatnonzero(along[:-1] * along[1:] <= 0)
    k = int(crossing[0]) if len(crossing) else int(np.abs(along).argmin())
    return k if abs(along[k]) <= abs(along[min(k + 1, len(along) - 1)]) else k + 1
