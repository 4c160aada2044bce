"""How a camera in a hand, or what holds the object, moves: by what the outline of an object that swings does and no bending can. Needs OpenCV.

A held body bends: near its clamp its sides hardly move, at its free end they do. What moves all points of both sides by the same is no bending. A
background without contrast shows nothing of it; the outline does:

    d(t, p) = s(t) + sum_k f_k(p) q(t)^k

with d the motion across the object of a point p on a side, s that of the whole, q the swing. q is seen in what points move by more than others. How
much of q is in s too is told by time alone: a hand is slow, so that s is the smoothest one (Whittaker 1923; penalty on third differences). Along the
object the end face tells, which foreshortening moves by powers of q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..types import Clip, Tracks, object_mask
from .edges import grey_of, outline_of
from .reference import strongest

ACROSS = 0.7  # cosine between a point's normal and the direction across the object, or along it, from which on it shows a motion that way [chosen]
LEAST_POINTS = 12  # on sides [chosen]
PRINCIPAL, ROUNDS = 3, 10  # motions that fill gaps, and rounds of that [numerical]
POWERS = 3  # of the swing: foreshortening and the like are of second and third order [chosen]
PADDING = 16  # of the spectrum [numerical]
ORDER = 3  # of the differences that are penalised [numerical]
SLOW = 0.5  # frequency over that of the swing, below which the hand alone moves [chosen]
FAST, FAST_ALONG = 2.0, 1.0  # above which a shift is noise: across, and along where fewer points tell [chosen]
SETTLING = 6  # rounds of leaving out frames [numerical]
WRONG, WRONG_PX = 6.0, 0.05  # standard deviations off the rest by which a frame shows something else, and what such a one is at the least [chosen]
SPACING_PX, LEAST_ON_END = 1, 3  # of points on the end face, and how many there must be [chosen]
MIDDLE = 0.5  # share of that face, about its middle, that is read: towards corners an edge is rounded off [chosen]
REACH_PX = 15.0  # that the end face is looked for along the object [chosen]
LEAST_PX, LEAST_ALONG_PX = 0.3, 0.6  # slow shift across, and along, from which on a camera moves: of ten films on a tripod show .21 and .42 at the most, [docs/measurements/films.md]
OF_FORESHORTENED = 0.2  # of what foreshortening moves the end face by, that a slow shift along must have as well: the same films show .10 at the most where that is more than a pixel [docs/measurements/films.md]
NEAREST, SWINGS = 6, 0.7  # points of the sides that say how far an end goes aside; and the share of the widest of their motions that the free end has [chosen]


@dataclass(frozen=True)
class Sway:
    """What all of an object moves by."""

    shift_px: np.ndarray  # of each frame, (T, 2); nought is where the slow part puts frame 0. Across and along the object, each where it is large enough to be one
    size_px: float  # how far its part that is slower than the swing comes from where it is in frame 0; 0 where there is none
    sd_px: float  # of a frame's shift across
    direction: np.ndarray  # across the object, (2,)
    to_rest: int  # how many frames after frame 0, or before it, the object is nearest to rest: a hand hides that from what labels show
    along_sd_px: float  # standard deviation of a shift along the object, where no end face tells it; else 0
    as_swing_px: float  # standard deviation of what goes with the swing, root mean square over time, which nothing tells from it: as much as is seen of the same frequencies out of phase


@dataclass(frozen=True)
class _Sides:
    """The sides of an object that is followed."""

    direction: np.ndarray  # across it, (2,)
    pixels: np.ndarray  # of the points in frame 0 [px], (P, 2)
    moved: np.ndarray  # across, about their medians [px], (T, P)


@dataclass(frozen=True)
class _Alike:
    """A motion without what of it is a swing, of T frames."""

    shift: np.ndarray  # [px], (T,)
    slow: np.ndarray
    smooth: np.ndarray
    swing: np.ndarray  # what was taken off

    def over_first(self, least_px: float) -> tuple[np.ndarray, np.ndarray]:
        """The smooth motion and the slow one, from where that is in frame 0; nothing where the slow one comes less far."""
        slow = self.slow - self.slow[0]
        return (self.smooth - self.slow[0], slow) if np.abs(slow).max() >= least_px else (0 * slow, 0 * slow)


def sway_of(clip: Clip, tracks: Tracks) -> Sway | None:
    """Of a labelled clip and its outline as it is followed; None where too little of its sides is seen."""
    sides = _sides(tracks, clip)
    if sides is None:
        return None
    weight = np.ones(len(clip))
    for _ in range(SETTLING):
        mean, q = _mean_and_swing(sides.moved, weight)
        frequency = strongest(q * weight, PADDING)
        across = _alike(mean, q, frequency, weight, fast=FAST)
        off = np.abs(across.shift - across.smooth)
        right = (off <= WRONG * max(1.4826 * float(np.median(off[weight > 0])), WRONG_PX)).astype(float)
        if (right == weight).all():
            break
        weight = right
    sideways, moved = across.over_first(LEAST_PX)
    axis, lengthways = np.array([-sides.direction[1], sides.direction[0]]), np.zeros(len(clip))
    end = _end(clip, sides, axis)
    if end is not None:
        seen = np.isfinite(end)
        along = _alike(np.where(seen, end, 0.0), q, frequency, weight * seen, fast=FAST_ALONG)
        lengthways, slow = along.over_first(max(LEAST_ALONG_PX, OF_FORESHORTENED * float(np.ptp(along.swing[seen]))))
        moved = np.hypot(moved, slow)
    return Sway(
        shift_px=sideways[:, None] * sides.direction + lengthways[:, None] * axis,
        size_px=float(np.abs(moved).max()),
        sd_px=float((across.shift - across.smooth)[weight > 0].std()),
        direction=sides.direction,
        to_rest=_to_rest(q, 1 / frequency),
        along_sd_px=0.0 if end is not None else float(sideways.std()),
        as_swing_px=float((across.smooth - across.slow).std()),
    )


def _sides(tracks: Tracks, clip: Clip) -> _Sides | None:
    if tracks.normals is None:
        return None
    normal = clip.camera.normals_in_picture(tracks.normals)
    direction = np.linalg.svd(normal, full_matrices=False)[2][0]
    along = normal @ direction
    side = np.abs(along) > ACROSS
    if side.sum() < LEAST_POINTS:
        return None
    moved = ((tracks.pixels - tracks.pixels[:1]) * normal).sum(-1)[:, side] / along[side]
    return _Sides(direction, tracks.pixels[0, side], _filled(np.where(tracks.valid[:, side] & clip.seen[:, None], moved, np.nan)))


def _end(clip: Clip, sides: _Sides, axis: np.ndarray) -> np.ndarray | None:
    """What the face of the free end moves by along the object [px], (T,), NaN where it is not seen: read where it has gone aside to. None where there
    is no such face."""
    assert clip.labels is not None
    outline = outline_of(grey_of(clip.frames[0]), object_mask(clip.labels[0]), SPACING_PX)
    outline = outline.only((np.abs(outline.normals @ axis) > ACROSS) & (outline.contrast != 0))
    if not len(outline.pixels):
        return None
    near = np.argsort(np.abs((outline.pixels @ axis)[:, None] - sides.pixels @ axis), axis=1, kind="stable")[:, :NEAREST]
    width = sides.moved.std(0)
    free = width[near].mean(1) > SWINGS * width.max()
    if not free.any():
        return None
    outline, aside = outline.only(free), sides.moved[:, near[free]].mean((1, 2))
    beside = outline.pixels @ sides.direction
    outline = outline.only(np.abs(beside - (beside.max() + beside.min()) / 2) <= MIDDLE * np.ptp(beside) / 2)
    if len(outline.pixels) < LEAST_ON_END:
        return None
    aside = aside - aside[0]
    read = [replace(outline, pixels=outline.pixels + by * sides.direction).distances(frame, REACH_PX) for frame, by in zip(clip.frames, aside, strict=True)]
    seen = np.array(read) * np.sign(outline.normals @ axis)
    known = np.isfinite(seen).all(1) & clip.seen
    middle = np.full(len(clip), np.nan)
    middle[known] = np.median(seen[known] - np.median(seen[known], axis=0), axis=1)
    return middle if known.mean() > 0.5 else None


def _alike(mean: np.ndarray, q: np.ndarray, frequency: float, weight: np.ndarray, *, fast: float) -> _Alike:
    """What of a motion (T,) is no swing q (T,) of that frequency [1/frame]: of what they have in common, all but what a slow motion can be is the swing's."""
    powers = np.stack([q**k for k in range(1, POWERS + 1)], 1)
    powers = (powers - _average(powers, weight)) / powers.std(0)
    slow = _smoother(SLOW * frequency, weight)
    rough = powers.T @ (weight[:, None] * (np.eye(len(q)) - slow))
    shift = mean - powers @ np.linalg.lstsq(rough @ powers, rough @ mean, rcond=None)[0]
    return _Alike(shift, slow @ shift, _smoother(fast * frequency, weight) @ shift, mean - shift)


