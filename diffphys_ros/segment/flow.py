"""Object mask from optical flow alone (paper 4.1): everything that moves, however thin, and nothing by its colour far from there."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..types import Clip
from .movement import Movement
from .prompt import Mark, Prompt
from .regions import disc, pixel_grid

LEAST_MOTION_PX = 0.3  # displacement from which a pixel may count as moving: far below what a track needs, since many frames agree
LEAST_SHARE = 0.001  # of the image that must move
LEAST_GAIN = 0.2  # of the difference that standing still leaves, which moving along must take away
NOISE = 1.5  # grey levels by which frames differ where nothing moves
BAND = 0.006  # of the root of the image: how far the outline by flow may be off, where colours decide
CLOSED = 0.012  # of the root of the image: half the width of a gap in what moves that plain texture may leave
PIECE = 0.02  # of the largest piece that moves: smaller ones are no strands of the object
WINDOW_PX = 5  # over which differences are averaged


def flow_mask(clip: Clip, settings: Settings, mark: Mark) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W): pixels that moving along the flow explains better than standing still, over all
    frames together, holes and separate strands as they are; near its outline, colours decide.

    Nothing lies outside segment.box_px. Raises InputError where nothing moves.
    """
    frames = clip.frames[clip.seen]
    prompt = Prompt.of(settings, mark, frames.shape[1:3])
    moving = _moving(Movement.of(frames)) & prompt.inside(frames.shape[1:3])
    moving = _pieces(moving)
    if moving.mean() < LEAST_SHARE:
        raise InputError(f"{clip.source or 'clip'}: {100 * moving.mean():.2f} % of frame 0 is seen to move, needs at least {100 * LEAST_SHARE:g} %; give scene.first_mask")
    return _pieces(_outlined(clip.frames[0], moving)).astype(np.uint8)


def _moving(seen: Movement) -> np.ndarray:
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


def _pieces(mask: np.ndarray) -> np.ndarray:
    """A mask closed over narrow gaps, without pieces that are small beside the largest."""
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc(round(CLOSED * np.sqrt(mask.size))))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
    area = stats[:, cv2.CC_STAT_AREA].copy()
    area[0] = 0
    return area[labels] > PIECE * area.max() if area.any() else np.zeros(mask.shape, bool)


def _outlined(frame: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """The mask (H, W) with its outline by GrabCut (Rother et al. 2004) in a band about that of the flow; elsewhere as it was."""
    radius = max(1, round(BAND * np.sqrt(moving.size)))
    wide = cv2.dilate(moving.astype(np.uint8), disc(radius)) > 0
    sure = cv2.erode(moving.astype(np.uint8), disc(radius)) > 0
    near = cv2.dilate(wide.astype(np.uint8), disc(4 * radius)) > 0  # colours are compared with those beside the object
    guess = np.full(moving.shape, cv2.GC_BGD, np.uint8)
    guess[wide] = np.where(moving[wide], cv2.GC_PR_FGD, cv2.GC_PR_BGD)
    guess[sure] = cv2.GC_FGD
    if not (sure.any() and (near & ~wide).any()):
        return moving
    cv2.setRNGSeed(0)
    cv2.grabCut(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), guess, None, np.zeros((1, 65)), np.zeros((1, 65)), 3, cv2.GC_INIT_WITH_MASK)
    return (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(a.astype(np.float32) - b).max(-1)
