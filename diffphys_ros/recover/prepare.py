"""From a clip to start values: everything that needs no simulation."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from .. import shapes
from ..config import Settings
from ..errors import InputError, shown
from ..losses import foreground
from ..modes.model import ModalModel
from ..modes.zones import Zoned
from ..types import Body, Clip, Doubt, MaterialPrior, StartValues, Tracks
from .belief import believed, of_parts, parted
from .law import law_to_fit
from .progress import Progress, waiting

LEAST_FRAMES = 8  # fewer cannot show an oscillation


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


def label(clip: Clip, settings: Settings) -> Clip:
    """The clip with label images; those it already carries are kept."""
    if clip.labels is not None:
        return clip
    from ..segment import label_clip

    return clip.with_labels(label_clip(clip, settings))


def check_clip(clip: Clip) -> None:
    """Refuses clips that cannot be worked on."""
    if len(clip) < LEAST_FRAMES:
        raise InputError(f"{clip.source or 'clip'}: has {len(clip)} frame(s), needs at least {LEAST_FRAMES}; record a longer clip")
    if clip.labels is not None:
        object_px = int(foreground(clip.labels[0]).sum())
        if object_px < 50:
            raise InputError(
                f"{clip.source or 'clip'}: the object mask of frame 0 holds {object_px} pixels, needs at least 50; "
                "give a mask with scene.first_mask or choose another segment.method"
            )


def prepare(clip: Clip, settings: Settings) -> Generator[Progress, None, Prepared]:
    """Labels, depth, tracks, body, start values. Yields news, returns Prepared."""
    from ..depth import placed, surface_depth
    from ..modes import start_values
    from ..modes.joint import joint_values
    from ..particles import build_body
    from ..prior import believing
    from ..tracks import follow
    from .doubts import doubts_of
    from .zones import zones_of

    check_clip(clip)
    law_to_fit(settings)
    clip, settings = placed(clip, settings)
    yield Progress("segment", text="object mask and parts")
    clip = label(clip, settings)
    check_clip(clip)
    yield Progress("depth", text="depth of the visible surface")
    depth0, source = surface_depth(clip, settings)
    if settings.depth.source not in ("auto", "topic"):
        clip = replace(clip, depth=None)  # tracks and body lie on the surface that was asked for
    yield Progress("tracks", text="following surface points")
    tracks = follow(clip, depth0, settings)
    yield Progress("body", text=f"{tracks.pixels.shape[1]} tracks, noise {1e3 * tracks.noise_m:.2f} mm; filling the interior")
    body, belief = build_body(clip, depth0, settings), None
    body = replace(body, sources=body.sources | {"metric_scale": source.scale})
    if settings.prior.source == "model":
        yield Progress("body", text=f"asking the model {shown(settings.prior.model)} about the material")
    prior = yield from waiting("body", believing(clip, settings))
    if prior is not None:
        body = parted(body, prior, clip.camera)
        body, belief = believed(body, prior, clip.camera, settings.scene), of_parts(prior, body, clip.camera)
        yield Progress("body", text=describe_prior(prior))
    yield Progress("modes", text=f"{body.parts} part(s), {1e6 * body.volume_m3:.1f} cm^3, density from {body.sources.get('density', '?')}; eigenmodes")
    start, modal = start_values(body, tracks, clip.period_s, settings, camera=clip.camera, belief=belief)
    if settings.fit.schedule == "joint" or (settings.fit.schedule == "auto" and not start.has_free_tail):
        yield Progress("modes", text="no free tail to read the stiffness from: force and stiffness together")
        start = joint_values(body, tracks, clip.period_s, start, modal, camera=clip.camera, believed=belief is not None)
    doubts = doubts_of(clip, tracks, body, start, settings)
    prepared = Prepared(clip, depth0, source.words, tracks, body, start, modal, prior, doubts=doubts)
    yield Progress("modes", text=describe_start(start), artefact=start)
    for doubt in doubts:
        yield Progress("modes", text=doubt.text)
    return replace(prepared, zones=(yield from zones_of(prepared, settings)))


def describe_prior(prior: MaterialPrior) -> str:
    """The material prior in a line for people."""
    values = zip(prior.name, prior.young, prior.poisson, prior.density, strict=True)
    return f"material by {prior.source}: " + "; ".join(f"{name}, E {e:.3g} Pa, nu {nu:.2f}, {rho:.4g} kg/m^3" for name, e, nu, rho in values)


def describe_start(start: StartValues) -> str:
    """The start values in a line or two for people."""
    parts = ", ".join(f"{e:.4g} Pa (x/ {10**s:.2f})" for e, s in zip(start.young, start.log10_young_sd, strict=True))
    forced = np.flatnonzero(start.forced)
    span = f"frames {forced[0]}..{forced[-1]}" if len(forced) else "no frame"
    tones = ", ".join(f"{f:.2f}" for f in start.observed_hz)
    return f"start values: E = {parts}; seen {tones} Hz; force in {span} ({start.force_family}); misfit {100 * np.sqrt(start.track_cost):.1f} %"


def scaled_start(start: StartValues, factor: float) -> StartValues:
    """Start values with Young's modulus multiplied by a factor; all else as it was."""
    return start if factor == 1.0 else replace(start, young=start.young * factor)
