"""A film as others would bring it, written without loss: worse, turned, cut, or seen by another camera.

usage: python benchmarks/degraded_film.py FILM.mp4 OUT.avi HOW     (one of blur, noise, ...: the names of WORSE)
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from itertools import pairwise

import cv2
import numpy as np

BLUR_PX, NOISE = 2.0, 5.0  # standard deviation, and that of grey levels alike in all channels
LOST = 12  # every so-many-th frame is
HELD, LEAVES = 24, 90  # frames that a finger holds the tip for, and in which it is drawn back
FINGER = (70, 14)  # half axes [px]
TREMOR_PX, TREMOR_HZ = 1.5, 0.8  # root mean square of a hand's motion either way, and the frequency from which on it falls with the square
HAND_PX, HAND_HZ = np.array([2.0, 1.2]), np.array([0.9, 1.3])  # sideways and up, amplitude and frequency of the camera's motion
DRIFT = 0.3  # by which the exposure has changed at the end
FLICKER, FLICKER_HZ = 0.06, 100.0  # of the light, over the mean
Frames = np.ndarray  # (T, H, W, 3) uint8
Worse = Callable[[Frames, float], tuple[Frames, float]]


def blurred(frames: Frames, fps: float) -> tuple[Frames, float]:
    """Out of focus."""
    return np.stack([cv2.GaussianBlur(frame, (0, 0), BLUR_PX) for frame in frames]), fps


def noisy(frames: Frames, fps: float) -> tuple[Frames, float]:
    """In dim light."""
    rng = np.random.default_rng(0)
    return np.stack([_levels(frame + rng.normal(0, NOISE, frame.shape[:2])[..., None]) for frame in frames]), fps


def thinned(every: int) -> Worse:
    """Of a camera that takes fewer frames, with a short shutter."""
    return lambda frames, fps: (frames[::every], fps / every)


def shuttered(every: int) -> Worse:
    """The same with a shutter that stays open for half of a frame."""

    def worse(frames: Frames, fps: float) -> tuple[Frames, float]:
        groups = frames[: len(frames) // every * every].reshape(-1, every, *frames.shape[1:])
        return np.stack([_levels(group[: every // 2].mean(0)) for group in groups]), fps / every

    return worse


def rolling(frames: Frames, fps: float) -> tuple[Frames, float]:
    """Of a shutter that reads row after row, all of a frame's time long."""
    share = (np.arange(frames.shape[1]) / frames.shape[1])[:, None, None]
    return np.stack([_levels((1 - share) * a + share * b) for a, b in pairwise(frames)]), fps


def with_lost(frames: Frames, fps: float) -> tuple[Frames, float]:
    """With the frame before in place of lost ones."""
    shown = np.arange(len(frames))
    shown[LOST::LOST] -= 1
    return frames[shown], fps


