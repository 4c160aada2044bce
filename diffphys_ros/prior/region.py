"""From records to the material at every pixel of frame 0 (paper section 3.2: nearest-neighbour fill)."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..inpaint import nearest_known
from ..types import MaterialPrior, object_mask
from .records import Record

NOBODY = -1


def spread(records: list[Record], labels: np.ndarray, *, source: str, notes: tuple[str, ...] = ()) -> MaterialPrior:
    """The prior that records make on a label image of frame 0 (H, W).

    What is said of the whole object gives way to boxes, large boxes to small ones, boxes to parts. Pixels of the object that no
    record covers take the nearest one's, and so does what lies off the object, so that points beside the silhouette find a
    material too. Raises InputError where no record touches the object.
    """
    body = object_mask(labels)
    index = np.full(labels.shape, NOBODY, np.int16)
    for k in sorted(range(len(records)), key=lambda k: _rank(records[k])):
        index[_covered(records[k], labels) & body] = k
    if not (index >= 0).any():
        raise InputError(f"{source}: no box or part touches the object in frame 0; correct the boxes (shares of the image's width and height)")

    def column(name: str) -> np.ndarray:
        return np.array([getattr(record, name) for record in records], float)

    return MaterialPrior(
        index=nearest_known(index, index != NOBODY),
        name=tuple(record.name for record in records),
        young=column("young"),
        log10_young_sd=column("log10_young_sd"),
        poisson=column("poisson"),
        density=column("density"),
        source=source,
        notes=notes,
    )


def _rank(record: Record) -> tuple[int, float]:
    """Later ones overwrite."""
    if record.part is not None:
        return 2, 0.0
    if record.box is None:
        return 0, 0.0
    left, top, right, bottom = record.box
    return 1, -(right - left) * (bottom - top)


def _covered(record: Record, labels: np.ndarray) -> np.ndarray:
    if record.part is not None:
        return labels == record.part
    if record.box is None:
        return np.ones(labels.shape, bool)
    height, width = labels.shape
    left, top, right, bottom = record.box
    u, v = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    return ((v >= top) & (v <= bottom))[:, None] & ((u >= left) & (u <= right))[None]
