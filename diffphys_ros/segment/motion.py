"""Object mask from what moves in the clip."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..types import Clip
from .prompt import Prompt
from .regions import disc, filled, pixel_grid, touching
from .surroundings import reachable

LEAST_MOTION_PX = 1.0  # displacement from which texture is said to have moved
LEAST_GAIN = 6.0  # grey levels by which the flow explains a moving pixel better than standing still
LEAST_SHARE = 0.001  # of the image that must move
STEADY = 0.3  # quantile over the frames in which a pixel must have moved: background that is merely passed over fails it
MOST_FRAMES = 24
CHROMA_SPREAD = 4.0  # units of CIELAB within which two chromas are one
SPOT_SHARE = 0.07  # of the root of the core's area: radius of a spot of the scene's colours on a still root of foreign ones
RARE = 0.002  # share of the scene below which a chroma is foreign to it


def motion_mask(clip: Clip, settings: Settings) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W): what moves, and its still root where colour continues it and, with a
    depth topic, up to the next step in depth or the clamped face.

    Of several moving regions the largest counts, or that of `segment.box_px` and `segment.point_px`; nothing lies outside the box. Raises InputError where
    nothing moves there.
    """
    prompt = Prompt.of(settings, clip.frames.shape[1:3])
    core = moving_core(clip.frames[clip.seen], prompt)
    if core.mean() < LEAST_SHARE:
        raise InputError(
            f"{clip.source or 'clip'}: {100 * core.mean():.2f} % of frame 0 is seen to move by {LEAST_MOTION_PX:g} px or more, needs at least "
            f"{100 * LEAST_SHARE:g} % to find the object by motion; give scene.first_mask"
        )
    allowed = prompt.inside(core.shape)
    return _by_colour(clip.frames[0], core, reachable(clip, core, settings), allowed).astype(np.uint8)


def moving_core(frames: np.ndarray, prompt: Prompt) -> np.ndarray:
    """Pixels of frame 0 on moving texture, closed over the gaps between them: bool (H, W), the region that the prompt chooses.

    Dense flow (DIS) bleeds far into plain background, so it is believed only where it explains the frames better than standing
    still does, and does so in most of the frames in which it claims motion.
    """
    gain = np.stack([_gain(frames[0], frames[k]) for k in _spread(len(frames))])
    claimed = np.isfinite(gain)
    ordered = np.sort(np.where(claimed, gain, np.inf), 0)
    rank = np.clip((STEADY * claimed.sum(0)).astype(int), 0, len(gain) - 1)
    steady = np.take_along_axis(ordered, rank[None], 0)[0]
    moving = (claimed.sum(0) >= max(2, len(gain) // 5)) & (steady > LEAST_GAIN)
    closed = _closed(moving, 0.015 * np.sqrt(moving.size))
    opened = cv2.morphologyEx(closed.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)) > 0
    return filled(prompt.region(opened))


def _spread(count: int) -> np.ndarray:
    return np.unique(np.linspace(1, count - 1, min(MOST_FRAMES, count - 1)).astype(int))


def _gain(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """How much better [grey levels] the flow explains each pixel of the first frame than standing still, float32 (H, W); inf where it
    claims no motion."""
    grey0, grey1 = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in (first, other))
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(grey0, grey1, None)
    moved = cv2.remap(other, pixel_grid(grey0.shape) + flow, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    difference = _difference(first, other) - _difference(first, moved)
    return np.where(np.linalg.norm(flow, axis=-1) > LEAST_MOTION_PX, cv2.boxFilter(difference, -1, (7, 7)), np.inf).astype(np.float32)


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(a.astype(np.float32) - b).max(-1)


def _by_colour(frame: np.ndarray, core: np.ndarray, within: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """GrabCut (Rother et al. 2004) from the moving core: sharp edges, and the still root where its colours continue or, inside a
    depth step's bounds `within` (H, W), where they are none of the scene's around; on `allowed` (H, W) pixels alone."""
    reach = max(3, round(0.03 * np.sqrt(core.sum())))
    guess = np.where(core | _likely(frame, core, within), cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    guess[cv2.erode(core.astype(np.uint8), disc(reach)) > 0] = cv2.GC_FGD
    border = max(2, min(core.shape) // 60)
    rim = np.ones(core.shape, bool)
    rim[border:-border, border:-border] = False
    guess[(rim & ~core) | ~allowed | ~cv2.dilate(within.astype(np.uint8), np.ones((3, 3))).astype(bool)] = cv2.GC_BGD
    cv2.setRNGSeed(0)
    cv2.grabCut(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), guess, None, np.zeros((1, 65)), np.zeros((1, 65)), 5, cv2.GC_INIT_WITH_MASK)
    found = (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)
    return filled(touching(found, core))


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
