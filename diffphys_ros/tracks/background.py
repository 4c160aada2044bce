"""Whether the camera stood still, read off what lies around the object.

Every frame is laid over frame 0 by one shift. Tiles of the background vote: what a camera does is seen by most of them and all over the
picture; a shadow, a branch in the wind or a person moves some of them and leaves the others where they were.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..steady import (
    CORRELATED,
    LEAST_COVERED,
    LEAST_NOISE,
    LEAST_TILES,
    ROUNDS,
    SETTLED_PX,
    SMOOTHINGS_PX,
    TILE_PX,
    WIDEST_PX,
    Layer,
    answers,
    blurred,
    scaled,
    shifted_by,
    telling,
    votes,
)
from ..types import Camera, Clip, Tracks

LARGEST_STILL_PX = 0.15  # shift of a frame over frame 0 down to which a camera counts as still: what tracking a firm tripod scatters by
NOISES = 1.0  # standard deviations of the tracks that it may be as well
LEAST_MOVED = 2  # frames that must be shifted: one may be a torn picture
MARGIN_PX = 7  # around the object that is left out: its edge, its blur
MOST_STILL = 0.25  # tiles that stand still over tiles that shift, at the most: else something moves before a still camera
LEAST_SPREAD = 0.4  # of the picture's width or height that the shifted tiles must span
SURELY = 4.0  # standard deviations by which a tile must tell the bound from nought
CLEARLY = 0.5  # share of the one misfit below which the other must lie for a vote
MOST_FRAMES = 36  # nor more of them
LEAST_TRIPLES, ALONG = 8, 0.5  # triples of frames that tell of jolts, and the share of the camera's that the object must show
QUIET, QUIETER = 0.1, 0.7  # share of the tracks that move least; and how much less they must move against the background than in the picture
GONE = 0.4  # of the picture's width: a longer shift is none


@dataclass(frozen=True)
class CameraMotion:
    """A camera that moved."""

    frames: np.ndarray  # numbers of the frames that are shifted, (F,)
    shift_px: np.ndarray  # of those over frame 0, (F, 2)

    def sentence(self) -> str:
        """What was seen, in words."""
        far = int(np.linalg.norm(self.shift_px, axis=1).argmax())
        return (
            f"the camera moves: the background lies up to {np.linalg.norm(self.shift_px[far]):.2g} px from where it was in frame 0 (frame {self.frames[far]}), "
            f"at most {LARGEST_STILL_PX:g} px is allowed; put the camera on a tripod"
        )


def camera_motion(clip: Clip, tracks: Tracks) -> CameraMotion | None:
    """How a camera moved; None where it stood still or where too little around the object could tell.

    Args:
        clip: with labels; what they call background counts.
        tracks: points of the object, which is held or moves little somewhere.
    """
    assert clip.labels is not None
    scale = min(1.0, WIDEST_PX / clip.frames.shape[2])
    bound = max(LARGEST_STILL_PX, NOISES * tracks.noise_m / _metres_per_pixel(tracks)) * scale
    received = np.flatnonzero(clip.seen)
    if not len(received) or received[0] != 0:
        return None
    chosen = np.unique(received[np.linspace(0, len(received) - 1, min(MOST_FRAMES, len(received))).astype(int)])
    grey = [scaled(cv2.cvtColor(clip.frames[k], cv2.COLOR_RGB2GRAY), scale).astype(np.float32) for k in chosen]
    free = [_free(clip.labels[k], scale) for k in chosen]
    first = [Layer.of(grey[0], s) for s in SMOOTHINGS_PX]
    shift, found = np.zeros(2), []
    for k, image, ground in zip(chosen[1:], grey[1:], free[1:], strict=True):
        layers = [blurred(image, s) for s in SMOOTHINGS_PX]
        shift = _laid_over(first, layers, free[0] & ground, shift)
        if np.linalg.norm(shift) > bound and _agreed(first[-1], layers[-1], free[0] & ground, shift, bound=bound):
            found.append((k, shift / scale))
        elif not np.linalg.norm(shift) < GONE * image.shape[1]:
            shift = np.zeros(2)
    motion = CameraMotion(np.array([k for k, _ in found], int), np.array([s for _, s in found]).reshape(-1, 2))
    return motion if len(found) >= LEAST_MOVED and _seen_by(tracks, motion, clip.camera) else None


def background(labels: np.ndarray) -> np.ndarray:
    """What a label image (H, W) calls background, without a margin around all else, bool (H, W)."""
    return cv2.dilate((labels != 0).astype(np.uint8), np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)) == 0


def _free(labels: np.ndarray, scale: float) -> np.ndarray:
    return scaled(background(labels).astype(np.float32), scale) > 0.99


def _laid_over(first: list[Layer], layers: list[np.ndarray], free: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Shift (2,) at which a frame lies best over frame 0 for most tiles, every tile one vote whatever its contrast."""
    for layer, image in zip(first, layers, strict=True):
        for _ in range(ROUNDS):
            misfit, normal, right, count = answers(layer, image, free, shifted_by(shift))
            use = telling(normal, count)
            if use.sum() < LEAST_TILES:
                break
            weight = votes(misfit[use], normal[use])
            matrix = np.einsum("n,nij->ij", weight, normal[use])
            step = np.linalg.solve(matrix + 1e-6 * (np.trace(matrix) + 1e-12) * np.eye(2), weight @ right[use])
            shift = shift + step * min(1.0, TILE_PX / max(float(np.linalg.norm(step)), 1e-12))
            if np.linalg.norm(step) < SETTLED_PX:
                break
    return shift


