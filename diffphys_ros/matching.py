"""Sub-pixel correspondences from frame 0 straight to every other frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from .similarity import robust_similarity

LARGEST_JUMP_PX = 3.0  # from the prediction of the frame before
LARGEST_ODDITY_PX = 1.2  # from the median displacement of the neighbours
DRIFT_ROUND_TRIP_PX = 0.7  # forward-backward error accepted for the prediction alone
NEIGHBOURS = 9  # points whose median a point is compared with
AROUND = 20  # points whose affine motion tells where another one is
LEAST_FOUND = 0.5  # of the points that held in the frame before; with fewer the object has leapt
LEAP = 3.0  # of the points' box, within which it is looked for
COARSE = 4  # pixels side by side that count as one, so that an object that turns or comes nearer still looks like itself
LEAST_LIKENESS = 0.35  # correlation with the frame before at which it counts as found: chance gives a tenth, a block that turns by 2 degrees .49
TURNED = np.radians(12.0)  # by which an object has turned, from where on frame 0 is turned along before patches are compared: a patch that stays level loses it at 15 to 20 degrees
TURN_ROUNDS, LEAST_OFF_PX = 6, 1e-3  # of reweighting, and deviation below which all weigh alike
RIGIDITY_PX2 = 2.0  # added to their second moment: where they lie in a line, a point moves along with them and no more


@dataclass(frozen=True)
class Matching:
    """How a point is matched."""

    window_px: int
    round_trip_px: float
    turns: bool = False  # whether the object may turn as a whole, as what nothing holds does: what is held bends, and a turn of all of it fits its end alone


def normalised(frame: np.ndarray) -> np.ndarray:
    """Grey image divided by its local mean and deviation, uint8 (H, W): shading changes when a face turns, texture does not."""
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    mean = cv2.GaussianBlur(grey, (0, 0), 8)
    deviation = np.sqrt(cv2.GaussianBlur((grey - mean) ** 2, (0, 0), 12) + 9)
    return np.clip(128 + 45 * (grey - mean) / deviation, 0, 255).astype(np.uint8)


def seed_points(image: np.ndarray, mask: np.ndarray, *, spacing_px: int, most: int) -> np.ndarray:
    """Evenly spread, textured points on the object [px], float32, shape (M, 2), M <= most.

    One point per square cell: the pixel with the largest smaller eigenvalue of the structure tensor.
    """
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    strength = np.where(inner, cv2.cornerMinEigenVal(image, 9, 3), -1.0)
    v, u = np.nonzero(inner)
    if not len(v):
        return np.zeros((0, 2), np.float32)
    cell = max(spacing_px, int(np.ceil(np.sqrt(len(v) / most))))
    order = np.lexsort((-strength[v, u], u // cell, v // cell))
    v, u = v[order], u[order]
    first = np.r_[True, (np.diff(v // cell) != 0) | (np.diff(u // cell) != 0)]
    points = np.stack([u[first], v[first]], -1)
    value = strength[points[:, 1], points[:, 0]]
    points = points[value >= np.quantile(value, 0.15)]
    return points[np.linspace(0, len(points) - 1, min(most, len(points))).astype(int)].astype(np.float32)


def track_pixels(images: list[np.ndarray], start: np.ndarray, seen: np.ndarray, matching: Matching) -> tuple[np.ndarray, np.ndarray]:
    """Positions [px] (T, M, 2) and validity (T, M) of points `start` (M, 2) of frame 0 in every frame.

    Every frame is matched against frame 0 (no drift), starting from where the frame before predicts the point. A point that is not
    found there is looked for once more where the motion of those found puts it, so that what is lost in one frame comes back in the next.
    """
    pixels = np.repeat(start[None], len(images), 0)
    valid = np.zeros((len(images), len(start)), bool)
    valid[0] = True
    if not len(start):
        return pixels, valid
    last = 0
    for k in range(1, len(images)):
        pixels[k] = pixels[last]
        if not seen[k]:
            continue
        frames = (images[0], images[last], images[k])
        found, good = _followed(frames, pixels[last], pixels[last], start, matching)
        if good.sum() < LEAST_FOUND * valid[last].sum():
            others = _farther(frames, pixels[max(2 * last - k, 0)], pixels[last], valid[last], matching)
            answers = [(found, good), *(_followed(frames, pixels[last], guess, start, matching) for guess in others)]
            found, good = max(answers, key=lambda answer: int(answer[1].sum()))
        if AROUND <= good.sum() < len(good):
            lost = np.flatnonzero(~good)
            expected = (start[lost] + affine_motion(start[lost], start[good], (found - start)[good])[0]).astype(np.float32)
            found[lost], good[lost] = _found(images[0], images[k], start[lost], expected, matching)
            good = _agreeing(start, found, _turn(start[good], found[good]) if matching.turns else None, good)
        pixels[k], valid[k], last = found, good, k
    return pixels, valid


def _farther(frames: tuple[np.ndarray, np.ndarray, np.ndarray], before: np.ndarray, at: np.ndarray, holds: np.ndarray, matching: Matching) -> list[np.ndarray]:
    """Where points `at` (M, 2) of the second of three frames may have gone in the third, farther than patches reach: with the whole of those that hold
    (M,), which is looked for, and, of what turns, as they came from where they were `before` (M, 2), as long a time ago."""
    leap = whole_shift(frames[1], frames[2], at[holds])
    guesses = [] if leap is None else [at + leap]
    if matching.turns and holds.any():
        step = robust_similarity(before[holds].astype(float), at[holds].astype(float))[:2]
        guesses.append(at @ step[:, :2].T + step[:, 2])
    return [guess.astype(np.float32) for guess in guesses]


def affine_motion(at: np.ndarray, points: np.ndarray, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (N, 2) and its gradient (N, 2, 2) at positions (N, 2), by affine fits to the AROUND nearest of points (M, 2), no fewer."""
    index = cKDTree(points).query(at, k=AROUND)[1]
    alike = np.full(index.shape, 1 / AROUND)
    return affine_fit(at, points[index].astype(float), displacement[index].astype(float), alike, stiffness_px2=RIGIDITY_PX2)


