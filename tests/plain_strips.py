"""Clips of a plain strip that swings by the first mode of a clamped beam, drawn with soft edges: everything about them is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.bags.write import Message, write_recording
from diffphys_ros.msg_schemas import messages
from diffphys_ros.msg_schemas.topics import CAMERA_INFO, IMAGE
from diffphys_ros.outline import covered
from diffphys_ros.types import Clip

ROOT = 1.8751041  # of the first mode of a clamped beam


@dataclass(frozen=True)
class Strip:
    """A strip that hangs from a clamp beyond the picture's upper edge."""

    length_px: float = 150.0
    width_px: float = 16.0
    behind_px: float = 15.0  # of the clamp beyond the picture
    px_per_m: float = 2000.0
    middle_px: float = 55.0
    hz: float = 5.0
    damping: float = 0.02  # ratio
    size: tuple[int, int] = (150, 110)  # height and width [px]
    frames: int = 120
    fps: float = 120.0
    tip_px: float = 14.0  # amplitude in frame 0
    turn: float = 0.6  # phase [rad]: frame 0 is bent and moving
    grey: tuple[float, float] = (24.0, 150.0)  # of scene and strip
    noise: float = 0.0  # grey levels

    @property
    def specific(self) -> float:
        """Young's modulus over density [m^2/s^2] of a beam with Poisson's ratio .3 in plane stress that swings so, with shear and rotation to
        first order (Timoshenko)."""
        length, width = self.length_px / self.px_per_m, self.width_px / self.px_per_m
        thin = (2 * np.pi * self.hz * length**2 / ROOT**2) ** 2 * 12 / width**2
        slender = (width / length) ** 2 / 12
        return float(thin * (1 + slender * (4.648 + 1.1941 * 2.6 / 0.85 * ROOT**4 / ROOT**2)))

    def sway(self) -> np.ndarray:
        """Of the tip in every frame [px], (T,)."""
        t, omega = np.arange(self.frames) / self.fps, 2 * np.pi * self.hz
        return self.tip_px * np.exp(-self.damping * omega * t) * np.cos(omega * np.sqrt(1 - self.damping**2) * t + self.turn)

    def shape(self, along: np.ndarray) -> np.ndarray:
        """The mode, 1 at the tip, at distances from the clamp [px]."""
        x, k = ROOT * along / self.length_px, 0.7340955
        tip = np.cosh(ROOT) - np.cos(ROOT) - k * (np.sinh(ROOT) - np.sin(ROOT))
        return (np.cosh(x) - np.cos(x) - k * (np.sinh(x) - np.sin(x))) / tip

    def wide(self, along: np.ndarray) -> np.ndarray:
        """Its width [px] at distances from the clamp [px]."""
        return np.full(len(along), self.width_px)

    def outline(self, sway: float) -> np.ndarray:
        """The strip's outline (P, 2) [px] with its tip so far aside."""
        along = np.linspace(0, self.length_px, 80)
        centre = np.stack([self.middle_px + sway * self.shape(along), along - self.behind_px], 1)
        tangent = np.gradient(centre, axis=0)
        across = np.stack([-tangent[:, 1], tangent[:, 0]], 1) / np.linalg.norm(tangent, axis=1, keepdims=True) * self.wide(along)[:, None] / 2
        return np.concatenate([centre + across, (centre - across)[::-1]])

    def clip(self, shift_px: np.ndarray | float = 0.0) -> Clip:
        """As a video without a told lens; `shift_px` (T, 2): of a camera that a hand holds."""
        dark, bright = self.grey
        noise = np.random.default_rng(0).normal(0, self.noise, (self.frames, *self.size)) if self.noise else np.zeros(self.frames)
        shift = np.broadcast_to(shift_px, (self.frames, 2))
        shares = (covered(self.outline(sway) + by, self.size) for sway, by in zip(self.sway(), shift, strict=True))
        grey = np.stack([dark + (bright - dark) * share + n for share, n in zip(shares, noise, strict=True)])
        frames = np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, -1)
        height, width = self.size
        return Clip(frames, 0, 1 / self.fps, replace(camera_from_fov(50.0, width, height), lens_told=False), source="strip")

    def record(self, path: Path) -> Path:
        """As a recording of a camera whose lens is known."""
        return write_recording(path, self._messages())

    def _messages(self) -> Iterator[Message]:
        clip = self.clip()
        for k, pixels in enumerate(clip.frames):
            ns = 10**9 + round(k * clip.period_s * 1e9)
            head = messages.header(ns, "camera_optical")
            yield "/camera/camera_info", CAMERA_INFO, ns, messages.camera_info(head, clip.camera), False
            yield "/camera/image_raw", IMAGE, ns, messages.image(head, pixels, "rgb8"), False


@dataclass(frozen=True)
class Tapered(Strip):
    """One that is wider towards its free end. Its mode is that of a beam by Ritz's method; what a uniform one of its mean width owes to shear and rotation
    is taken for its own."""

    end_px: float = 34.0  # width of the free end

    def wide(self, along: np.ndarray) -> np.ndarray:
        return self.width_px + (self.end_px - self.width_px) * along / self.length_px

    def _mode(self) -> tuple[float, np.ndarray]:
        """Squared frequency of E / density = 1 [1/s^2], px for m, and the shares of the powers 2 .. 6 of the distance over the length."""
        x, power = (np.arange(400) + 0.5) / 400, np.arange(2, 7)[:, None]
        width, value = self.wide(x * self.length_px), x**power
        bent = power * (power - 1) * x ** (power - 2) / self.length_px**2
        square, shares = eigh((bent * width**3 / 12) @ bent.T, (value * width) @ value.T)
        return float(square[0]), shares[:, 0] / shares[:, 0].sum()

    def shape(self, along: np.ndarray) -> np.ndarray:
        return np.asarray(self._mode()[1] @ (along / self.length_px) ** np.arange(2, 7)[:, None])

    @property
    def specific(self) -> float:
        uniform = replace(Strip(), length_px=self.length_px, width_px=(self.width_px + self.end_px) / 2)
        thin = (2 * np.pi * uniform.hz * uniform.length_px**2 / ROOT**2) ** 2 * 12 / uniform.width_px**2 / uniform.px_per_m**2
        return float((2 * np.pi * self.hz) ** 2 / self._mode()[0] / self.px_per_m**2 * uniform.specific / thin)