def _agreed(first: Layer, image: np.ndarray, free: np.ndarray, shift: np.ndarray, *, bound: float) -> bool:
    """Whether the tiles that can tell say that everything is shifted, and lie all over the picture."""
    misfit, normal, _, count = answers(first, image, free, shifted_by(shift))
    still = answers(first, image, free, shifted_by(np.zeros(2)))[0]
    covered = count > LEAST_COVERED * TILE_PX**2
    if not covered.any():
        return False
    noise = max(float(np.median((np.minimum(misfit, still) / np.maximum(count, 1))[covered])) ** 0.5, LEAST_NOISE / np.sqrt(CORRELATED))
    along = shift / np.linalg.norm(shift)
    told = np.einsum("i,nij,j->n", along, normal, along) * bound**2  # misfit of a shift by the bound
    able = covered & (told > SURELY**2 * CORRELATED * noise**2)
    floor = CORRELATED * noise**2  # of either misfit
    shifted, stays = able & (misfit + floor < CLEARLY * still), able & (still + floor < CLEARLY * misfit)
    if shifted.sum() < LEAST_TILES or stays.sum() > MOST_STILL * shifted.sum():
        return False
    rows, columns = (n // TILE_PX for n in free.shape)
    v, u = np.divmod(np.flatnonzero(shifted), columns)
    return bool(max((np.ptp(u) + 1) / columns, (np.ptp(v) + 1) / rows) >= LEAST_SPREAD)


def _seen_by(tracks: Tracks, motion: CameraMotion, camera: Camera) -> bool:
    """Whether the object goes with the background: a camera moves both, a shadow or a branch one. Its quietest points must move less against
    the background than in the picture, or all of it must show the camera's jolts. Of points that are seen along normals alone, so is the camera."""
    moved = np.where(tracks.valid[..., None], tracks.pixels - tracks.pixels[:1], np.nan)[motion.frames]
    holding = tracks.valid[motion.frames].any(0)
    if not holding.any():
        return True
    moved = moved[:, holding]
    in_picture, on_ground = (np.sqrt(np.nanmean((m**2).sum(-1), axis=0)) for m in (moved, moved - _along(motion.shift_px[:, None], tracks, camera)[:, holding]))
    return bool(np.quantile(on_ground, QUIET) < QUIETER * np.quantile(in_picture, QUIET)) or _jolted(moved, motion)


def _along(shift_px: np.ndarray, tracks: Tracks, camera: Camera) -> np.ndarray:
    """What points show of shifts (F, 1, 2) [px], (F, M, 2): all, or the component along their normals."""
    if tracks.normals is None:
        return np.broadcast_to(shift_px, (len(shift_px), tracks.pixels.shape[1], 2))
    normal = camera.normals_in_picture(tracks.normals)
    return np.asarray((shift_px * normal).sum(-1, keepdims=True) * normal)


def _jolted(moved: np.ndarray, motion: CameraMotion) -> bool:
    """Whether displacements (F, M, 2) [px], NaN where unknown, show the second differences of the camera's shift: own motion hardly has any."""
    even = np.flatnonzero(np.diff(motion.frames, 2) == 0) if len(motion.frames) > 2 else np.zeros(0, int)
    jolt = np.diff(motion.shift_px, 2, axis=0)[even]
    if len(even) < LEAST_TRIPLES or np.sqrt((jolt**2).sum(1).mean()) < 2 * LARGEST_STILL_PX:
        return False
    seen = np.diff(moved, 2, axis=0)[even]
    known = np.isfinite(seen).all(-1)
    power = ((jolt**2).sum(1)[:, None] * known).sum(0)
    share = (np.where(known[..., None], seen, 0.0) * jolt[:, None]).sum((0, 2)) / np.maximum(power, 1e-12)
    return bool(np.median(share[power > 0]) > ALONG) if (power > 0).any() else False


def _metres_per_pixel(tracks: Tracks) -> float:
    """Size of a pixel on the object [m], from the spread of the tracks in frame 0."""
    spread = [np.linalg.norm(p - p.mean(0), axis=1) for p in (tracks.points[0], tracks.pixels[0])]
    return max(float(np.median(spread[0]) / max(np.median(spread[1]), 1e-9)), 1e-12)