def affine_fit(
    at: np.ndarray, point: np.ndarray, value: np.ndarray, weight: np.ndarray, *, stiffness_px2: float
) -> tuple[np.ndarray, np.ndarray]:
    """Value (N, C) and gradient (N, C, 2) at positions (N, 2) of affine fits, one each, to values (N, K, C) of points (N, K, 2) [px] by
    weights (N, K) that sum to 1. `stiffness_px2` is added to the points' second moment: those in a line turn hardly anything."""
    centre, mean = (np.einsum("nk,nka->na", weight, a) for a in (point, value))
    arm = point - centre[:, None]
    second = np.einsum("nk,nka,nkb->nab", weight, arm, arm) + stiffness_px2 * np.eye(2)
    cross = np.einsum("nk,nka,nkb->nab", weight, value - mean[:, None], arm)
    gradient = np.swapaxes(np.linalg.solve(second, np.swapaxes(cross, 1, 2)), 1, 2)
    return mean + np.einsum("nab,nb->na", gradient, at - centre), gradient


def _lucas_kanade(a: np.ndarray, b: np.ndarray, at: np.ndarray, guess: np.ndarray, matching: Matching, levels: int) -> tuple[np.ndarray, np.ndarray]:
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.003)
    size = (matching.window_px, matching.window_px)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        a, b, at[:, None], guess[:, None].copy(), winSize=size, maxLevel=levels, criteria=criteria, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    return found[:, 0], status[:, 0] > 0


def _round_trip(a: np.ndarray, b: np.ndarray, at: np.ndarray, guess: np.ndarray, matching: Matching, levels: int) -> tuple[np.ndarray, np.ndarray]:
    there, found = _lucas_kanade(a, b, at, guess, matching, levels)
    back, returned = _lucas_kanade(b, a, there, at, matching, levels)
    return there, np.where(found & returned, np.linalg.norm(back - at, axis=1), np.inf)


