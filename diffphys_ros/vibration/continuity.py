"""Whether the tracks' clock and their start are what they are said to be, from coordinates over time alone. numpy only.

A body moves on from where it is: a push, however hard, changes its speed from one frame to the next, not its place. Frames that are
missing though the stamps run on do change its place.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .forced_frames import LEAST_TAIL_FRAMES, Rows, start_of_tail

STRIDE, SMOOTH, ALONE, SURE = 0.9, 2.5, 2.5, 10.0  # a gap over the longest step beside it, over third differences there, over all other gaps, over noise [chosen]
STRANGE, QUIET_AROUND, ALONE_STRANGE = 8.0, 0.35, 1.5  # what no push explains over the usual misfit, the equations around over it, and it over all others [chosen]
BESIDE = 3  # frames around a gap whose gaps it spoils [derived: a parabola through three frames]
WITHOUT_REST = 0.3  # distance of the shape that a body swings about from that of frame 0, over its motion; large swings shift it as well [chosen]
LEAST_PERIODS = 1.5  # of free motion that tell of that shape [chosen]
MOVING, MOVING_SURE = 0.55, 10.0  # first step over the second, and over the noise: a force that sets in with frame 0 makes it a third, or half [chosen]


def jump_after(q: np.ndarray, known: np.ndarray, *, at_rest: bool, noise_m: float, common_m: float) -> int | None:
    """The frame after which the body is elsewhere at once; None where it moves on steadily.

    Args:
        q: leading coordinates [m], (T, n). known: frames in which they were seen, bool (T,).
        noise_m: standard deviation of a coordinate of one track [m]; common_m: of a coordinate q [m].
    """
    found = _leap(q, known, common_m)
    return found if found is not None else _break(q, known, at_rest, noise_m)


def _leap(q: np.ndarray, known: np.ndarray, common_m: float) -> int | None:
    """By the parabolas through three frames before and three after, which must meet half-way between: a push between two frames opens a gap
    of half of the step that follows at the most. Four frames on either side must be smooth: one seen wrongly opens a gap as well."""
    if len(q) < 8:
        return None
    at = np.arange(3, len(q) - 4)  # the frame before the gap
    left, right = ((15 * q[at + near] - 10 * q[at + near + side] + 3 * q[at + near + 2 * side]) / 8 for near, side in ((0, -1), (1, 1)))
    gap = np.linalg.norm(right - left, axis=1) * np.lib.stride_tricks.sliding_window_view(known, 8).all(1)
    step, third = (np.linalg.norm(np.diff(q, order, axis=0), axis=1) for order in (1, 3))
    stride = np.max([step[at + k] for k in (-2, -1, 1, 2)], 0)
    rough = np.maximum(third[at - 3], third[at + 1])
    found = np.flatnonzero((gap > STRIDE * stride) & (gap > SMOOTH * rough) & (_over_others(gap, BESIDE) > ALONE) & (gap > SURE * common_m))
    return int(at[found[gap[found].argmax()]]) if len(found) else None


def _break(q: np.ndarray, known: np.ndarray, at_rest: bool, noise_m: float) -> int | None:
    """By the recursion of the free motion: a push between frames k + 1 and k + 2 adds shares of one vector to the equations k and k + 1, a
    jump adds anything; a frame that was seen wrongly spoils three."""
    rows = Rows.of(q, known, at_rest)
    start = start_of_tail(rows)
    if start is None:
        return None
    matrix, misfit, _, sigma, _ = rows.robust(start, q[known], noise_m)
    rest = np.where(rows.usable[:, None], rows.target - rows.source @ matrix, 0.0)
    strange = np.array([_no_push(a, b) for a, b in pairwise(rest)])
    around = np.maximum(np.r_[0.0, misfit[:-2]], np.r_[misfit[2:], 0.0])
    found = (strange > STRANGE * sigma) & (around < QUIET_AROUND * np.maximum(misfit[:-1], misfit[1:])) & (_over_others(strange, BESIDE) > ALONE_STRANGE)
    found &= rows.usable[:-1] & rows.usable[1:]
    return int(np.where(found, strange, 0.0).argmax()) + 1 if found.any() else None


def _no_push(first: np.ndarray, second: np.ndarray) -> float:
    """What of two equations' residuals no push within a frame explains: the distance of the first from all shares of their sum [m]."""
    whole = first + second
    share = np.clip(first @ whole / max(float(whole @ whole), 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(first - share * whole))


def _over_others(values: np.ndarray, beside: int) -> np.ndarray:
    """Every value (N,) over the largest of those that lie further than `beside` from it."""
    places = np.arange(len(values))
    others = [values[np.abs(places - i) > beside].max(initial=0.0) for i in places]
    return values / np.maximum(others, 1e-300)


def moving_at_first(q: np.ndarray, known: np.ndarray, *, common_m: float) -> bool:
    """Whether the body moves in frame 0 already: from rest the first step is far shorter than the second. Arguments as in jump_after."""
    if not known[:3].all():
        return False
    first, second = np.linalg.norm(np.diff(q[:3], axis=0), axis=1)
    return bool(first > MOVING_SURE * common_m and first > MOVING * second)


def swings_off_rest(q: np.ndarray, known: np.ndarray, frequency_hz: float, period_s: float, *, noise_m: float) -> bool:
    """Whether the shape that the body swings about freely, at `frequency_hz`, is another than that of frame 0; false where nothing tells.
    Other arguments as in jump_after."""
    rows = Rows.of(q, known, False)
    start = start_of_tail(rows)
    if start is None:
        return False
    matrix, _, keep, _, _ = rows.robust(start, q[known], noise_m)
    free = q[np.flatnonzero(keep) + 2]
    if len(free) < LEAST_TAIL_FRAMES or len(free) * period_s * frequency_hz < LEAST_PERIODS:
        return False
    centre = rows.centre(matrix)
    far, size = float(np.linalg.norm(centre)), float(np.sqrt(((free - centre) ** 2).sum(1).mean()))
    return far > WITHOUT_REST * size and far > MOVING_SURE * noise_m
