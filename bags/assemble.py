"""Frames with stamps to a Clip on a uniform clock; used for recordings and for live topics, so that both give the same clip."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from diffphys_ros.bags.exposure import with_steady_exposure
from diffphys_ros.bags.stuck import stuck_frames
from diffphys_ros.config import FrameSettings
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera, Clip

MIN_FRAMES = 2
MAX_LOST_SHARE = 0.5  # of the slots of the clock that may lack a frame
APART = 0.1  # of a period between colour and depth, from which on it is said
SEARCHED_PERIODS = (0.7, 1.2)  # as a share of the median step
MOST_PIXELS = 400_000_000  # of a clip, frames x width x height: 1300 frames of 640x480. Recovering needs some 40 bytes a pixel
MOST_FRAMES = 5_000
MOST_SIDE = 16_384  # px of a frame
LATEST_NS = 2**62  # of a stamp, to either side of 1970: the difference of two fits into 64 bits
PERIODS_S = (1e-6, 100.0)  # between two frames
Stamped = Sequence[tuple[int, np.ndarray]]  # stamp [ns], image
Zeros = Callable[[tuple[int, ...], type], np.ndarray]  # shape, type: numpy's, or others that make the arrays of a clip where they are to lie


class Bounded:
    """Stamped images of one source as they are read: it raises InputError at the first that is too many, before memory ends."""

    def __init__(self, source: str) -> None:
        self.taken: list[tuple[int, np.ndarray]] = []
        self._source, self._pixels = source, 0

    def add(self, stamp: int, image: np.ndarray) -> None:
        """Takes an image (H, W, ...) of a stamp [ns]."""
        self.taken.append((stamp, image))
        self._pixels += image.shape[0] * image.shape[1]
        check_extent(len(self.taken), self._pixels, self._source)


def check_extent(frames: int, pixels: int, source: str) -> None:
    """Raises InputError for a clip of more frames, or more pixels in all of them, than can be worked on."""
    if frames > MOST_FRAMES:
        raise InputError(f"{source}: has more than {MOST_FRAMES} frames; take fewer with frames.every, or cut out the seconds in which the object moves")
    if pixels > MOST_PIXELS:
        raise InputError(
            f"{source}: its first {frames} frames have {pixels} pixels together, at most {MOST_PIXELS} are taken (frames x width x height); "
            "take fewer with frames.every, cut out the seconds in which the object moves, or record smaller images"
        )


def assemble(
    images: Stamped,
    depths: Stamped,
    camera: Camera,
    source: str,
    *,
    notes: Sequence[str] = (),
    slop_s: float | None = None,
    frames: FrameSettings | None = None,
    zeros: Zeros = np.zeros,
) -> Clip:
    """A Clip from stamped images.

    The clock is the straight line through the stamps: jitter is ignored, a slot without a frame repeats the frame before it with
    `observed` false. Each frame takes the depth image nearest in time, if that is at most `slop_s` away. Drift of the exposure is
    taken off. What was done to the data is said in `Clip.notes`.

    Args:
        images: (stamp [ns], RGB uint8 (H, W, 3)) in any order. depths: (stamp [ns], [m] float32 (H, W), 0 unknown), or empty.
        source: where the clip comes from; error messages name it. notes: put before the notes found here.
        slop_s: longest time between a colour image and its depth image [s]; half a period where not given.
        frames: which frames of the clock to take, all where not given; of the others nothing but their stamps is looked at.
        zeros: makes the arrays of frames and depth.

    Raises InputError for fewer than two frames, sizes that differ or are too large, stamps that are no clock, depth that holds nothing,
    more than MOST_FRAMES or MOST_PIXELS, and fewer than `frames` asks for.
    """
    _check_stamps([stamp for some in (images, depths) for stamp, _ in some], source)
    check_extent(len(images), len(images) * camera.width * camera.height, source)
    if max(camera.width, camera.height) > MOST_SIDE:
        raise InputError(f"{source}: the images have {camera.width}x{camera.height} px, may have {MOST_SIDE} px a side; record smaller images")
    images = sorted(_checked_sizes(images, camera, source, "colour"), key=lambda item: item[0])
    stamps = np.array([stamp for stamp, _ in images], np.int64)
    slots, period, found = uniform_clock(stamps, source)
    notes = [*notes, *found]
    if frames is not None:
        total = int(slots[-1]) + 1
        fitted = fitted_frames(frames, total, source)
        kept = slots < fitted
        left_out = total - fitted - frames.predict
        notes += [f"the first {fitted} of {total} frames are fitted (frames.fit), the last {left_out} are left out"] if left_out else []
        slots, stamps = slots[kept], stamps[kept]
    last_of_slot = np.searchsorted(slots, np.arange(slots[-1] + 1), side="right") - 1
    pictures = np.stack([images[i][1] for i in last_of_slot], out=zeros((len(last_of_slot), camera.height, camera.width, 3), np.uint8))
    observed = np.isin(np.arange(len(pictures)), slots)
    stuck = stuck_frames(pictures, observed)
    pictures, drift = with_steady_exposure(pictures, out=pictures)
    notes += [f"the exposure drifted by up to {drift:.1%} of that of frame 0; the drift was taken off"] if drift else []
    notes += [f"{stuck.sum()} of {len(pictures)} frames show the picture before once more while things move; nothing is fitted to them"] if stuck.any() else []
    observed &= ~stuck
    depth = None
    if len(depths):
        depth, found = _paired(depths, stamps, slots, camera, source, slop_s=period / 2 if slop_s is None else slop_s, period=period, zeros=zeros)
        notes += found
    return Clip(pictures, int(stamps[0]), period, camera, depth, observed=observed, source=source, notes=tuple(notes))


def fitted_frames(frames: FrameSettings, total: int, source: str) -> int:
    """How many of a recording's `total` frames are fitted. Raises InputError where it has fewer than are asked for."""
    if frames.fit and frames.fit + frames.predict > total:
        raise InputError(
            f"{source}: has {total} frames, frames.fit {frames.fit} and frames.predict {frames.predict} need {frames.fit + frames.predict}; "
            "lower one of them, or record a longer clip"
        )
    left = frames.fit or total - frames.predict
    if left < MIN_FRAMES:
        raise InputError(
            f"{source}: has {total} frames, of which frames.predict {frames.predict} leaves {max(left, 0)} to the fit, at least {MIN_FRAMES} are needed; lower it"
        )
    return left


