"""Dense depth of one picture from its neighbours by a plane sweep (Collins 1996) with normalised cross-correlation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..surface_plane import plane_depth
from .views import Shot

NEIGHBOURS = 6  # pictures that a depth is read from
ANGLE_DEG = (3.0, 35.0)  # between two lines of sight: less tells no depth, more looks too different
BEST_ANGLE_DEG = 12.0
WINDOW_PX = 9  # side of the windows that are compared
LEAST_WINDOW = 0.4  # share of a window that must lie on the object
STEP_PX = 0.6  # shift of the most distant neighbour from one plane to the next
MOST_PLANES = 256
LEAST_SCORE = 0.55  # correlation from which a depth is believed
RANGE_MARGIN = 0.15  # of the sparse points' inverse depths, added at both ends
CONTRAST = 1.0  # grey levels: standard deviation of a window that holds texture
SPECK = 0.02  # share of the object: smaller pieces that hang together are errors
STEP_PLANES = 2  # planes between neighbouring pixels of one piece
SUBSTEPS = 64  # in which the place between two planes is counted
PLANE_RADIUS_PX = 4  # half side of the planes that smooth the depth


Box = tuple[int, int, int, int]  # left, top, right, bottom [px]


def swept_depth(reference: Shot, others: Sequence[Shot], points: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Depth of a picture, float32 (H, W), in the unit of the cameras, 0 where it is not told and outside of the mask.

    Args:
        reference: the picture. others: further ones of the same still scene.
        points: sparse points (N, 3) that pictures' `seen` counts.
        mask: part of the picture that is wanted, bool (H, W). Its sparse points bound the depths that are tried.
    """
    depth = np.zeros(reference.image.shape[:2], np.float32)
    chosen = _neighbours(reference, others, points)
    inverse = _planes(reference, chosen, points, mask) if chosen else np.zeros(0)
    if len(inverse) < 3:
        return depth
    left, top, right, bottom = box = _box(mask)
    here, greys = _Patch.of(reference, mask, box), [_grey(other) for other in chosen]
    score = np.stack([_agreement(here, greys, [_homography(reference, o, value) for o in chosen], chosen, box) for value in inverse])
    depth[top:bottom, left:right] = _peak(score, inverse, round(SPECK * np.count_nonzero(mask)))
    return _smoothed(np.where(mask & reference.valid, depth, 0.0).astype(np.float32))


def _box(mask: np.ndarray) -> Box:
    """The part of the picture around a mask that windows reach."""
    v, u = np.nonzero(mask)
    return max(u.min() - WINDOW_PX, 0), max(v.min() - WINDOW_PX, 0), u.max() + WINDOW_PX + 1, v.max() + WINDOW_PX + 1


def _neighbours(reference: Shot, others: Sequence[Shot], points: np.ndarray) -> list[Shot]:
    """The pictures that share the most points at useful angles."""
    worth = [(_worth(reference, other, points), k) for k, other in enumerate(others)]
    ranked = sorted((w for w in worth if w[0] > 0), reverse=True)
    return [others[k] for _, k in ranked[:NEIGHBOURS]]


