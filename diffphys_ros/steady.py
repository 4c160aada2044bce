"""How every frame lies over frame 0, by tiles of the picture that stand for a background at rest: shift, roll and zoom of the camera.

Every tile is one vote, whatever its contrast, and tiles that move otherwise are outvoted. Gauss-Newton from coarse to fine (Baker and Matthews
2004, "Lucas-Kanade 20 years on"); the spread is that of the equations and, beside it, of what the tiles scatter (the sandwich estimate).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

TILE_PX = 24  # side of a tile
LEAST_COVERED = 0.6  # share of a tile that must be background in both frames
LEAST_TILES = 4  # that must tell of a shift
TILES_A_FRAME = 8  # that must tell where roll and zoom are sought too
LEAST_NOISE = 0.4  # grey levels: rounding to whole levels
CORRELATED = 12.0  # pixels that share their noise after smoothing by the last of SMOOTHINGS_PX: 4 pi s^2
SMOOTHINGS_PX = (6.0, 2.0, 1.0)  # from coarse to fine: shifts up to several times the first are found
ROUNDS = 3  # of Gauss-Newton at each
WIDEST_PX = 480  # pictures are looked at no larger
SETTLED_PX = 2e-3  # of a step, below which no other is taken
RIM_PX = 1.0  # within the picture that cubic interpolation needs
AGREES_PX = 0.3  # by which a tile may lie off the common motion and still says the same
LEAST_SLOPE = 0.5  # grey levels a pixel, rms over a tile: fainter shading sticks to the pixels, by rounding and by what a video codec leaves out
MODEL_PX = 0.03  # by which interpolation, blur and a background that is not flat put a tile off, however strong its contrast
BETTER = 0.5  # share of its misfit that a motion of its own must explain, before a tile says something else


@dataclass(frozen=True)
class Layer:
    """A smoothed picture and its slopes."""

    image: np.ndarray  # float32, (H, W)
    slope: tuple[np.ndarray, np.ndarray]  # along x and y [1/px], (H, W) each

    @classmethod
    def of(cls, grey: np.ndarray, smoothing_px: float) -> Layer:
        """Of a picture (H, W) smoothed by so much."""
        image = blurred(grey, smoothing_px)
        down, across = np.gradient(image)
        return cls(image, (across, down))


@dataclass(frozen=True)
class Overlay:
    """The camera's motion: pixel x of frame 0 is seen at matrix @ (x, 1) of frame k."""

    matrix: np.ndarray  # [px], (T, 2, 3)
    covariance: np.ndarray  # of shift x, shift y [px], zoom and roll about `centre`, (T, 4, 4)
    agreed: np.ndarray  # share of the tiles with contrast that say the same, (T,); 0 where too few tell
    centre: np.ndarray  # of the picture [px], (2,)

    def shift_px(self, at: np.ndarray) -> np.ndarray:
        """Where pixel `at` (2,) of frame 0 is seen, against frame 0 [px], (T, 2)."""
        return self.matrix @ np.append(at, 1.0) - at

    def sd_px(self, at: np.ndarray) -> np.ndarray:
        """Standard deviation of one coordinate of that [px], (T,)."""
        field = _field((at - self.centre)[None])[0]
        return np.sqrt(np.einsum("ci,tij,cj->t", field, self.covariance, field) / 2)


def overlay(grey: Sequence[np.ndarray], free: Sequence[np.ndarray]) -> Overlay:
    """Of frames (H, W), float32, over the first of them, by what of both is background: bool (H, W) each."""
    scale = min(1.0, WIDEST_PX / grey[0].shape[1])
    small, ground = [scaled(g, scale) for g in grey], [_whole(f, scale) for f in free]
    first = [Layer.of(small[0], s) for s in SMOOTHINGS_PX]
    size = np.array(small[0].shape[::-1])
    centre = (size - 1) / 2
    found = [(np.zeros(4), np.zeros((4, 4)), 1.0)]
    for image, under in zip(small[1:], ground[1:], strict=True):
        begin = found[-1][0] if found[-1][2] > 0 else np.zeros(4)
        found.append(_laid(first, image, ground[0] & under, begin, centre))
    p, covariance = np.array([f[0] for f in found]), np.array([f[1] for f in found])
    per_px = np.array([1 / scale, 1 / scale, 1.0, 1.0])  # shifts in px of the whole picture
    middle = (np.array(grey[0].shape[::-1]) - 1) / 2
    return Overlay(_matrices(p * per_px, middle), covariance * np.outer(per_px, per_px), np.array([f[2] for f in found]), middle)


