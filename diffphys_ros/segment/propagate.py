"""Labels of frame 0 carried to every frame."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from ..inpaint import nearest_known
from ..matching import Matching, normalised, seed_points, track_pixels
from ..types import IGNORE, object_mask
from .colour import settle_by_colour
from .interpolate import interpolated_sources
from .occlude import ColourWitness, DepthWitness, before_the_scene
from .regions import pixel_grid

TRACKS, SPACING_PX = 150, 4
MATCHING = Matching(window_px=15, round_trip_px=0.4)


def propagate(frames: np.ndarray, seen: np.ndarray, first: np.ndarray, depth: np.ndarray | None = None) -> np.ndarray:
    """Label images (T, H, W) uint8 from that of frame 0 (H, W).

    Two opinions where a pixel came from: dense flow, which follows whatever the object uncovers, and the motion of a few points
    on the object continued beyond its border, which misses faces that turn into view. Where they disagree, colour decides.
    What passes between camera and object is labelled 255: where `depth` (T, H, W) [m] puts it before the object, and where its colours
    are neither the object's there nor the scene's behind. Frames (T, H, W, 3) RGB; frames that were not received (`seen` false) repeat the
    labels before them.
    """
    by_flow, by_tracks, hidden = _opinions(frames, seen, first, depth)
    labels = by_flow.copy()
    for k in range(1, len(frames)):
        labels[k] = _settled(frames[k], by_flow[k], by_tracks[k], hidden[k]) if seen[k] else labels[k - 1]
    return labels


def _opinions(
    frames: np.ndarray, seen: np.ndarray, first: np.ndarray, depth: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Labels (T, H, W) by dense flow; by the motion of tracked points, on and around what the flow labels, those of the flow where too few
    points are known; and the pixels (T, H, W) where something hides the object."""
    images = [normalised(frame) for frame in frames]
    start = seed_points(images[0], _object(first), spacing_px=SPACING_PX, most=TRACKS)
    pixels, valid = track_pixels(images, start, seen, MATCHING)
    by_flow = np.repeat(first[None], len(frames), 0)
    by_tracks, hidden, odd = by_flow.copy(), np.zeros(by_flow.shape, bool), np.zeros(by_flow.shape, bool)
    colours = ColourWitness(frames[0])
    depths = None if depth is None else DepthWitness(depth, _object(first), start)
    tracked: np.ndarray | None = None
    for k, flowed in _flows(frames, seen):
        by_flow[k] = by_tracks[k] = _warped(first, flowed)
        found = interpolated_sources(pixels[k][valid[k]], start[valid[k]], _object(by_flow[k]) | _object(by_tracks[k - 1]))
        tracked = tracked if found is None else found  # hidden as a whole, it is taken to be where it was seen last
        if tracked is None:
            continue
        by_tracks[k] = _warped(first, tracked)
        region = _object(by_tracks[k]) | _object(by_flow[k])
        if depths is not None and depth is not None:
            hidden[k] = depths.hidden(k, pixels[k], valid[k], tracked, region)
            region &= depth[k] == 0  # where it is known, it decides
        odd[k] = colours.strange(frames[k], (flowed, tracked), region)
    return by_flow, by_tracks, hidden | before_the_scene(frames, (by_tracks == 0) & (by_flow == 0), odd)


def _flows(frames: np.ndarray, seen: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Every received frame after the first and where its pixels came from, float32 (H, W, 2): DIS flow (Kroeger et al. 2016) straight back
    to frame 0, started from the flow of the frame before, so that errors do not add up."""
    flow_of = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    first = cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
    grid = pixel_grid(first.shape)
    flow = None
    for k in np.flatnonzero(seen[1:]) + 1:
        flow = flow_of.calc(cv2.cvtColor(frames[k], cv2.COLOR_RGB2GRAY), first, flow)
        yield int(k), grid + flow


def _settled(frame: np.ndarray, by_flow: np.ndarray, by_tracks: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """One label image from two: part numbers by the flow, or by the nearest pixel where it saw none."""
    inside = settle_by_colour(frame, _object(by_flow) & ~hidden, _object(by_tracks) & ~hidden)
    ignored = (by_flow == IGNORE) | hidden
    known = _object(by_flow) & inside
    if not known.any():
        return np.where(ignored, IGNORE, by_flow).astype(np.uint8)
    return np.where(ignored, IGNORE, np.where(inside, nearest_known(by_flow, known), 0)).astype(np.uint8)


def _object(labels: np.ndarray) -> np.ndarray:
    return object_mask(labels)


def _warped(first: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The label image read at pixel positions `source` (H, W, 2): the label with the largest bilinear share."""
    values = np.unique(first)
    shares = [cv2.remap((first == value).astype(np.float32), source, None, cv2.INTER_LINEAR) for value in values]
    return values[np.argmax(shares, 0)].astype(np.uint8)
