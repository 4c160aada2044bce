"""What an inverse problem starts from; on disk it is clip.npz."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import shapes
from ..config import Scene
from ..modes.model import ModalModel
from ..start.zones import Zoned
from ..types import Body, Clip, Doubt, Hanging, MaterialPrior, StartValues, Tracks

LEAST_FRAMES = 8  # fewer cannot show an oscillation


def bounces(body: Body, scene: Scene) -> bool:
    """Whether nothing holds a body above a floor that is told: what it does there depends on when and where it touches."""
    return scene.tells_floor and not body.clamped


@dataclass(frozen=True)
class Prepared:
    """What the solver starts from; goes to disk as clip.npz."""

    clip: Clip  # with labels
    depth0: np.ndarray  # of frame 0 on the object [m], shape (H, W)
    depth_source: str
    tracks: Tracks
    body: Body
    start: StartValues
    modal: ModalModel
    prior: MaterialPrior | None = None  # of the material
    zones: Zoned | None = None  # where the material is wanted as a field
    doubts: tuple[Doubt, ...] = ()  # about the recording
    hanging: Hanging | None = None  # where the outline was followed instead of points

    def check(self) -> None:
        """Holds arrays of unknown origin to the shapes and bounds that the solver counts on. Raises shapes.MisshapenError."""
        sizes = shapes.check_clip(self.clip)
        shapes.require(self.clip.labels is not None and len(self.clip) >= LEAST_FRAMES, f"clip is without labels or has fewer than {LEAST_FRAMES} frames")
        shapes.check({"depth0": self.depth0}, {"depth0": "real H W"}, sizes)
        shapes.check_tracks(self.tracks, sizes["T"])
        parts = shapes.check_body(self.body)
        shapes.check_start(self.start, sizes["T"], parts)
        shapes.check_modal(self.modal, parts)
        if self.prior is not None:
            shapes.check_prior(self.prior, sizes)
        if self.zones is not None:
            zones = shapes.check_body(self.zones.body)
            shapes.check_start(self.zones.start, sizes["T"], zones)
            shapes.check_modal(self.zones.modal, zones)
            shapes.check(vars(self.zones), shapes.ZONED, {"n": zones})
            shapes.require(self.zones.part.min() >= 1 and self.zones.part.max() <= parts, "zones lie in parts that there are none of")
