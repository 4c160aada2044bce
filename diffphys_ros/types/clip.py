"""A recording, and what speaks against it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .camera import Camera


@dataclass(frozen=True)
class Thickness:
    """How far the object extends along an axis, as something measured it."""

    extent_m: float
    axis: np.ndarray  # unit vector, world, (3,)


@dataclass(frozen=True)
class Clip:
    """A recording on a uniform clock: T frames, `period_s` apart. A frame that was lost is a copy of the one before
    it, with `observed` false; nothing is fitted to it."""

    frames: np.ndarray  # RGB, uint8, shape (T, H, W, 3)
    start_ns: int  # stamp of frame 0 [ns]
    period_s: float  # time between frames [s]
    camera: Camera
    depth: np.ndarray | None = None  # along the optical axis [m], 0 where unknown, float32, shape (T, H, W)
    labels: np.ndarray | None = None  # 0 background, 1..n parts (1 at the clamp), 255 ignore; uint8, shape (T, H, W)
    observed: np.ndarray | None = None  # bool, shape (T,); None: all
    source: str = ""  # where the clip came from
    notes: tuple[str, ...] = ()  # what was assumed while reading, one sentence each
    first_labels: np.ndarray | None = None  # frame 0 as a mask topic labels it, or 0 and 255 for background and object; uint8 (H, W)
    thickness: Thickness | None = None  # measured; what a person tells goes before it
    gravity: np.ndarray | None = None  # measured, world [m/s^2], shape (3,); what a person tells goes before it

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def times(self) -> np.ndarray:
        """Time of every frame after frame 0 [s], shape (T,)."""
        return np.arange(len(self)) * self.period_s

    @property
    def seen(self) -> np.ndarray:
        """Which frames were really received, bool, shape (T,)."""
        return np.ones(len(self), bool) if self.observed is None else self.observed

    def part(self, first: int, end: int) -> Clip:
        """Its frames from `first` to the one before `end`; frame 0 is then the former `first`, for which no `first_labels` are known."""
        cut = {name: None if (value := getattr(self, name)) is None else value[first:end] for name in ("frames", "depth", "labels", "observed")}
        start_ns = self.start_ns + round(first * self.period_s * 1e9)
        return replace(self, **cut, start_ns=start_ns, first_labels=self.first_labels if first == 0 else None)  # type: ignore[arg-type]

    def with_labels(self, labels: np.ndarray) -> Clip:
        """The same clip with label images (T, H, W)."""
        return replace(self, labels=labels)


@dataclass(frozen=True)
class Doubt:
    """Something in a recording that contradicts what a recovery takes for granted; force and motion are then not those of the object."""

    text: str  # one sentence
    of_young: bool  # whether Young's modulus is not to be trusted either