def _worth(reference: Shot, other: Shot, points: np.ndarray) -> float:
    common = points[np.intersect1d(reference.seen, other.seen)]
    if not len(common):
        return 0.0
    a, b = (camera.position - common for camera in (reference.camera, other.camera))
    cosine = (a * b).sum(1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    useful = (angle > ANGLE_DEG[0]) & (angle < ANGLE_DEG[1])
    return float((np.exp(-(np.log(np.maximum(angle, 1e-3) / BEST_ANGLE_DEG) ** 2)) * useful).sum())


def _planes(reference: Shot, chosen: Sequence[Shot], points: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Inverse depths of the planes: over the sparse points in the mask, so close that no neighbour shifts by more than STEP_PX."""
    pixels, depth = reference.camera.project(points[reference.seen])
    u, v = (np.clip(np.rint(pixels[:, i]).astype(int), 0, mask.shape[1 - i] - 1) for i in (0, 1))
    inside = mask[v, u] & (depth > 0)
    if not inside.any():
        return np.zeros(0)
    low, high = np.quantile(1 / depth[inside], (0.02, 0.98))
    margin = RANGE_MARGIN * (high - low) + 0.02 * high
    low, high = max(low - margin, 0.2 * low), high + margin
    left, top, right, bottom = _box(mask)
    corners = np.array([[x, y, 1.0] for x in (left, right) for y in (top, bottom)])
    shift = max(np.linalg.norm(_onto(corners, reference, o, low) - _onto(corners, reference, o, high), axis=1).max() for o in chosen)
    return np.linspace(low, high, int(np.clip(shift / STEP_PX, 3, MOST_PLANES)))


def _onto(pixels: np.ndarray, reference: Shot, other: Shot, inverse: float) -> np.ndarray:
    there = pixels @ _homography(reference, other, inverse).T
    return there[:, :2] / there[:, 2:]


def _homography(reference: Shot, other: Shot, inverse: float) -> np.ndarray:
    """(3, 3): pixels of the reference to those of another picture over the plane across the line of sight at an inverse depth."""
    turn = other.camera.world_from_camera[:3, :3].T
    along = turn @ reference.camera.world_from_camera[:3, :3] @ np.linalg.inv(reference.camera.pixel_from_camera)
    shift = turn @ (reference.camera.position - other.camera.position)
    return other.camera.pixel_from_camera @ (along + inverse * np.outer(shift, [0, 0, 1.0]))


@dataclass(frozen=True)
class _Patch:
    """The part of the reference that is compared. Only its pixels in the mask count, so that windows at the object's edge do not see
    the scene behind."""

    grey: np.ndarray  # (h, w)
    weight: np.ndarray  # 0 or 1, (h, w)
    total: np.ndarray  # of the weights in each window, (h, w)
    mean: np.ndarray  # of each window, (h, w)
    variance: np.ndarray  # of each window, (h, w)

    @classmethod
    def of(cls, reference: Shot, mask: np.ndarray, box: Box) -> _Patch:
        left, top, right, bottom = box
        grey, weight = _grey(reference)[top:bottom, left:right], (mask & reference.valid)[top:bottom, left:right].astype(np.float32)
        total = np.maximum(_sum(weight), 1e-3)
        mean = _sum(weight * grey) / total
        return cls(grey, weight, total, mean, _sum(weight * grey * grey) / total - mean**2)

    def correlation(self, other: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Normalised cross-correlation of windows (h, w) with another image, -1 where that or most of the window is unknown, near 0
        without texture."""
        there = self.weight * other
        mean, square, product = (_sum(image) / self.total for image in (there, there * other, there * self.grey))
        variance = np.maximum(self.variance, 0) * np.maximum(square - mean**2, 0)
        value = (product - mean * self.mean) / np.sqrt(np.maximum(variance, CONTRAST**4))
        return np.where(known & (self.total > LEAST_WINDOW), value, -1.0).astype(np.float32)


def _agreement(
    here: _Patch, greys: Sequence[np.ndarray], homographies: Sequence[np.ndarray], chosen: Sequence[Shot], box: Box
) -> np.ndarray:
    """Correlation (h, w) with the better half of the neighbours, which leaves out those that something hides it from."""
    corner = np.array([[1, 0, box[0]], [0, 1, box[1]], [0, 0, 1.0]])
    scores = []
    for grey, homography, other in zip(greys, homographies, chosen, strict=True):
        there, known = (_warped(image, homography @ corner, here.grey.shape) for image in (grey, other.valid.astype(np.float32)))
        scores.append(here.correlation(there, known > 0.999))
    return np.sort(scores, 0)[len(scores) // 2 :].mean(0)


def _warped(image: np.ndarray, homography: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Image (h, w) seen over the plane, 0 beside it."""
    return cv2.warpPerspective(image, homography, (shape[1], shape[0]), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def _grey(shot: Shot) -> np.ndarray:
    return shot.image.astype(np.float32).mean(-1) - 128


def _sum(image: np.ndarray) -> np.ndarray:
    return cv2.blur(image, (WINDOW_PX, WINDOW_PX))


def _peak(score: np.ndarray, inverse: np.ndarray, speck: int) -> np.ndarray:
    """Depth (h, w) at the best of the planes (D,), between them by a parabola; 0 where none agrees, the best is the first or last, or
    fewer than `speck` pixels hang together without a step."""
    best = score.argmax(0)
    inner = np.clip(best, 1, len(inverse) - 2)
    before, at, after = (np.take_along_axis(score, (inner + k)[None], 0)[0] for k in (-1, 0, 1))
    bend = before - 2 * at + after
    offset = np.where(bend < -1e-6, 0.5 * (before - after) / np.where(bend < -1e-6, bend, -1.0), 0.0)
    place = inner + np.clip(offset, -0.5, 0.5)
    steps = np.where((at > LEAST_SCORE) & (best == inner), np.round(SUBSTEPS * place), -1).astype(np.int16)
    cv2.filterSpeckles(steps, -1, speck, SUBSTEPS * STEP_PLANES)
    return np.where(steps >= 0, 1 / (inverse[0] + (inverse[1] - inverse[0]) * place), 0.0)


def _smoothed(depth: np.ndarray) -> np.ndarray:
    """Depth (H, W) read from local planes; specks that no plane explains are dropped."""
    v, u = np.nonzero(depth)
    value, share = plane_depth(depth, np.stack([u, v], -1).astype(float), radius=PLANE_RADIUS_PX)
    smooth = np.zeros_like(depth)
    smooth[v, u] = np.where(share > 0.3, value, 0.0)
    return smooth