def held(frames: Frames, fps: float) -> tuple[Frames, float]:
    """A finger holds the tip in frame 0, lets it go, and is drawn back."""
    tip = _tip(frames[0])
    back = [0] * HELD + [k * k // 20 for k in range(LEAVES)]
    began = np.concatenate([np.repeat(frames[:1], HELD, 0), frames])
    return np.stack([_with_finger(frame, tip, x) for frame, x in zip(began, back, strict=False)] + [*began[len(back) :]]), fps


def flickering(frames: Frames, fps: float) -> tuple[Frames, float]:
    """Under a lamp on the mains."""
    light = 1 + FLICKER * np.sin(2 * np.pi * FLICKER_HZ * np.arange(len(frames)) / fps)
    return _lit(frames, light), fps


def _lit(frames: Frames, light: np.ndarray) -> Frames:
    """Each frame under its own light (T,)."""
    return np.stack([_levels(one * frame) for one, frame in zip(light, frames, strict=True)])


def by_hand(frames: Frames, fps: float) -> tuple[Frames, float]:
    """Of a camera that a hand holds, to shares of a pixel; what comes in at the border is what was last seen there."""
    return _moved(frames, HAND_PX * np.sin(2 * np.pi * HAND_HZ * np.arange(len(frames))[:, None] / fps)), fps


def by_trembling_hand(frames: Frames, fps: float) -> tuple[Frames, float]:
    """The same of a hand whose motion has all frequencies."""
    spectrum = np.fft.rfft(np.random.default_rng(len(frames)).normal(size=(len(frames), 2)), axis=0)
    moved = np.fft.irfft(spectrum / (1 + (np.fft.rfftfreq(len(frames), 1 / fps)[:, None] / TREMOR_HZ) ** 2), len(frames), axis=0)
    return _moved(frames, TREMOR_PX * moved / moved.std(0)), fps


def _moved(frames: Frames, shift: np.ndarray) -> Frames:
    """Each frame moved by so much (T, 2) [px]."""
    size = frames.shape[2:0:-1]
    return np.stack([cv2.warpAffine(frame, np.array([[1.0, 0, x], [0, 1.0, y]]), size, borderMode=cv2.BORDER_REPLICATE) for frame, (x, y) in zip(frames, shift, strict=True)])


def drifting(frames: Frames, fps: float) -> tuple[Frames, float]:
    """With an exposure that follows something else."""
    return _lit(frames, 1 + DRIFT * np.linspace(0, 1, len(frames))), fps


def scaled(by: float) -> Worse:
    """With other pixels."""
    return lambda frames, fps: (np.stack([cv2.resize(frame, None, fx=by, fy=by, interpolation=cv2.INTER_AREA if by < 1 else cv2.INTER_CUBIC) for frame in frames]), fps)


def seen(change: Callable[[Frames], np.ndarray]) -> Worse:
    """With pixels elsewhere or of another brightness."""
    return lambda frames, fps: (change(frames), fps)


WORSE: dict[str, Worse] = {
    "blur": blurred, "noise": noisy, "rolling": rolling, "lost": with_lost, "held": held, "flicker": flickering, "hand": by_hand, "tremor": by_trembling_hand, "drift": drifting,
    "60fps": thinned(4), "30fps": thinned(8), "60fps-shutter": shuttered(4), "30fps-shutter": shuttered(8), "half": scaled(0.5), "double": scaled(2.0),
    "mirrored": seen(lambda f: f[:, :, ::-1]), "turned": seen(lambda f: np.rot90(f, -1, (1, 2))), "overhead": seen(lambda f: f[:, ::-1, ::-1]),
    "brighter": seen(lambda f: _levels(1.6 * f.astype(np.float32) + 25)), "gamma": seen(lambda f: _levels(255 * (f / np.float32(255)) ** 0.6)), "negative": seen(lambda f: 255 - f),
    "no-top": seen(lambda f: f[:, 30:]), "no-tip": seen(lambda f: f[:, :150]), "two-periods": lambda f, fps: (f[: round(0.41 * fps)], fps), "slow-motion": lambda f, fps: (f, fps / 8),
}  # fmt: skip


def _levels(grey: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _tip(frame: np.ndarray) -> tuple[int, int]:
    """The lowest pixel x, y of the largest bright region."""
    grey = frame[..., 1]
    bright = (grey > (int(grey.max()) + int(grey.min())) // 2).astype(np.uint8)
    _, regions, stats, _ = cv2.connectedComponentsWithStats(bright)
    rows, columns = np.nonzero(regions == 1 + stats[1:, cv2.CC_STAT_AREA].argmax())
    return int(columns[rows.argmax()]), int(rows.max())


def _with_finger(frame: np.ndarray, tip: tuple[int, int], back_px: int) -> np.ndarray:
    """A finger from the right that ends at the tip, or so far back."""
    drawn, (x, y) = frame.copy(), tip
    middle, colour = (x + back_px + FINGER[0] - 10, y - 5), (120, 135, 150)
    cv2.ellipse(drawn, middle, FINGER, 0, 0, 360, colour, -1)
    cv2.rectangle(drawn, (middle[0], middle[1] - FINGER[1]), (drawn.shape[1], middle[1] + FINGER[1]), colour, -1)
    return drawn


def _frames(read: cv2.VideoCapture) -> Iterator[np.ndarray]:
    while True:
        there, frame = read.read()
        if not there:
            return
        yield frame


def main(film: str, out: str, how: str) -> int:
    """Returns the exit status."""
    read = cv2.VideoCapture(film)
    frames, fps = WORSE[how](np.stack(list(_frames(read))), read.get(cv2.CAP_PROP_FPS))
    written = cv2.VideoWriter(out, cv2.VideoWriter_fourcc(*"FFV1"), fps, frames.shape[2:0:-1])
    for frame in frames:
        written.write(np.ascontiguousarray(frame))
    written.release()
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[3] not in WORSE:
        raise SystemExit(f"{__doc__}HOW: {', '.join(WORSE)}")
    sys.exit(main(*sys.argv[1:]))
