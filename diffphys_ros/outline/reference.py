"""Which frame of a swing shows the object nearest to rest, and which frames after it are calm enough for small motions. numpy only.

The stillest frame of a swing is a turning point. The pose nearest to rest is the one nearest to the mean over whole periods of the calm part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

CALM = 0.04  # motion of the object's centroid over its extent: a tip then swings by .1, and the frequency of a strip is .4 % low at the most [chosen]
LEAST_PERIODS, WANTED_PERIODS, MOST_PERIODS = 2.5, 3.0, 6.0  # of the calm part; fewer tell no frequency, more tell little else and are smaller still [chosen]
PADDING = 8  # of the spectrum [numerical]
DRIFT = 2  # power of time with which amplitude and phase of a swing drift in six periods [numerical]
IN_MOTION = 0.5  # of the later swing, by which the object is aside in frame 0, or will be for its speed there: it is then not at rest [chosen]
SPEED_FRAMES = 3  # over which that speed is read [numerical]
LEAST_MOTION = 0.002  # of the extent, root mean square: less is no swing [chosen]


@dataclass(frozen=True)
class Calm:
    """The frames that small motions are read from: `rest` is the first of them, `end` the one after the last."""

    rest: int
    end: int
    periods: float


def calm_part(labels: np.ndarray, period_s: float, *, rest_frame: int | None = None, source: str = "clip") -> Calm:
    """Of label images (T, H, W). `rest_frame` is what a person tells of it. Raises InputError where nothing swings or too little follows."""
    centre, extent = _centres(labels)
    swing = _leading(centre) / extent
    if np.sqrt((swing**2).mean()) < LEAST_MOTION:
        raise InputError(f"{source}: the object's outline moves by less than {100 * LEAST_MOTION:g} % of its size, needs more to tell a stiffness; film a swing")
    period = 1 / (strongest(swing[len(swing) // 2 :]))  # frames
    needed = int(np.ceil(LEAST_PERIODS * period))
    if rest_frame is not None:
        return _told(rest_frame, len(swing), period, needed, source)
    if len(swing) < needed + period:
        raise InputError(f"{source}: shows {len(swing) / period:.1f} periods of a swing, needs at least {LEAST_PERIODS + 1:g}; record a longer free swing")
    wanted = int(np.ceil(WANTED_PERIODS * period))
    first = min(_calm_from(swing, round(period)), max(len(swing) - wanted - round(period / 2), 0))
    tail = swing[first:]
    whole = int(len(tail) // period * period)
    offset = np.abs(tail - tail[:whole].mean())[: round(period / 2) + 1]
    rest = first + int(offset.argmin())
    end = min(len(swing), rest + round(MOST_PERIODS * period) + 1)
    return Calm(rest, end, (end - rest - 1) / period)


def begins_in_motion(labels: np.ndarray) -> bool:
    """Whether frame 0 of label images (T, H, W) shows a swing, bent or moving, and not the pose about which the object swings later."""
    centre, extent = _centres(labels)
    swing = _leading(centre) / extent
    later = swing[len(swing) // 2 :]
    amplitude, middle = np.ptp(later) / 2, (later.max() + later.min()) / 2
    if len(swing) <= SPEED_FRAMES or amplitude < LEAST_MOTION:
        return False
    speed = (swing[SPEED_FRAMES] - swing[0]) / SPEED_FRAMES
    return bool(np.hypot(swing[0] - middle, speed / (2 * np.pi * strongest(later))) > IN_MOTION * amplitude)


def _told(rest: int, frames: int, period: float, needed: int, source: str) -> Calm:
    if rest + needed >= frames:
        raise InputError(
            f"scene.rest_frame is {rest}, of the {frames} frames of {source} at least {needed + 1} ({LEAST_PERIODS:g} periods) must follow it; "
            "tell an earlier frame, or leave it out"
        )
    end = min(frames, rest + round(MOST_PERIODS * period) + 1)
    return Calm(rest, end, (end - rest - 1) / period)


def _centres(labels: np.ndarray) -> tuple[np.ndarray, float]:
    """Centroids (T, 2) [px] of the object, that of the frame before where it is not seen, and its extent [px]."""
    inside = labels > 0
    down, across = inside.sum(2, dtype=float), inside.sum(1, dtype=float)
    size = down.sum(1)
    centre = np.stack([(each @ np.arange(each.shape[1])) / np.maximum(size, 1) for each in (across, down)], 1)
    known = np.where(size > 0, np.arange(len(size)), 0)
    usual = int(np.argsort(size)[len(size) // 2])
    extent = np.linalg.norm([np.ptp(np.flatnonzero(each[usual])) + 1.0 for each in (across, down)])
    return centre[np.maximum.accumulate(known)], float(extent)


def _leading(centre: np.ndarray) -> np.ndarray:
    """Motion (T,) along the direction in which points (T, 2) move most."""
    moved = centre - centre.mean(0)
    return moved @ np.linalg.svd(moved, full_matrices=False)[2][0]


def strongest(swing: np.ndarray, padding: int = PADDING) -> float:
    """Frequency [1/frame] of the strongest oscillation, at least one in all, of a spectrum padded so many times."""
    power = np.abs(np.fft.rfft((swing - swing.mean()) * np.hanning(len(swing)), padding * len(swing)))
    frequency = np.fft.rfftfreq(padding * len(swing))
    return float(frequency[np.where(frequency < 1 / len(swing), 0.0, power).argmax()])


def middle(moved: np.ndarray, frequency: float) -> np.ndarray:
    """What points (T, 2) swing about that oscillate with a frequency [1/frame] and grow or die away slowly: the constant beside a sine whose amplitude and
    phase drift as parabolas. The frame nearest to it may be off by half of what is travelled in one."""
    times = np.arange(len(moved))
    wave, drift = np.exp(2j * np.pi * frequency * times), np.vander(times / len(times), DRIFT + 1)
    sines = np.hstack([drift * part[:, None] for part in (wave.real, wave.imag)])
    return np.asarray(np.linalg.lstsq(np.column_stack([np.ones(len(times)), sines]), moved, rcond=None)[0][0])


def _calm_from(swing: np.ndarray, period: int) -> int:
    """The first frame from which the swing stays small; the last period's where it never is."""
    centre = np.convolve(swing, np.ones(period) / period, "valid")
    wide = np.lib.stride_tricks.sliding_window_view(swing, period)
    large = np.flatnonzero(np.abs(wide - centre[:, None]).max(1) > CALM)
    return int(large[-1]) + 1 if len(large) else 0
