"""Figures of a finished recovery that need more than its own frames: where the object moves, and how it looks to a network."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..config import Settings
from ..errors import InputError
from ..losses import foreground, psnr_masked
from ..lpips import BACKBONE, HEADS, Lpips
from ..types import Recovery, Tracks
from .prepare import Prepared

MOVING_PX = 0.5  # rms displacement of the tracks from which a frame counts as moving: a still one equals frame 0, at 100 dB
LEFT_OUT = f"LPIPS was left out because {BACKBONE} and {HEADS} are not set."


@dataclass(frozen=True)
class Judge:
    """What the settings allow to measure."""

    lpips: Lpips | None

    @classmethod
    def of(cls, settings: Settings, *, device: str) -> Judge:
        """Reads weights at once, so that a bad file is known before a long fit. Raises InputError."""
        backbone, heads = settings.metrics.lpips_backbone, settings.metrics.lpips_heads
        if (backbone is None) != (heads is None):
            raise InputError(f"{HEADS if heads is None else BACKBONE} is not set but the other file of LPIPS is; give both or neither")
        return cls(None if backbone is None or heads is None else Lpips(backbone, heads, device=device))

    def judged(self, recovery: Recovery, prepared: Prepared) -> Recovery:
        """The recovery with masked PSNR over the moving frames and masked LPIPS, each beside the frozen first frame's."""
        if recovery.frames is None or prepared.clip.labels is None:
            return recovery
        found = self._moving(recovery.frames, prepared) | self._perceptual(recovery.frames, prepared)
        notes = recovery.notes if self.lpips else (*recovery.notes, LEFT_OUT)
        return replace(recovery, metrics=recovery.metrics | found, notes=notes)

    def _moving(self, frames: np.ndarray, prepared: Prepared) -> dict[str, object]:
        clip, mask = prepared.clip, foreground(prepared.clip.labels)
        chosen = [k for k in np.flatnonzero(moving_frames(prepared.tracks) & clip.seen) if mask[k].any()]
        own = [psnr_masked(frames[k], clip.frames[k], mask[k]) for k in chosen]
        frozen = [psnr_masked(clip.frames[0], clip.frames[k], mask[k]) for k in chosen]
        return {"moving_frames": len(chosen), "psnr_masked_moving": _mean(own), "psnr_masked_moving_frozen_frame": _mean(frozen)}

    def _perceptual(self, frames: np.ndarray, prepared: Prepared) -> dict[str, object]:
        if self.lpips is None:
            return {}
        clip, mask = prepared.clip, foreground(prepared.clip.labels)
        chosen = [k for k in np.flatnonzero(clip.seen) if mask[k].any()]
        own = [self.lpips.masked(frames[k], clip.frames[k], mask[k]) for k in chosen]
        frozen = [self.lpips.masked(clip.frames[0], clip.frames[k], mask[k]) for k in chosen if k > 0]
        return {"lpips_masked": _mean(own), "lpips_masked_frozen_frame": _mean(frozen)}


def moving_frames(tracks: Tracks) -> np.ndarray:
    """Frames in which the tracks lie at least MOVING_PX (rms) from where they were in frame 0, bool (T,)."""
    square = ((tracks.pixels - tracks.pixels[:1]) ** 2).sum(-1)
    valid = tracks.valid.sum(1)
    return np.where(tracks.valid, square, 0).sum(1) >= MOVING_PX**2 * np.maximum(valid, 1)


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