def _found(first: np.ndarray, image: np.ndarray, start: np.ndarray, predicted: np.ndarray, matching: Matching) -> tuple[np.ndarray, np.ndarray]:
    """Positions (M, 2) in an image of points of the first, near where they are predicted, and which are trusted; else the prediction."""
    motion = _turn(start, predicted) if matching.turns else None
    if motion is not None:
        first = cv2.warpAffine(first, motion, first.shape[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    there, error = _round_trip(first, image, _moved_by(motion, start), predicted, matching, 1)
    good = (error < matching.round_trip_px) & (np.linalg.norm(there - predicted, axis=1) < LARGEST_JUMP_PX)
    good = _agreeing(start, there, motion, good)
    return np.where(good[:, None], there, predicted), good


def _turn(start: np.ndarray, moved: np.ndarray) -> np.ndarray | None:
    """The affine motion (2, 3) of all points (M, 2) to where they have moved (M, 2); None where they have hardly turned."""
    motion = _motion_of_all(start, moved)
    angle = np.arctan2(motion[1, 0] - motion[0, 1], motion[0, 0] + motion[1, 1])
    return motion if np.linalg.det(motion[:, :2]) > 0 and abs(angle) > TURNED else None


def _moved_by(motion: np.ndarray | None, points: np.ndarray) -> np.ndarray:
    return points if motion is None else (points @ motion[:, :2].T + motion[:, 2]).astype(np.float32)


def _motion_of_all(points: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """The affine motion (2, 3) that takes points (M, 2) near where they have moved (M, 2), by least absolute deviations; of points in a line, a turn."""
    turn = robust_similarity(points.astype(float), moved.astype(float))[:2]
    there = points @ turn[:, :2].T + turn[:, 2]
    weight = np.ones(len(points))
    for _ in range(TURN_ROUNDS):
        share = weight / weight.sum()
        left, slope = affine_fit(share[None] @ there, there[None], (moved - there)[None], share[None], stiffness_px2=RIGIDITY_PX2)
        fitted = there + left + (there - share @ there) @ slope[0].T
        off = np.linalg.norm(moved - fitted, axis=1)
        weight = 1 / np.maximum(off, max(float(np.median(off)), LEAST_OFF_PX))
    along = (np.eye(2) + slope[0]) @ turn
    return np.column_stack([along[:, :2], along[:, 2] + left[0] - slope[0] @ (share @ there)])


def _followed(
    frames: tuple[np.ndarray, np.ndarray, np.ndarray], at: np.ndarray, guess: np.ndarray, start: np.ndarray, matching: Matching
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (M, 2) and which are trusted in the last of three frames (the first, the one before, this one), of points `at` (M, 2) in the one
    before: matched with the first frame from where the motion of the neighbours takes each, which is looked for about `guess` (M, 2)."""
    first, before, image = frames
    there, error = _round_trip(before, image, at, guess, matching, 2)
    moved = neighbour_median(start, there - guess, error < DRIFT_ROUND_TRIP_PX)
    return _found(first, image, start, (guess + moved).astype(np.float32), matching)


def whole_shift(image: np.ndarray, later: np.ndarray, points: np.ndarray) -> np.ndarray | None:
    """Where the hull of points (M, 2) [px] of an image has gone in a later one, (2,) [px], by normalised correlation; None where it is not found, or is tiny."""
    if not len(points):
        return None
    size = np.array(image.shape[::-1])
    low, high = np.clip(np.floor(points.min(0)), 0, size - 1).astype(int), np.clip(np.ceil(points.max(0)) + 1, 1, size).astype(int)
    reach = np.ceil((LEAP - 1) / 2 * (high - low)).astype(int)
    first, end = np.maximum(low - reach, 0), np.minimum(high + reach, size)
    box, around = image[low[1] : high[1], low[0] : high[0]], later[first[1] : end[1], first[0] : end[0]]
    if min(box.shape) < 2 * COARSE:
        return None
    hull = cv2.fillConvexPoly(np.zeros(box.shape, np.uint8), cv2.convexHull(np.rint(points - low).astype(np.int32)), 1)
    coarse = [cv2.resize(part, None, fx=1 / COARSE, fy=1 / COARSE, interpolation=cv2.INTER_AREA) for part in (around, box, hull)]
    if not coarse[2].any():
        return None
    likeness = cv2.matchTemplate(*coarse[:2], cv2.TM_CCOEFF_NORMED, mask=coarse[2])
    _, best, _, place = cv2.minMaxLoc(np.where(np.isfinite(likeness), likeness, -1.0))
    return COARSE * np.array(place, float) + first - low if best >= LEAST_LIKENESS else None


def _agreeing(start: np.ndarray, there: np.ndarray, motion: np.ndarray | None, good: np.ndarray) -> np.ndarray:
    """Which good points move as those around them do, beside a motion of all."""
    displacement = there - _moved_by(motion, start)
    return good & (np.linalg.norm(displacement - neighbour_median(start, displacement, good), axis=1) < LARGEST_ODDITY_PX)


def neighbour_median(start: np.ndarray, values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Median of values (M, C) over the nearest good points (M,) of positions start (M, d); zeros where too few are good."""
    if good.sum() < NEIGHBOURS:
        return np.zeros_like(values)
    _, index = cKDTree(start[good]).query(start, k=NEIGHBOURS)
    return np.median(values[good][index], 1)