def as_seen_first(frame: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """A picture uint8 (H, W, 3) as frame 0 would have shown it, by the frame's matrix (2, 3) of an Overlay."""
    return np.asarray(cv2.warpAffine(frame, matrix, frame.shape[1::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE))


def blurred(grey: np.ndarray, smoothing_px: float) -> np.ndarray:
    """A picture smoothed by a Gaussian of that standard deviation."""
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), smoothing_px))


def scaled(image: np.ndarray, scale: float) -> np.ndarray:
    """A picture made smaller."""
    return image if scale == 1.0 else np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def answers(first: Layer, image: np.ndarray, free: np.ndarray, to: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of every tile, its mean taken off: squared misfit (N,) of an image read at `to` (2, 3), normal matrix (N, 2, 2) and right side (N, 2)
    of the step from there, and the pixels that count (N,)."""
    moved = cv2.warpAffine(image, to, image.shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)
    use = (free & _seen(image.shape, to)).astype(np.float32)
    x, y, error = (use * values for values in (first.slope[0], first.slope[1], moved - first.image))
    sums = _tiles([use, x, y, error, x * x, x * y, y * y, x * error, y * error, error * error])
    count, mean = sums[:, 0], sums[:, 1:4]
    pairs = np.zeros((len(count), 3, 3))
    pairs[:, (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)] = sums[:, 4:]
    pairs[:, 1, 0] = pairs[:, 0, 1]
    pairs -= mean[:, :, None] * mean[:, None, :] / np.maximum(count, 1)[:, None, None]
    return pairs[:, 2, 2], pairs[:, :2, :2], -pairs[:, :2, 2], count


def shifted_by(shift: np.ndarray) -> np.ndarray:
    """The matrix (2, 3) of a shift (2,) [px]."""
    return np.array([[1, 0, shift[0]], [0, 1, shift[1]]])


def telling(normal: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Which tiles are covered and have contrast, bool (N,)."""
    return (count > LEAST_COVERED * TILE_PX**2) & (np.trace(normal, axis1=1, axis2=2) > LEAST_NOISE**2 * count / CORRELATED)


def votes(misfit: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Weight (N,) of tiles that tell: one vote each, less where the misfit is larger than usual."""
    contrast = np.trace(normal, axis1=1, axis2=2)
    off = misfit / contrast  # [px^2]
    return 1 / (contrast * (1 + off / max(float(np.median(off)), 1e-12)))


def _laid(first: list[Layer], image: np.ndarray, free: np.ndarray, p: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Shift, zoom and roll (4,) at which a frame lies best over frame 0, their covariance (4, 4), and the share of the tiles that agree."""
    field = _field(_tile_centres(free.shape) - centre)
    covariance, agreed = np.zeros((4, 4)), 0.0
    for smoothing, layer in zip(SMOOTHINGS_PX, first, strict=True):
        now, free_to = blurred(image, smoothing), 2 if smoothing == SMOOTHINGS_PX[0] else 4  # first the shift alone
        for _ in range(ROUNDS):
            misfit, normal, right, count = answers(layer, now, free, _matrices(p[None], centre)[0])
            use = telling(normal, count)
            if free_to == 4:
                use &= np.trace(normal, axis1=1, axis2=2) > LEAST_SLOPE**2 * count
            if use.sum() < TILES_A_FRAME:
                return p, covariance, 0.0
            weight = votes(misfit[use], normal[use]) if free_to == 2 else _told(misfit[use], normal[use], count[use])
            rows = field[use][..., :free_to]
            scale = np.array([1.0, 1.0, *[1 / centre[0]] * 2])[:free_to]  # zoom and roll count by what they do at the picture's edge
            rows = rows * scale
            matrix = np.einsum("n,nci,ncd,ndj->ij", weight, rows, normal[use], rows)
            each = np.einsum("n,nci,nc->ni", weight, rows, right[use])
            inverse = np.linalg.inv(matrix + 1e-6 * (np.trace(matrix) + 1e-12) * np.eye(free_to))
            step = inverse @ each.sum(0) * scale
            move = np.pad(step * min(1.0, TILE_PX / max(float(np.linalg.norm(step[:2])), 1e-12)), (0, 4 - free_to))
            p = p + move
            if np.linalg.norm(step[:2]) < SETTLED_PX:
                break
    covariance = (inverse + inverse @ (each.T @ each) @ inverse) * np.outer(scale, scale)  # few tiles scatter by too little to tell alone
    own = np.einsum("nij,nj->ni", np.linalg.pinv(normal[use], hermitian=True), right[use])
    better = np.einsum("ni,ni->n", own, right[use]) > BETTER * misfit[use]
    agreed = float(1 - (better & (np.linalg.norm(own, axis=1) > AGREES_PX)).mean())
    return p, covariance, agreed


def _told(misfit: np.ndarray, normal: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Weight (N,) of tiles by what they tell: by their contrast over their noise, up to where a tile may lie off by MODEL_PX anyhow."""
    noise = np.maximum(misfit / np.maximum(count, 1), LEAST_NOISE**2 / CORRELATED)
    return 1 / (CORRELATED * noise + MODEL_PX**2 * np.trace(normal, axis1=1, axis2=2))


def _field(at: np.ndarray) -> np.ndarray:
    """What shift x, shift y, zoom and roll move at places (N, 2) [px], (N, 2, 4)."""
    x, y = at[:, 0], at[:, 1]
    one, none = np.ones_like(x), np.zeros_like(x)
    return np.stack([np.stack([one, none, x, -y], -1), np.stack([none, one, y, x], -1)], 1)


def _matrices(p: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Matrices (T, 2, 3) of shifts [px], zooms and rolls about `centre`, (T, 4)."""
    turn = np.stack([np.stack([1 + p[:, 2], -p[:, 3]], -1), np.stack([p[:, 3], 1 + p[:, 2]], -1)], 1)
    return np.concatenate([turn, (p[:, :2] + centre - turn @ centre)[..., None]], -1)


def _seen(shape: tuple[int, ...], to: np.ndarray) -> np.ndarray:
    """Which pixels of a picture (H, W) are read inside of another at `to` (2, 3), bool (H, W)."""
    v, u = np.ogrid[: shape[0], : shape[1]]
    x, y = (row[0] * u + row[1] * v + row[2] for row in to)
    return np.asarray((x >= RIM_PX) & (x <= shape[1] - 1 - RIM_PX) & (y >= RIM_PX) & (y <= shape[0] - 1 - RIM_PX))


def _tile_centres(shape: tuple[int, ...]) -> np.ndarray:
    rows, columns = (n // TILE_PX for n in shape)
    v, u = np.divmod(np.arange(rows * columns), columns)
    return (np.stack([u, v], -1) + 0.5) * TILE_PX - 0.5


def _tiles(images: list[np.ndarray]) -> np.ndarray:
    """Sums (N, c) over whole tiles of c images (H, W)."""
    rows, columns = (n // TILE_PX for n in images[0].shape)
    cut = [np.ascontiguousarray(image[: rows * TILE_PX, : columns * TILE_PX], np.float32) for image in images]
    means = [cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA) for image in cut]
    return TILE_PX**2 * np.stack(means, -1).reshape(rows * columns, -1).astype(float)


def _whole(mask: np.ndarray, scale: float) -> np.ndarray:
    return scaled(mask.astype(np.float32), scale) > 0.99
