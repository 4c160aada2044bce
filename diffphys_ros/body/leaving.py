"""Where an object leaves the picture and stays, or meets what is still: it is held there, as far as the picture shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Scene
from ..picture import along_border, extent_px, side_of
from ..types import Clip, object_mask
from .still_end import still_end

BAND = 1 / 60  # of the picture's shorter side, beside its edge, in which masks are no surer than that
LEAST_RUN_PX = 8  # along the edge, on which it leaves
STAYS = 0.8  # of the place where it leaves in frame 0, shared with that of another frame
MOST_FRAMES = 0.9  # of those that were received, in which it must
DRAWN_PX = 1.0  # standard deviation of a line that a person draws [chosen]
FOUND = 0.01  # of the object's extent, of the end that was found to stay [docs/measurements/films.md]
BEYOND = 0.1  # of the object's extent, of a clamp that may lie beyond the picture's border [derived: .10 and .15 of two lengths in docs/measurements/films.md]
EDGES = ("upper", "lower", "left", "right")
AT_CLAMP = 0.25  # of how far the object reaches from its clamp: an edge of the picture that it touches there shows nothing of its free end [chosen]


def with_edge(clip: Clip, scene: Scene) -> tuple[Scene, str]:
    """The scene with a clamp where nobody tells one: along the picture's edge where the object leaves the picture, all the time, else across its
    end that meets what is still; and what was seen, one clause. With a depth topic the object stays free: what its rest is measured by may tell otherwise."""
    if scene.tells_clamp:
        return scene, ""
    found = _at_edge(clip) or _at_still(clip)
    if found is None:
        return scene, ""
    seen, line = found
    if clip.depth is not None:
        return scene, f"taken as free, though {seen}; set scene.clamp_px where it is held"
    return replace(scene, clamp_px=line), f"not told: {seen}, where it is taken to be held; set scene.clamp_px where that is wrong"


def line_sd_px(line_px: list[float], mask: np.ndarray, *, drawn: bool) -> float:
    """Standard deviation [px] of how far the held face of an object (H, W) lies off its clamp's line u v u v, which a person drew or which was found."""
    if along_border(line_px, mask.shape):
        return BEYOND * extent_px(mask)
    return DRAWN_PX if drawn else FOUND * extent_px(mask)


def cut_off_at(mask: np.ndarray, line_px: list[float] | None) -> str:
    """The edge of the picture at which an object (H, W) goes on away from its clamp's line u v u v; "" where it ends inside, or has no clamp."""
    if line_px is None:
        return ""
    row, column = np.nonzero(mask)
    far = np.abs(side_of(line_px, np.stack([column, row], -1)))
    away = far > AT_CLAMP * far.max()
    height, width = mask.shape
    sides = row == 0, row == height - 1, column == 0, column == width - 1
    cut = [edge for edge, at in zip(EDGES, sides, strict=True) if (away & at).sum() >= LEAST_RUN_PX]
    return cut[0] if cut else ""


def _at_edge(clip: Clip) -> tuple[str, list[float]] | None:
    found = leaving(clip)
    return None if found is None else (f"the object leaves the picture at its {found[0]} edge, from {found[1][:2]} to {found[1][2:]} px, and stays there", found[1])


def _at_still(clip: Clip) -> tuple[str, list[float]] | None:
    line = still_end(clip)
    return None if line is None else (f"the object meets what is still, from {line[:2]} to {line[2:]} px, and stays there", line)


def leaving(clip: Clip) -> tuple[str, list[float]] | None:
    """The edge at which the object leaves the picture in frame 0 and as good as all others, and the line u v u v [px] on it; None for none or
    several."""
    assert clip.labels is not None
    solid = object_mask(clip.labels[clip.seen])
    height, width = solid.shape[1:]
    band = max(2, round(BAND * min(height, width))) + 1
    sides = (solid[:, :band], 1), (solid[:, -band:], 1), (solid[:, :, :band], 2), (solid[:, :, -band:], 2)
    beside = [np.asarray(side.any(across)) for side, across in sides]
    at = [k for k, runs in enumerate(beside) if runs[0].sum() >= LEAST_RUN_PX]
    if len(at) != 1:
        return None
    runs = beside[at[0]]
    shared = (runs & runs[0]).sum(1) / np.maximum((runs | runs[0]).sum(1), 1)
    if (shared >= STAYS).mean() < MOST_FRAMES:
        return None
    first, last = (float(i) for i in np.flatnonzero(runs[0])[[0, -1]])
    right, low = float(width - 1), float(height - 1)
    line = [[first, 0.0, last, 0.0], [first, low, last, low], [0.0, first, 0.0, last], [right, first, right, last]][at[0]]
    return EDGES[at[0]], line
