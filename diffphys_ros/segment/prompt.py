"""Which of several regions is the object: the one that a person points at, or the largest."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError

POINT_REACH_PX = 12.0  # a click may miss its object by this much
POINT, CLICK = "segment.point_px", "the click"


@dataclass(frozen=True)
class Mark:
    """What was clicked or masked in frame 0 of this very clip; both may be None. It goes before what the settings say of the same."""

    point: np.ndarray | None = None  # u, v [px], shape (2,)
    labels: np.ndarray | None = None  # 0 background, 1..n parts, 255 ignore; or 0 and 255 for background and object; uint8, shape (H, W)


NO_MARK = Mark()


@dataclass(frozen=True)
class Prompt:
    """What says where the object is in frame 0; box and point may be None."""

    box: np.ndarray | None  # left, top, right, bottom [px], shape (4,)
    point: np.ndarray | None  # u, v [px], shape (2,)
    origin: str = POINT  # of the point, for people

    @classmethod
    def of(cls, settings: Settings, mark: Mark, shape: tuple[int, ...]) -> Prompt:
        """From `segment.box_px` and the marked point, else `segment.point_px`, for images (H, W). Raises InputError where they lie off the image."""
        height, width = shape[:2]
        told, origin = (settings.segment.point_px, POINT) if mark.point is None else (mark.point, CLICK)
        box, point = (None if v is None else np.array(v, float) for v in (settings.segment.box_px, told))
        if box is not None and not (
            box[0] < box[2] and box[1] < box[3] and box[0] < width and box[1] < height and box[2] >= 0 and box[3] >= 0
        ):
            raise InputError(
                f"segment.box_px {box.tolist()}: must be left, top, right, bottom inside the {width} x {height} image; draw it around the object"
            )
        if point is not None and not (0 <= point[0] <= width - 1 and 0 <= point[1] <= height - 1):
            raise InputError(
                f"{origin} {point.tolist()}: must lie inside the {width} x {height} image; click on the object in frame 0"
            )
        return cls(box, point, origin)

    def inside(self, shape: tuple[int, ...]) -> np.ndarray:
        """Pixels of the box, all where there is none, bool (H, W)."""
        v, u = np.ogrid[: shape[0], : shape[1]]
        if self.box is None:
            return np.ones(shape[:2], bool)
        left, top, right, bottom = self.box
        return (u >= left) & (u <= right) & (v >= top) & (v <= bottom)

    def region(self, mask: np.ndarray) -> np.ndarray:
        """The connected region of a mask (H, W) inside the box that the point lies on, or nearly on; without a point the largest.

        Raises InputError where no region is that near to the point. Empty for a mask that is empty inside the box.
        """
        count, labels, stats, _ = cv2.connectedComponentsWithStats((mask & self.inside(mask.shape)).astype(np.uint8))
        if count < 2:
            return np.zeros(mask.shape, bool)
        return labels == (1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]) if self.point is None else self._at_point(labels))

    def _at_point(self, labels: np.ndarray) -> int:
        assert self.point is not None
        v, u = np.nonzero(labels)
        distance = np.hypot(u - self.point[0], v - self.point[1])
        nearest = int(distance.argmin())
        if distance[nearest] > POINT_REACH_PX:
            raise InputError(
                f"{self.origin} {self.point.tolist()}: the nearest region that the segmenter finds is {distance[nearest]:.0f} px away, must be within "
                f"{POINT_REACH_PX:g} px; click on the object or choose another segment.method"
            )
        return int(labels[v[nearest], u[nearest]])
