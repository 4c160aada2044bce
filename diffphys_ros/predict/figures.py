"""A predicted motion against what was observed, beside the two trivial answers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from ..inverse.answer import shown_frames
from ..inverse.observed import TrackTarget
from ..metrics.image import psnr_masked
from ..particles import bind
from ..types import Body, object_mask
from .held_out import HeldOut, judged_tracks


@dataclass(frozen=True)
class Figures:
    """`prediction` of metrics.json. None: nothing could be compared."""

    frames: int  # that were predicted
    tracks: int  # that were compared in one of them at least
    rms_m: float | None  # misfit of one coordinate of the tracks
    rms_motion_m: float | None  # of one coordinate of them, from frame 0
    over_rms_motion: float | None  # the one over the other
    over_rms_motion_at_rest: float | None  # the same for the frozen first frame
    over_rms_motion_last_frame: float | None  # and for the frozen last fitted frame
    psnr_masked: float | None  # of the rendering [dB], and of these two frames
    psnr_masked_frozen_frame: float | None
    psnr_masked_last_frame: float | None
    force_at_end: bool  # whether a force still acted in the last fitted frames

    def stored(self) -> dict[str, object]:
        """As metrics.json has it."""
        return asdict(self)

    def described(self) -> str:
        """In a line for people."""
        if self.over_rms_motion is None or self.rms_m is None:
            return f"{self.frames} frames; no point that was fitted is seen to move in them"
        trivial = f"first frame {self.over_rms_motion_at_rest:.3f}, last fitted frame {self.over_rms_motion_last_frame:.3f}"
        said = f"{self.frames} frames, misfit {1e3 * self.rms_m:.2f} mm, {self.over_rms_motion:.3f} of the motion ({trivial})"
        if self.psnr_masked is None:
            return said
        return f"{said}; PSNR {self.psnr_masked:.2f} dB (first frame {self.psnr_masked_frozen_frame:.2f}, last fitted frame {self.psnr_masked_last_frame:.2f})"


def figures(held: HeldOut, body: Body, trajectory: np.ndarray, rendered: np.ndarray | None, *, force_at_end: bool) -> Figures:
    """Of particles' places `trajectory` (T, N, 3) [m, world] in all frames of the recording, and of the held-out ones as they were
    `rendered` (F, H, W, 3), uint8."""
    return Figures(held.count, **_of_tracks(held, body, trajectory), **_of_pictures(held, rendered), force_at_end=force_at_end)


def _of_tracks(held: HeldOut, body: Body, trajectory: np.ndarray) -> dict[str, Any]:
    tracks, frozen = judged_tracks(held)
    names = ("rms_m", "rms_motion_m", "over_rms_motion", "over_rms_motion_at_rest", "over_rms_motion_last_frame")
    if not tracks.valid.any():
        return {"tracks": 0, **dict.fromkeys(names)}
    target = TrackTarget.of(tracks, body, held.clip.camera, dtype=torch.float64, device="cpu")
    x = trajectory.astype(float)
    moved = bind(tracks.points[0], x[0]).apply(np.concatenate([np.zeros_like(x[:1]), x[held.fitted :] - x[0]]))
    turned = body.world_from_body[:3, :3]  # displacements of the world to the body frame: from the right

    def rms(displacement: np.ndarray) -> float:
        return target.rms(torch.as_tensor(np.broadcast_to(displacement @ turned, moved.shape).copy()))

    at_rest = rms(np.zeros(3))
    shares = [rms(moved) / at_rest, 1.0, rms(frozen) / at_rest] if at_rest else [None] * 3
    return {"tracks": int(tracks.valid.any(0).sum()), **dict(zip(names, (rms(moved), at_rest, *shares), strict=True))}


def _of_pictures(held: HeldOut, rendered: np.ndarray | None) -> dict[str, Any]:
    clip, shown = held.clip, [k for k in shown_frames(held.clip) if k >= held.fitted]
    assert clip.labels is not None
    mask, first, last = object_mask(clip.labels), clip.frames[0], clip.frames[held.fitted - 1]

    def psnr(image: np.ndarray, k: int) -> float:
        return psnr_masked(image, clip.frames[k], mask[k])

    means = [float(np.mean([psnr(image, k) for k in shown])) if shown else None for image in (first, last)]
    own = [psnr(rendered[k - held.fitted], k) for k in shown] if rendered is not None else []
    return {"psnr_masked": float(np.mean(own)) if own else None, "psnr_masked_frozen_frame": means[0], "psnr_masked_last_frame": means[1]}
