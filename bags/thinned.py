"""Every so-many-th frame of a recording that has more than a fit needs; frames are chosen by the clock, so that lost ones shift nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffphys_ros.bags.assemble import uniform_clock


def chosen(stamps: Sequence[int], every: int, source: str) -> list[int]:
    """Which images (stamps [ns], in any order) lie in every `every`-th slot of their clock, the first among them; indices, ascending.

    Raises InputError where the stamps are no clock.
    """
    if every == 1 or len(stamps) < 2:
        return list(range(len(stamps)))
    order = np.argsort(stamps, kind="stable")
    slots, _, _ = uniform_clock(np.asarray(stamps, np.int64)[order], source)
    return sorted(int(i) for i in order[slots % every == 0])


def nearest(times: Sequence[int], stamps: Sequence[int]) -> list[int]:
    """Which of the images taken at `times` [ns] are nearest to some of the `stamps` [ns]; indices, ascending."""
    known = np.asarray(times, np.int64)
    return sorted({int(np.abs(known - stamp).argmin()) for stamp in stamps}) if len(known) else []


def said(every: int, kept: int, total: int) -> list[str]:
    """A note on what was left out."""
    return [f"every {every}. frame was taken (frames.every): {kept} of {total}"] if every > 1 else []
