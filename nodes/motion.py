"""Does something move? A cheap test on thumbnails, for what is to be known while a clip is recorded."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

LAG = 3  # frames between two pictures that are compared: a slow motion shows, too
LEAST_CHANGE = 2.0  # of the brightness of a block, 0 .. 255, that can be motion
SIGMAS = 6.0  # of the noise, as the median block shows it, above which a change is motion
LEAST_SHARE = 0.001  # of the blocks that change while something moves
LEAST_BLOCKS = 3
LEAST_REST, LEAST_TAIL = 3, 8  # frames before the motion, and after it was largest, below which a clip cannot be identified


class Seen(NamedTuple):
    """One image, as far as motion goes."""

    stamp: int  # [ns]
    change: float  # sum over the blocks that move of how much their brightness changed; 0: nothing moves


class Watch:
    """How much changes from image to image; kept as long as the images are."""

    def __init__(self) -> None:
        self.seen: deque[Seen] = deque()
        self._pictures: deque[np.ndarray] = deque(maxlen=LAG + 1)

    def look(self, stamp: int, picture: np.ndarray | None) -> None:
        """The thumbnail (h, w) of the latest image; None where it could not be decoded."""
        if picture is None:
            return
        if self._pictures and self._pictures[-1].shape != picture.shape:
            self._pictures.clear()
        self._pictures.append(picture)
        self.seen.append(Seen(stamp, change(self._pictures[0], picture)))

    def forget_before(self, stamp: int) -> None:
        """What was seen of images that are not kept."""
        while self.seen and self.seen[0].stamp < stamp:
            self.seen.popleft()

    def clear(self) -> None:
        """Forget all."""
        self.seen.clear()
        self._pictures.clear()

    @property
    def moving(self) -> bool:
        """Whether something moves in the latest two images: a single one may be spoilt."""
        return len(self.seen) > 1 and self.seen[-1].change > 0 and self.seen[-2].change > 0

    def still_s(self) -> float:
        """How long nothing has moved [s]."""
        last = next((seen.stamp for seen in reversed(self.seen) if seen.change > 0), None)
        return 0.0 if last is None else (self.seen[-1].stamp - last) * 1e-9

    def rest(self) -> int | None:
        """Frames before the first motion; None where nothing has moved."""
        changes = [seen.change > 0 for seen in self.seen]
        return next((k for k in range(len(changes) - 1) if changes[k] and changes[k + 1]), None)

    def tail(self) -> int | None:
        """Frames since the motion was largest; None where nothing has moved."""
        if self.rest() is None:
            return None
        changes = [seen.change for seen in self.seen]
        return len(changes) - 1 - int(np.argmax(changes))

    def motion_began(self) -> int:
        """Stamp of the first image that shows motion [ns]; something must move."""
        return self.seen[self.rest() or 0].stamp


def change(before: np.ndarray, after: np.ndarray) -> float:
    """Sum of the changes of brightness that are no noise and no change of exposure; 0 where too few blocks show any."""
    difference = after - before
    difference -= np.median(difference)
    size = np.abs(difference)
    moving = size > max(LEAST_CHANGE, SIGMAS * 1.4826 * float(np.median(size)))
    return float(size[moving].sum()) if moving.sum() >= max(LEAST_BLOCKS, LEAST_SHARE * moving.size) else 0.0
