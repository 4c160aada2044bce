"""Sub-pixel positions of tracks by patches that turn and shear with the surface."""

from __future__ import annotations

import cv2
import numpy as np

from ..matching import AROUND, affine_motion

SMOOTHING_PX = 1.0  # against sensor noise, and so that a patch read between the pixels is as sharp as one read on them
ROUNDS = 3  # of Gauss-Newton
LEAST_SHARE = 0.3  # of a patch that must lie on the object
LONGEST_STEP_PX = 1.5  # by which a position may change in all
LEAST_LIKENESS = 0.8  # correlation of the patch with that of frame 0, below which the track does not hold in a frame
REGAINED = 0.96  # from which one that did not hold does: its patch alone speaks for it


def refined(
    frames: np.ndarray, pixels: np.ndarray, valid: np.ndarray, mask: np.ndarray, *, window_px: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (T, M, 2) [px] and validity (T, M) of tracks, matched again to frame 0 with what a translation cannot follow; and the
    standard deviation (T, M) of one coordinate of each that its patch tells, up to a factor of the clip (noise of neighbouring pixels
    is not independent).

    Inverse compositional Gauss-Newton (Baker and Matthews 2004, "Lucas-Kanade 20 years on") for the shift, gain and offset of each
    patch of frame 0, read in frame k through the local affine motion of the tracks around. Only the object's own pixels count, so that
    a background that stands still does not hold on to the border.

    Args:
        frames: RGB uint8, (T, H, W, 3). mask: the object in frame 0, bool, (H, W).
        pixels, valid: tracks to start from, (T, M, 2), (T, M); one that does not hold is looked for where those around it went.
    """
    if not pixels.shape[1]:
        return pixels, valid, np.zeros(valid.shape)
    images = [_smooth(frame) for frame in frames]
    template = _Template.of(images[0], pixels[0], mask, window_px)
    result, holds, spread = pixels.copy(), valid & template.usable, np.zeros(valid.shape)
    for k in range(1, len(frames)):
        good, start = holds[k], pixels[0]
        if good.sum() < AROUND:
            continue
        shift, gradient = affine_motion(start, start[good], pixels[k, good] - start[good])
        place = np.where(good[:, None], pixels[k], start + shift)
        found, likeness = template.match(images[k], place, np.eye(2) + gradient)
        near = np.linalg.norm(found - place, axis=1) < LONGEST_STEP_PX
        result[k] = np.where(near[:, None], found, place)
        holds[k] = template.usable & near & (likeness > np.where(good, LEAST_LIKENESS, REGAINED))
        spread[k] = template.vagueness * np.sqrt(np.maximum(1 - likeness**2, 0)) / np.maximum(likeness, LEAST_LIKENESS)
    return result, holds, spread


class _Template:
    """Patches of frame 0 and how their pixels answer to shift, gain and offset."""

    def __init__(self, offset: np.ndarray, patch: np.ndarray, weight: np.ndarray, solver: np.ndarray, vagueness: np.ndarray):
        self.offset = offset  # [px], (K, 2)
        self.patch = patch  # grey levels, weighted mean taken off, (M, K)
        self.weight = weight  # sums to 1 over a patch, (M, K)
        self.solver = solver  # shift [px], gain, offset from grey levels, (M, 4, K)
        self.vagueness = vagueness  # standard deviation of a shift [px] at a residual as large as the patch's own contrast, (M,)

    @classmethod
    def of(cls, image: np.ndarray, centre: np.ndarray, mask: np.ndarray, window_px: int) -> _Template:
        """Patches of `window_px` around pixels (M, 2)."""
        span = np.arange(window_px) - (window_px - 1) / 2
        offset = np.stack(np.meshgrid(span, span), -1).reshape(-1, 2)
        at = centre[:, None] + offset
        patch, *slope = (_read(a, at) for a in (image, *_gradient(image)))
        inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
        bell = np.exp(-0.5 * (offset**2).sum(1) / (0.35 * window_px) ** 2)
        own = _read(inner, at) > 0.99
        weight = own * bell
        weight = np.where(own.mean(1, keepdims=True) > LEAST_SHARE, weight, 0.0)
        weight = weight / np.maximum(weight.sum(1, keepdims=True), 1e-9)
        patch = patch - (weight * patch).sum(1, keepdims=True)
        answers = np.stack([*slope, patch, np.ones_like(patch)], -1)
        weighted = answers * weight[..., None]
        normal = np.einsum("mki,mkj->mij", weighted, answers) + 1e-6 * np.eye(4)
        solver = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2))
        vagueness = np.sqrt((weight * patch**2).sum(1) * (solver[:, :2] ** 2).sum((1, 2)) / 2)
        return cls(offset, patch, weight, solver, vagueness)

    @property
    def usable(self) -> np.ndarray:
        """Which patches lie on the object, bool, (M,)."""
        return np.asarray(self.weight.any(1))

    def match(self, image: np.ndarray, start: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (M, 2) in an image of the patches, from `start` (M, 2) on and turned by (M, 2, 2); and how alike they look there (M,)."""
        place, arms = start.astype(float), np.einsum("nab,kb->nka", turn, self.offset)
        for _ in range(ROUNDS):
            shift, gain, _ = np.split(self._answer(_read(image, place[:, None] + arms)), [2, 3], axis=1)
            # the patch moved by s shows gain * (patch + slope . s); stepping back by s undoes it
            place -= np.einsum("nab,nb->na", turn, shift / np.maximum(gain, 0.2))
        return place, self._likeness(_read(image, place[:, None] + arms))

    def _answer(self, seen: np.ndarray) -> np.ndarray:
        return (self.solver @ seen[..., None])[..., 0]

    def _likeness(self, seen: np.ndarray) -> np.ndarray:
        weight, patch = self.weight, self.patch
        seen = seen - (weight * seen).sum(1, keepdims=True)
        power = (weight * seen**2).sum(1) * (weight * patch**2).sum(1)
        return (weight * seen * patch).sum(1) / np.sqrt(np.maximum(power, 1e-9))


def _smooth(frame: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), SMOOTHING_PX)


def _gradient(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes along x and y [1/px]."""
    down, across = np.gradient(image)
    return across, down


def _read(image: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (M, K) of an image at pixels (M, K, 2)."""
    at = at.astype(np.float32)
    return cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