def uniform_clock(stamps: np.ndarray, source: str) -> tuple[np.ndarray, float, list[str]]:
    """Slot number of every frame (T,), the period [s], and notes, of ascending stamps [ns] (T,).

    Raises InputError where the stamps do not grow, or leave more slots empty than MAX_LOST_SHARE.
    """
    if len(stamps) < MIN_FRAMES:
        raise InputError(f"{source}: has {len(stamps)} colour frame(s), at least {MIN_FRAMES} are needed; record a longer clip")
    seconds = (stamps - stamps[0]) * 1e-9
    typical = float(np.median(np.diff(seconds)))
    if typical <= 0:
        raise InputError(f"{source}: most frames carry the stamp of their predecessor, they must grow; have the driver stamp its images")
    if not PERIODS_S[0] <= typical <= PERIODS_S[1]:
        raise InputError(
            f"{source}: its frames are {typical:.3g} s apart, must be between {PERIODS_S[0]:g} and {PERIODS_S[1]:g} s; have the driver stamp its images in "
            "seconds and nanoseconds"
        )
    period, start = _likeliest_clock(seconds, typical)
    # jitter of single stamps averages out over the clip; the first pass numbers the frames, the second settles doubtful ones
    for _ in range(2):
        slots = np.rint((seconds - start) / period).astype(np.int64)
        if slots[-1] > slots[0]:
            period, start = np.polyfit(slots, seconds, 1)
    slots -= slots[0]
    lost = int(slots[-1]) + 1 - len(np.unique(slots))
    doubled = len(slots) - len(np.unique(slots))
    if lost > MAX_LOST_SHARE * (slots[-1] + 1) or doubled > MAX_LOST_SHARE * len(slots):
        raise InputError(
            f"{source}: the stamps of {len(stamps)} frames follow no steady clock ({lost} of {slots[-1] + 1} slots of {period:.4g} s are "
            f"empty), at most {MAX_LOST_SHARE:.0%} may be; record one take with a fixed frame rate"
        )
    notes = [f"{lost} of {slots[-1] + 1} frames were lost in the recording; nothing is fitted to them"] if lost else []
    notes += [f"{doubled} frames came twice in one period of {period:.4g} s; the later one is used"] if doubled else []
    return slots, float(period), notes


