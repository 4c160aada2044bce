"""Object mask from optical flow (paper 4.1): everything that moves, however thin, without the plain scenery that it sweeps over."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from ..config import Settings
from ..errors import InputError
from ..types import Clip
from .likeness import likeness
from .movement import Movement
from .prompt import Mark, Prompt
from .regions import disc, filled, pixel_grid

LEAST_MOTION_PX = 0.3  # displacement from which a pixel may count as moving: far below what a track needs, since many frames agree
LEAST_SHARE = 0.001  # of the image that must move
LEAST_GAIN = 0.2  # of the difference that standing still leaves, which moving along must take away
NOISE = 1.5  # grey levels by which frames differ where nothing moves
STEADY_GAIN, STEADY_SHARE = 1.0, 0.5  # grey levels, and share of the frames: scenery that is swept over looks like itself in most frames
BAND = 0.006  # of the root of the image: how far beyond what the flow explains the object may reach
AROUND = 0.05  # of the root of the image: colours are compared with those beside the object
CLOSED = 0.012  # of the root of the image: half the width of a gap in what moves that plain texture may leave
NARROW = 0.004  # and of one that is no gap between strands
SLACK_PX = 2.0  # by which the window over which differences are averaged widens what moves
PIECE = 0.02  # of the largest piece that moves: smaller ones are no strands of the object
WINDOW_PX = 5  # over which differences are averaged
ROUNDS = 3  # of GrabCut


def flow_mask(clip: Clip, settings: Settings, mark: Mark) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W): of the pixels that moving along the flow explains better than standing still,
    over all frames together, those that are not scenery swept over; holes and separate strands as they are.

    A plain wall beside a swinging object is explained by moving along as well as the object itself: wherever the object covers it, it has
    changed, and elsewhere every plain place looks like every other. It is told by what it looks like in the frames in which it is not
    covered, and by its colours. Nothing lies outside segment.box_px. Raises InputError where nothing moves.
    """
    frames = clip.frames[clip.seen]
    inside = Prompt.of(settings, mark, frames.shape[1:3]).inside(frames.shape[1:3])
    seen = Movement.of(frames)
    explained = _explained(seen) & inside
    region = _large(_closed(explained, CLOSED))
    if region.mean() < LEAST_SHARE:
        raise InputError(f"{clip.source or 'clip'}: {100 * region.mean():.2f} % of frame 0 is seen to move, needs at least {100 * LEAST_SHARE:g} %; give scene.first_mask")
    steady = region & (cv2.morphologyEx(seen.steadily(LEAST_MOTION_PX, STEADY_GAIN, STEADY_SHARE).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0)
    deep = distance_transform_edt(region & _closed(explained, NARROW)) > seen.reach_px() + SLACK_PX
    found = _by_colour(clip.frames[0], region, filled(region, but=seen.still(region)), steady, deep)
    return _large(_without_lines(found & inside, steady)).astype(np.uint8)


def _explained(seen: Movement) -> np.ndarray:
    """Pixels (H, W) that the flow explains better than standing still, in the sum over the frames in which it claims a motion."""
    first = seen.frames[0]
    still, moved = np.zeros(first.shape[:2], np.float32), np.zeros(first.shape[:2], np.float32)
    grid = pixel_grid(first.shape[:2])
    for other, flow in zip(seen.frames[1:], seen.flow.astype(np.float32), strict=True):
        there = cv2.remap(other, grid + flow, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        claims = np.linalg.norm(flow, axis=-1) > LEAST_MOTION_PX
        still += claims * _difference(first, other)
        moved += claims * _difference(first, there)
    still, moved = (cv2.boxFilter(total, -1, (WINDOW_PX, WINDOW_PX)) for total in (still, moved))
    return (still - moved > LEAST_GAIN * still) & (still > NOISE * len(seen.flow))


def _by_colour(frame: np.ndarray, region: np.ndarray, whole: np.ndarray, steady: np.ndarray, deep: np.ndarray) -> np.ndarray:
    """The object (H, W) in the region that the flow explains, by GrabCut (Rother et al. 2004) from what moves steadily.

    `whole` is the region with the holes of which nothing is known. What lies deeper in the region than it moves was not swept over; where
    it has the object's colours as well, it is the object.
    """
    beyond = distance_transform_edt(~whole) / np.sqrt(region.size)
    wide, beside = beyond <= BAND, (beyond > BAND) & (beyond <= BAND + AROUND)
    if not (steady.any() and beside.any()):
        return region
    alike = wide & (likeness(frame, steady, beside) > 0)
    guess = np.where(wide, cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    guess[alike | steady] = cv2.GC_PR_FGD
    guess[alike & deep] = cv2.GC_FGD
    cv2.setRNGSeed(0)
    cv2.grabCut(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), guess, None, np.zeros((1, 65)), np.zeros((1, 65)), ROUNDS, cv2.GC_INIT_WITH_MASK)
    return (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)


def _without_lines(mask: np.ndarray, steady: np.ndarray) -> np.ndarray:
    """A mask (H, W) without lines of a pixel's width that do not move: an edge of the scenery ends in the object."""
    return mask & (steady | (cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0))


def _closed(mask: np.ndarray, share: float) -> np.ndarray:
    """A mask closed over gaps of twice a share of the root of the image."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc(max(1, round(share * np.sqrt(mask.size))))) > 0


def _large(mask: np.ndarray) -> np.ndarray:
    """A mask without pieces that are small beside the largest; across narrow gaps pieces are one."""
    _, labels = cv2.connectedComponents(_closed(mask, CLOSED).astype(np.uint8))
    area = np.bincount(labels[mask], minlength=int(labels.max()) + 1)
    return mask & (area[labels] > PIECE * area.max())


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(a.astype(np.float32) - b).max(-1)
