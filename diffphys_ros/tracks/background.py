"""Whether the camera stood still, read off what lies around the object.

Every frame is laid over frame 0 by one shift. Tiles of the background vote: what a camera does is seen by most of them and all over the
picture; a shadow, a branch in the wind or a person moves some of them and leaves the others where they were.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..types import Clip, Tracks

LARGEST_STILL_PX = 0.15  # shift of a frame over frame 0 down to which a camera counts as still: what tracking a firm tripod scatters by
NOISES = 1.0  # standard deviations of the tracks that it may be as well
LEAST_MOVED = 2  # frames that must be shifted: one may be a torn picture
TILE_PX = 24  # side of a tile
MARGIN_PX = 7  # around the object that is left out: its edge, its blur
LEAST_COVERED = 0.6  # share of a tile that must be background in both frames
LEAST_TILES = 4  # that must tell of a shift
MOST_STILL = 0.25  # tiles that stand still over tiles that shift, at the most: else something moves before a still camera
LEAST_SPREAD = 0.4  # of the picture's width or height that the shifted tiles must span
LEAST_NOISE = 0.4  # grey levels: rounding to whole levels
CORRELATED = 12.0  # pixels that share their noise after smoothing by the last of SMOOTHINGS_PX: 4 pi s^2
SURELY = 4.0  # standard deviations by which a tile must tell the bound from nought
CLEARLY = 0.5  # share of the one misfit below which the other must lie for a vote
SMOOTHINGS_PX = (6.0, 2.0, 1.0)  # from coarse to fine: shifts up to several times the first are found
ROUNDS = 3  # of Gauss-Newton at each
WIDEST_PX = 480  # pictures are looked at no larger
MOST_FRAMES = 36  # nor more of them
LEAST_TRIPLES, ALONG = 8, 0.5  # triples of frames that tell of jolts, and the share of the camera's that the object must show
QUIET, QUIETER = 0.1, 0.7  # share of the tracks that move least; and how much less they must move against the background than in the picture
OUTSIDE = -1e4  # grey level that stands for what lies outside the picture
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
    grey = [_scaled(cv2.cvtColor(clip.frames[k], cv2.COLOR_RGB2GRAY), scale).astype(np.float32) for k in chosen]
    free = [_free(clip.labels[k], scale) for k in chosen]
    first = [_Layer.of(grey[0], s) for s in SMOOTHINGS_PX]
    shift, found = np.zeros(2), []
    for k, image, ground in zip(chosen[1:], grey[1:], free[1:], strict=True):
        layers = [_blurred(image, s) for s in SMOOTHINGS_PX]
        shift = _laid_over(first, layers, free[0] & ground, shift)
        if np.linalg.norm(shift) > bound and _agreed(first[-1], layers[-1], free[0] & ground, shift, bound=bound):
            found.append((k, shift / scale))
        elif not np.linalg.norm(shift) < GONE * image.shape[1]:
            shift = np.zeros(2)
    motion = CameraMotion(np.array([k for k, _ in found], int), np.array([s for _, s in found]).reshape(-1, 2))
    return motion if len(found) >= LEAST_MOVED and _seen_by(tracks, motion) else None


@dataclass(frozen=True)
class _Layer:
    """A smoothed picture and its slopes."""

    image: np.ndarray  # float32, (H, W)
    slope: tuple[np.ndarray, np.ndarray]  # along x and y [1/px], (H, W) each

    @classmethod
    def of(cls, grey: np.ndarray, smoothing_px: float) -> _Layer:
        image = _blurred(grey, smoothing_px)
        down, across = np.gradient(image)
        return cls(image, (across, down))


def _blurred(grey: np.ndarray, smoothing_px: float) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), smoothing_px))


def _scaled(image: np.ndarray, scale: float) -> np.ndarray:
    return image if scale == 1.0 else np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def _free(labels: np.ndarray, scale: float) -> np.ndarray:
    """Background with a margin around all else, bool (H, W)."""
    taken = cv2.dilate((labels != 0).astype(np.uint8), np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8))
    return _scaled((1 - taken).astype(np.float32), scale) > 0.99


def _tiles(images: list[np.ndarray]) -> np.ndarray:
    """Sums (N, c) over whole tiles of c images (H, W)."""
    rows, columns = (n // TILE_PX for n in images[0].shape)
    cut = [np.ascontiguousarray(image[: rows * TILE_PX, : columns * TILE_PX], np.float32) for image in images]
    means = [cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA) for image in cut]
    return TILE_PX**2 * np.stack(means, -1).reshape(rows * columns, -1).astype(float)


def _answers(first: _Layer, image: np.ndarray, free: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of every tile, its mean taken off: squared misfit (N,) at a shift, normal matrix (N, 2, 2) and right side (N, 2) of the step from
    there, and the pixels that count (N,)."""
    to = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    moved = cv2.warpAffine(image, to, image.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderValue=OUTSIDE)
    use = (free & (moved >= 0)).astype(np.float32)
    x, y, error = (use * values for values in (first.slope[0], first.slope[1], moved - first.image))
    sums = _tiles([use, x, y, error, x * x, x * y, y * y, x * error, y * error, error * error])
    count, mean = sums[:, 0], sums[:, 1:4]
    pairs = np.zeros((len(count), 3, 3))
    pairs[:, (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)] = sums[:, 4:]
    pairs[:, 1, 0] = pairs[:, 0, 1]
    pairs -= mean[:, :, None] * mean[:, None, :] / np.maximum(count, 1)[:, None, None]
    return pairs[:, 2, 2], pairs[:, :2, :2], -pairs[:, :2, 2], count