def _likeliest_clock(seconds: np.ndarray, typical: float) -> tuple[float, float]:
    """Period and start [s] with which most stamps agree in phase: lost frames do not bias it as they do a median of steps."""
    low, high = SEARCHED_PERIODS
    # close enough that the phase at the last frame moves by an eighth of a period from one candidate to the next
    frequencies = np.linspace(1 / high, 1 / low, 8 * len(seconds) + 8) / typical
    phases = [np.exp(2j * np.pi * frequency * seconds).sum() for frequency in frequencies]
    best = int(np.argmax(np.abs(phases)))
    return 1 / frequencies[best], float(np.angle(phases[best])) / (2 * np.pi * frequencies[best])


def _paired(
    depths: Stamped, stamps: np.ndarray, slots: np.ndarray, camera: Camera, source: str, *, slop_s: float, period: float, zeros: Zeros
) -> tuple[np.ndarray, list[str]]:
    """Depth (T, H, W) [m] of every slot, and notes."""
    depths = sorted(_checked_sizes(depths, camera, source, "depth"), key=lambda item: item[0])
    if not any((image > 0).any() for _, image in depths):
        raise InputError(f"{source}: the depth images hold no finite value above 0; set topics.depth to 'none' to go on without depth")
    times = np.array([stamp for stamp, _ in depths], np.int64)
    result = zeros((int(slots[-1]) + 1, camera.height, camera.width), np.float32)
    nearest = np.array([np.abs(times - stamp).argmin() for stamp in stamps])
    apart = np.abs(times[nearest] - stamps) * 1e-9
    for index, slot, distance in zip(nearest, slots, apart, strict=True):
        if distance <= slop_s:
            result[slot] = depths[index][1]
    return result, said_of_pairs(apart, slop_s, period, source)


def said_of_pairs(apart: np.ndarray, slop_s: float, period: float, source: str) -> list[str]:
    """What is said of depth images that are missing, or not of the time of their colour image, by the time [s] from each of these to the
    nearest. Raises InputError where all are missing."""
    kept = apart[apart <= slop_s]
    if not len(kept):
        raise InputError(
            f"{source}: no depth image lies within {1e3 * slop_s:.3g} ms of a colour image (sync.slop_s), the nearest is {1e3 * apart.min():.3g} ms away; "
            "have the cameras synchronised, raise sync.slop_s, or set topics.depth to 'none'"
        )
    missing = len(apart) - len(kept)
    notes = [f"{missing} of {len(apart)} frames have no depth image within {1e3 * slop_s:.3g} ms (sync.slop_s)"] if missing else []
    if len(kept) and np.median(kept) > APART * period:
        notes.append(
            f"depth and colour are {1e3 * np.median(kept):.3g} ms apart (median of {len(kept)} pairs, at most {1e3 * kept.max():.3g} ms): depth is that of another moment; "
            "have the cameras synchronised, or lower sync.slop_s"
        )
    return notes


def _check_stamps(stamps: Sequence[int], source: str) -> None:
    if far := [stamp for stamp in stamps if abs(stamp) > LATEST_NS]:
        raise InputError(f"{source}: an image carries the stamp {far[0] * 1e-9:.3g} s, must be within {LATEST_NS * 1e-9:.3g} s of 1970; correct the driver's clock")


def _checked_sizes(images: Stamped, camera: Camera, source: str, what: str) -> Stamped:
    for _, image in images:
        if image.shape[:2] != (camera.height, camera.width):
            cure = "record depth registered to the colour camera or with its own camera_info, or set topics.depth to 'none'" if what == "depth" else "record one size"
            raise InputError(
                f"{source}: a {what} image has {image.shape[1]}x{image.shape[0]} px, must have the camera's {camera.width}x{camera.height} "
                f"px; {cure}"
            )
    return images