def _to_rest(q: np.ndarray, period: float) -> int:
    """Where a swing (T,) of that period [frames] passes its mean nearest to frame 0, or would have before it."""
    about = q - q[: max(int(len(q) // period * period), 1)].mean()
    after = int(np.abs(about[: round(period / 2) + 1]).argmin())
    return after if after <= period / 4 else after - round(period / 2)


def _mean_and_swing(moved: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What points (T, P) move by on average, (T,), and the strongest motion of what they move by beyond that, root mean square over them, (T,)."""
    about = moved - _average(moved, weight)
    mean = about.mean(1)
    beyond = about - mean[:, None]
    shape = np.linalg.svd(weight[:, None] * beyond, full_matrices=False)[2][0]
    return mean, beyond @ shape / np.sqrt(moved.shape[1])


def _average(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return np.asarray(np.tensordot(weight, values, 1) / weight.sum())


def _smoother(frequency: float, weight: np.ndarray) -> np.ndarray:
    """Matrix (T, T) that leaves of a motion what is slower than a frequency [1/frame], by the frames that count (T,)."""
    rough = np.diff(np.eye(len(weight)), ORDER, axis=0)
    penalty = (2 * np.sin(np.pi * min(frequency, 0.5))) ** (-2 * ORDER)
    return np.linalg.solve(np.diag(weight) + penalty * rough.T @ rough, np.diag(weight))


def _filled(moved: np.ndarray) -> np.ndarray:
    """Motions (T, P) about each point's median, gaps (NaN) filled by the principal motions."""
    known = np.isfinite(moved)
    about = moved - np.nanmedian(moved, 0)
    filled = np.where(known, about, 0.0)
    for _ in range(ROUNDS):
        u, s, vt = np.linalg.svd(filled, full_matrices=False)
        filled = np.where(known, about, (u[:, :PRINCIPAL] * s[:PRINCIPAL]) @ vt[:PRINCIPAL])
    return filled
