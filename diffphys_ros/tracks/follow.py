"""Surface points followed from frame 0 through the whole clip."""

from __future__ import annotations

import numpy as np

from ..config import Settings
from ..errors import InputError
from ..matching import Matching, normalised, seed_points, track_pixels
from ..types import Clip, Tracks, object_mask
from .coherence import settled
from .lift import points_from_depth, points_on_planes, without_oddities
from .noise import displacement_noise, position_sd, track_residuals
from .refine import refined
from .turning import turned_back

MOST_TRACKS = 500
LEAST_TRACKS = 8
LEAST_SHARE = 0.5  # of the received frames in which a track must hold
LARGEST_RESIDUAL = 4.0  # of a track against its surroundings over the whole clip, in medians over all tracks


class LostError(InputError):
    """Too few points of the surface could be followed."""


def follow(clip: Clip, depth0: np.ndarray, settings: Settings) -> Tracks:
    """Tracks of visible surface points (see types.Tracks).

    Lucas-Kanade from frame 0 straight to k, so that errors do not add up, seeded by the track at k - 1; checked forwards and
    backwards and against the neighbours; then matched again by patches that turn and shear with the surface. What no motion shared by
    all tracks explains is dropped. Needs `clip.labels`.

    Args:
        clip: recording with label images.
        depth0: the object's surface in frame 0 [m], 0 off the object, shape (H, W).
        settings: `tracks.*`, and `scene.thickness_axis` where the clip has no depth.

    Raises:
        LostError: fewer than 8 points could be followed.
    """
    if clip.labels is None:
        raise ValueError("follow needs clip.labels; run segment.label_clip first")
    mask = object_mask(clip.labels[0]) & (depth0 > 0)
    start = seed_points(normalised(clip.frames[0]), mask, spacing_px=settings.experiment.track_spacing_px, most=MOST_TRACKS)
    pixels, points, valid, spread = _followed(clip, start, mask, depth0, settings)
    keep = valid[0] & (valid[clip.seen].mean(0) > LEAST_SHARE)
    if keep.sum() < LEAST_TRACKS:
        raise LostError(
            f"{clip.source or 'clip'}: {int(keep.sum())} surface points could be followed, at least {LEAST_TRACKS} are needed; "
            "film a textured object larger in the image, or raise experiment.track_round_trip_px"
        )
    judged = _without_turn(points, valid, settings)
    residual = track_residuals(judged[:, keep], valid[:, keep])
    keep = np.flatnonzero(keep)[residual <= LARGEST_RESIDUAL * np.median(residual)]
    points, judged, valid = points[:, keep], judged[:, keep], valid[:, keep]
    by_patch = spread[:, keep] * clip.camera.project(points[0])[1] / clip.camera.focal_px
    sd = position_sd(judged, valid, by_patch, clip.camera.position, along=clip.depth is not None)
    return Tracks(pixels[:, keep], points, valid, clip.depth is not None, displacement_noise(judged, valid), sd)


def follow_on(clip: Clip, tracks: Tracks, depth0: np.ndarray, settings: Settings) -> Tracks:
    """The same points, none left out, through a clip that begins with that of `tracks` and goes on. Their places in frame 0 stay. No standard
    deviations are estimated: nothing is to be fitted to them. Else as `follow`."""
    assert clip.labels is not None
    mask = object_mask(clip.labels[0]) & (depth0 > 0)
    pixels, points, valid, _ = _followed(clip, tracks.pixels[0].astype(np.float32), mask, depth0, settings)
    points[0] = tracks.points[0] if tracks.first is None else tracks.first
    return Tracks(pixels, points + (tracks.points[0] - points[0]), valid, clip.depth is not None, tracks.noise_m, first=tracks.first)


def _followed(clip: Clip, start: np.ndarray, mask: np.ndarray, depth0: np.ndarray, settings: Settings) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (T, M, 2), points (T, M, 3) [m], where they hold (T, M), and what their patches say of their spread (T, M) [px], of points
    `start` (M, 2) [px] of frame 0 on the object `mask` (H, W)."""
    window_px = settings.experiment.track_window_px
    matching = Matching(window_px, settings.experiment.track_round_trip_px, settings.scene.thrown)
    pixels, valid = track_pixels([normalised(frame) for frame in clip.frames], start, clip.seen, matching)
    pixels, valid, spread = refined(clip.frames, pixels, valid, mask, window_px=window_px)
    points, valid = _lifted(clip, pixels, valid, depth0, settings)
    valid = without_oddities(points, valid)
    still, valid = settled(clip, _without_turn(points, valid, settings), valid)
    points[0] = still[0]
    return pixels, points, valid, spread


def _without_turn(points: np.ndarray, valid: np.ndarray, settings: Settings) -> np.ndarray:
    """Positions (T, M, 3) [m] in which points are judged by how others move: of an object that nothing holds, as seen by who turns along."""
    return turned_back(points, valid) if settings.scene.thrown else points


def _lifted(clip: Clip, pixels: np.ndarray, valid: np.ndarray, depth0: np.ndarray, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    if clip.depth is not None:
        return points_from_depth(clip, pixels, valid, depth0)
    axis = settings.scene.thickness_unit
    normal = np.array(axis) if axis is not None and clip.camera.pose_known else clip.camera.world_from_camera[:3, 2]
    return points_on_planes(clip.camera, pixels, valid, depth0, normal)
