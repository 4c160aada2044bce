"""Object mask from what moves in the clip."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..steady import as_seen_first, overlay
from ..types import Clip
from .movement import LEAST_MOTION_PX, Movement
from .prompt import NO_MARK, Mark, Prompt
from .regions import disc, filled, touching
from .surroundings import ends_inside, reachable

LEAST_SHARE = 0.001  # of the image that must move
CHROMA_SPREAD = 4.0  # units of CIELAB within which two chromas are one
SPOT_SHARE = 0.07  # of the root of the core's area: radius of a spot of the scene's colours on a still root of foreign ones
SIDE, MOVING_SIDE, MOST_SIDES = 0.1, 0.1, 3  # of the picture: width of a side, share of it that moves, and how many of the four
LEAST_AGREED = 0.5  # share of the tiles of the picture that must say the same of the camera
RARE = 0.002  # share of the scene below which a chroma is foreign to it


def motion_mask(clip: Clip, settings: Settings, mark: Mark = NO_MARK) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W): what moves, and its still root where colour continues it and, with a
    depth topic, up to the next step in depth or the clamped face; nothing that stands still beside what moves.

    Of several moving regions the largest counts, or that of the marked point, `segment.box_px` and `segment.point_px`; nothing lies outside the box. Raises
    InputError where nothing moves there.
    """
    prompt = Prompt.of(settings, mark, clip.frames.shape[1:3])
    core, still = moving_core(clip.frames[clip.seen], prompt)
    if core.mean() < LEAST_SHARE:
        raise InputError(
            f"{clip.source or 'clip'}: {100 * core.mean():.2f} % of frame 0 is seen to move by {LEAST_MOTION_PX:g} px or more, needs at least "
            f"{100 * LEAST_SHARE:g} % to find the object by motion; give scene.first_mask"
        )
    allowed = prompt.inside(core.shape) & ~still
    within = reachable(clip, core, settings)
    likely = core | _likely(clip.frames[0], core, within) | ends_inside(clip, within, settings)
    around = cv2.dilate(within.astype(np.uint8), np.ones((3, 3))) > 0
    found = _by_colour(clip.frames[0], core, likely, allowed & around)
    return filled(touching(found, core), but=~allowed).astype(np.uint8)


def moving_core(frames: np.ndarray, prompt: Prompt) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of frame 0 on moving texture, closed over the gaps between them, the region that the prompt chooses; and those that stand
    still beside it: bool (H, W) each."""
    movement = Movement.of(frames)
    if _on_most_sides(movement.moving):
        movement = Movement.of(_held_still(movement.frames))
    closed = _closed(movement.moving, 0.015 * np.sqrt(movement.moving.size))
    opened = cv2.morphologyEx(closed.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)) > 0
    core = prompt.region(opened)
    still = movement.still(core)
    return filled(core, but=still) & ~still, still


def _on_most_sides(moving: np.ndarray) -> bool:
    """Whether things move (H, W) along most sides of the picture: the camera may, then."""
    band = max(2, round(SIDE * min(moving.shape)))
    sides = moving[:band], moving[-band:], moving[:, :band], moving[:, -band:]
    return sum(side.mean() > MOVING_SIDE for side in sides) >= MOST_SIDES


def _held_still(frames: np.ndarray) -> np.ndarray:
    """Frames (K, H, W, 3) laid over the first by the motion on which most of the picture agrees; as they are where it does not agree."""
    grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32) for frame in frames]
    seen = overlay(grey, [np.ones(frames.shape[1:3], bool)] * len(frames))
    if np.median(seen.agreed) < LEAST_AGREED:
        return frames
    return np.stack([frames[0], *(as_seen_first(frame, matrix) for frame, matrix in zip(frames[1:], seen.matrix[1:], strict=True))])


def _by_colour(frame: np.ndarray, core: np.ndarray, likely: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """GrabCut (Rother et al. 2004) from the moving core and what else is likely, (H, W) each: sharp edges, and the still root where its
    colours continue; on `allowed` (H, W) pixels alone."""
    reach = max(3, round(0.03 * np.sqrt(core.sum())))
    guess = np.where(likely, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    guess[cv2.erode(core.astype(np.uint8), disc(reach)) > 0] = cv2.GC_FGD
    border = max(2, min(core.shape) // 60)
    rim = np.ones(core.shape, bool)
    rim[border:-border, border:-border] = False
    guess[(rim & ~core) | ~allowed] = cv2.GC_BGD
    object_like = (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)
    if object_like.all() or not object_like.any():  # colours of one side alone: nothing to tell apart
        return object_like
    cv2.setRNGSeed(0)
    cv2.grabCut(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), guess, None, np.zeros((1, 65)), np.zeros((1, 65)), 5, cv2.GC_INIT_WITH_MASK)
    return (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)


def _likely(frame: np.ndarray, core: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Pixels joined to the core that have its colours or, where depth bounds them, colours foreign to all beyond the bounds: bool (H, W)."""
    lab = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB)
    bins = (lab // 16).astype(int) @ (256, 16, 1)
    inside, outside = (_frequency(bins[region]) for region in (core, ~core))
    alike = (inside > outside)[bins]
    if not within.all():
        alike |= within & _closed(within & _foreign(lab, within), SPOT_SHARE * np.sqrt(core.sum()))
    _, regions = cv2.connectedComponents(cv2.morphologyEx(alike.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) | core)
    return (regions > 0) & np.isin(regions, np.unique(regions[core]))


def _foreign(lab: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Pixels whose chroma (CIELAB a, b) is rare beyond the bounds, bool (H, W)."""
    bins = lab[..., 1].astype(int) * 256 + lab[..., 2]
    count = cv2.GaussianBlur(np.bincount(bins[~within], minlength=256 * 256).reshape(256, 256).astype(np.float32), (0, 0), CHROMA_SPREAD)
    return (count * (2 * np.pi * CHROMA_SPREAD**2) < RARE * (~within).sum()).ravel()[bins]


def _closed(mask: np.ndarray, radius: float) -> np.ndarray:
    """A mask with its gaps up to twice the radius [px] closed."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc(max(2, round(radius)))) > 0


def _frequency(bins: np.ndarray) -> np.ndarray:
    return np.bincount(bins, minlength=4096) / max(len(bins), 1)