def _laid_over(first: list[_Layer], layers: list[np.ndarray], free: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Shift (2,) at which a frame lies best over frame 0 for most tiles, every tile one vote whatever its contrast."""
    for layer, image in zip(first, layers, strict=True):
        for _ in range(ROUNDS):
            misfit, normal, right, count = _answers(layer, image, free, shift)
            contrast = np.trace(normal, axis1=1, axis2=2)
            use = (count > LEAST_COVERED * TILE_PX**2) & (contrast > LEAST_NOISE**2 * count / CORRELATED)
            if use.sum() < LEAST_TILES:
                break
            off = misfit[use] / contrast[use]  # [px^2]
            weight = 1 / (contrast[use] * (1 + off / max(float(np.median(off)), 1e-12)))
            matrix = np.einsum("n,nij->ij", weight, normal[use])
            step = np.linalg.solve(matrix + 1e-6 * (np.trace(matrix) + 1e-12) * np.eye(2), weight @ right[use])
            shift = shift + step * min(1.0, TILE_PX / max(float(np.linalg.norm(step)), 1e-12))
    return shift


def _agreed(first: _Layer, image: np.ndarray, free: np.ndarray, shift: np.ndarray, *, bound: float) -> bool:
    """Whether the tiles that can tell say that everything is shifted, and lie all over the picture."""
    misfit, normal, _, count = _answers(first, image, free, shift)
    still = _answers(first, image, free, np.zeros(2))[0]
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


def _seen_by(tracks: Tracks, motion: CameraMotion) -> bool:
    """Whether the object goes with the background: a camera moves both, a shadow or a branch one. Its quietest points must move less against
    the background than in the picture, or all of it must show the camera's jolts."""
    moved = np.where(tracks.valid[..., None], tracks.pixels - tracks.pixels[:1], np.nan)[motion.frames]
    holding = tracks.valid[motion.frames].any(0)
    if not holding.any():
        return True
    moved = moved[:, holding]
    in_picture, on_ground = (np.sqrt(np.nanmean((m**2).sum(-1), axis=0)) for m in (moved, moved - motion.shift_px[:, None]))
    return bool(np.quantile(on_ground, QUIET) < QUIETER * np.quantile(in_picture, QUIET)) or _jolted(moved, motion)


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
