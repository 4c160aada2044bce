"""Figures of a finished recovery that need more than its own frames: where the object moves, and how it looks to a network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..config import Settings
from ..metrics.image import psnr_masked
from ..metrics.lpips import WEIGHTS, Lpips
from ..types import Recovery, Tracks, object_mask
from .prepared import Prepared

MOVING_PX = 0.5  # rms displacement of the tracks from which a frame counts as moving: a still one equals frame 0, at 100 dB
Measure = Callable[[np.ndarray, np.ndarray, np.ndarray], float]
LEFT_OUT = f"LPIPS was left out because {WEIGHTS} is not set."


@dataclass(frozen=True)
class Judge:
    """What the settings allow to measure."""

    lpips: Lpips | None

    @classmethod
    def of(cls, settings: Settings, *, device: str) -> Judge:
        """Reads weights at once, so that a bad file is known before a long fit. Raises InputError."""
        folder = settings.experiment.lpips_weights
        return cls(None if folder is None else Lpips.of(folder, device=device))

    def judged(self, recovery: Recovery, prepared: Prepared) -> Recovery:
        """The recovery with masked PSNR over the moving frames and masked LPIPS, each beside the frozen first frame's."""
        clip, labels = prepared.clip, prepared.clip.labels
        if recovery.frames is None or labels is None:
            return recovery
        found = where_it_moves(recovery.frames, prepared)
        if self.lpips is None:
            return replace(recovery, metrics=recovery.metrics | found, notes=(*recovery.notes, LEFT_OUT))
        mask = object_mask(labels)
        found |= _beside_frozen("lpips_masked", self.lpips.masked, recovery.frames, clip.frames, mask, np.flatnonzero(clip.seen & mask.any((1, 2)))[1:])
        return replace(recovery, metrics=recovery.metrics | found)


def where_it_moves(rendered: np.ndarray, prepared: Prepared) -> dict[str, float]:
    """In how many frames the object moves, `moving_frames`, and over these the masked PSNR [dB] of a rendering (T, H, W, 3), `psnr_masked_moving`, beside that
    of the observed frame 0."""
    clip, labels = prepared.clip, prepared.clip.labels
    assert labels is not None
    mask = object_mask(labels)
    moving = np.flatnonzero(clip.seen & mask.any((1, 2)) & moving_frames(prepared.tracks))
    return {"moving_frames": len(moving), **_beside_frozen("psnr_masked_moving", psnr_masked, rendered, clip.frames, mask, moving)}


def moving_frames(tracks: Tracks) -> np.ndarray:
    """Frames in which the tracks lie at least MOVING_PX (rms) from where they were in frame 0, bool (T,)."""
    square = ((tracks.pixels - tracks.pixels[:1]) ** 2).sum(-1)
    valid = tracks.valid.sum(1)
    return np.where(tracks.valid, square, 0).sum(1) >= MOVING_PX**2 * np.maximum(valid, 1)


def _beside_frozen(
    name: str, measure: Measure, rendered: np.ndarray, observed: np.ndarray, mask: np.ndarray, chosen: np.ndarray
) -> dict[str, float]:
    """Means over the chosen frames of a measure of (image, image, mask), of the rendering and of the observed frame 0; NaN where none is chosen."""
    own = [measure(rendered[k], observed[k], mask[k]) for k in chosen]
    frozen = [measure(observed[0], observed[k], mask[k]) for k in chosen]
    return {key: float(np.mean(values)) if values else float("nan") for key, values in ((name, own), (f"{name}_frozen_frame", frozen))}
