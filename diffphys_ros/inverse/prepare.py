"""From a clip to start values: everything that needs no simulation."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..config import Scene, Settings
from ..errors import InputError, shown
from ..progress import Progress, waiting
from ..types import Body, Clip, Scale, StartValues, Swing, Tracks, object_mask
from ..vibration.rest import Rest, rest_of
from .floor import floor_of
from .law import law_to_fit
from .material_prior import believed, describe_prior, of_parts, parted
from .outlined import outlined, with_hanging
from .placement import at_rest, shown_at_rest
from .prepared import LEAST_FRAMES, Prepared, bounces
from .stages import require_schedule
from .swing import swing_of

if TYPE_CHECKING:
    from ..depth import DepthSource
    from ..tracks import OnTripod


UNSEEN = "the object is plain: its outline was followed, which does not show what moves along the line of sight, nor a force that acts along it"
TURNS = "the surface could not be followed, for the object turns too far between two frames: its points go with the middle of its mask and do not turn"
IN_MOTION = "the object is not at rest in frame 0: the body was built in the pose of frame {}, of which {:.1f} mm (rms) were taken off that are left to rest"


def label(clip: Clip, settings: Settings) -> Clip:
    """The clip with label images; those it already carries are kept."""
    if clip.labels is not None:
        return clip
    from ..segment import described, label_clip

    labels = label_clip(clip, settings)
    return replace(clip.with_labels(labels), notes=(*clip.notes, *filter(None, [described(clip, settings, labels)])))


def check_clip(clip: Clip) -> None:
    """Refuses clips that cannot be worked on."""
    if len(clip) < LEAST_FRAMES:
        raise InputError(f"{clip.source or 'clip'}: has {len(clip)} frame(s), needs at least {LEAST_FRAMES}; record a longer clip, or leave more to the fit (frames.fit, frames.predict)")
    if clip.labels is not None:
        object_px = int(object_mask(clip.labels[0]).sum())
        if object_px < 50:
            raise InputError(
                f"{clip.source or 'clip'}: the object mask of frame 0 holds {object_px} pixels, needs at least 50; "
                "give a mask with scene.first_mask or choose another segment.method"
            )


def _require_reference(settings: Settings) -> None:
    """Raises InputError for a frame of rest that nothing here builds the body at."""
    if settings.scene.rest_frame:
        raise InputError(
            f"scene.rest_frame is {settings.scene.rest_frame}, but points are followed from frame 0, where the body is built; cut the recording so that it begins there, or leave it out"
        )


def _evenly_exposed(clip: Clip) -> Clip:
    """The clip without drift of the exposure, which a picture that moves hides while a clip is read."""
    from ..bags.exposure import with_steady_exposure

    frames, drift = with_steady_exposure(clip.frames)
    return replace(clip, frames=frames, notes=(*clip.notes, f"the exposure drifted by up to {drift:.1%} of that of frame 0; the drift was taken off")) if drift else clip


def prepare(clip: Clip, settings: Settings, *, guess_scale: float = 1.0) -> Generator[Progress, None, Prepared]:
    """Labels, depth, tracks, body, start values, for which the search begins `guess_scale` times off. Yields news, returns Prepared."""
    from ..depth import placed
    from ..prior import believing
    from ..start import freed_values, joint_values, joint_wanted, landed_values, parted_by_stiffness, start_values
    from .doubts import doubts_of
    from .zones import zones_of

    check_clip(clip)
    law_to_fit(settings)
    require_schedule(settings)
    clip = placed(clip, settings)
    seen = yield from outlined(clip, settings)
    if seen is None:
        _require_reference(settings)
        held, depth0, source, body = yield from _by_points(clip, settings)
        clip, tracks, moved = held.clip, held.tracks, held.moved
    else:
        clip, depth0, source, tracks, body, settings, moved = seen.clip, seen.depth0, seen.source, seen.tracks, seen.body, seen.settings, seen.moved
    belief, hanging = None, None
    if settings.prior.source == "model":
        yield Progress("body", text=f"asking the model {shown(settings.prior.model)} about the material")
    prior = yield from waiting("body", believing(clip, settings))
    if prior is not None:
        body = parted(body, prior, clip.camera)
        body, belief = believed(body, prior, clip.camera, settings.scene), of_parts(prior, body, clip.camera)
        yield Progress("body", text=describe_prior(prior))
    yield Progress("modes", text=f"{body.parts} part(s), {1e6 * body.volume_m3:.1f} cm^3, density from {body.sources.get('density', '?')}; eigenmodes")
    floor = floor_of(body, settings.scene, clip.camera) if bounces(body, settings.scene) else None
    if floor is not None:
        start, modal = landed_values(body, tracks, clip.period_s, settings, floor, camera=clip.camera)
    else:
        start, modal = start_values(body, tracks, clip.period_s, settings, camera=clip.camera, belief=belief, guess_scale=guess_scale)
    freed = None
    if floor is None and joint_wanted(start, settings):
        yield Progress("modes", text="no free tail to read the stiffness from: force and stiffness together")
        start = joint_values(body, tracks, clip.period_s, settings, start, modal, camera=clip.camera, believed=belief is not None)
        freed = freed_values(body, tracks, clip.period_s, settings, start, modal, camera=clip.camera) if settings.experiment.schedule == "auto" else None
        if freed is not None:
            start, modal = freed
            yield Progress("modes", text="what follows the last force swings freely: the stiffness is read from that")
    if prior is None and _may_hide_a_border(body, tracks, start, settings):
        parted_by = parted_by_stiffness(body, tracks, clip.period_s, settings, start, modal, camera=clip.camera, draws=freed is None)
        if parted_by is not None:
            body, start, modal = parted_by.body, parted_by.start, parted_by.modal
            yield Progress("modes", text=f"{body.parts} part(s), {body.sources['parts']}")
    if seen is not None:
        start = with_hanging(start, seen.hanging)
        hanging = replace(seen.hanging, swing=swing_of(seen.whole, seen, start))
        yield Progress("modes", text=describe_swing(hanging.swing))
    body = _as_told_by_motion(body, start, settings.scene)
    doubts = doubts_of(clip, tracks, body, start, settings, moved)
    prepared = Prepared(clip, depth0, source.words, tracks, body, start, modal, prior, doubts=doubts, hanging=hanging)
    yield Progress("modes", text=describe_start(start, body.scale))
    for doubt in doubts:
        yield Progress("modes", text=doubt.text)
    return replace(prepared, zones=(yield from zones_of(prepared, settings)))


def _as_told_by_motion(body: Body, start: StartValues, scene: Scene) -> Body:
    """With the densities and Poisson's ratios that nobody told and the free motion did."""
    if not start.has_free_tail:
        return body
    if body.parts > 1 and scene.density_kg_m3 is None:
        body = replace(body, density=start.density, sources=body.sources | {"density": f"{body.sources['density']}; what each part has of it, from the free motion"})
    if scene.poisson_ratio is None and not np.array_equal(body.poisson, start.poisson):
        assumed = body.sources.get("poisson_ratio", f"assumed: {body.poisson[0]:g}")
        body = replace(body, poisson=start.poisson, sources=body.sources | {"poisson_ratio": f"{assumed}; what the free motion makes of it"})
    return body


def _may_hide_a_border(body: Body, tracks: Tracks, start: StartValues, settings: Settings) -> bool:
    """Whether parts that look alike are to be told apart by stiffness: points tell of modes that an outline does not, and a field has its zones."""
    wanted = settings.fit.material_field == "part" and not settings.experiment.published and settings.experiment.schedule != "joint"
    return wanted and body.parts == 1 and settings.segment.max_parts > 1 and body.clamped and tracks.normals is None and start.has_free_tail


def _by_points(clip: Clip, settings: Settings) -> Generator[Progress, None, tuple[OnTripod, np.ndarray, DepthSource, Body]]:
    """The labelled clip and the points followed on the object, its depth in frame 0 [m] (H, W) and where that comes from, and its body."""
    from ..body import build_body
    from ..depth import surface_depth
    from ..outline import follow_outline
    from ..tracks import LostError, OnTripod, carried, follow, on_tripod

    yield Progress("segment", text="object mask and parts")
    clip = label(clip, settings)
    check_clip(clip)
    yield Progress("depth", text="depth of the visible surface")
    depth0, source = surface_depth(clip, settings)
    if settings.depth.source not in ("auto", "topic"):
        clip = replace(clip, depth=None)  # tracks and body lie on the surface that was asked for
    by_outline = _plain(clip, settings)
    yield Progress("tracks", text="too little texture for points: following the outline" if by_outline else "following surface points")
    followed = partial(follow_outline, depth0=depth0) if by_outline else partial(follow, depth0=depth0, settings=settings)
    try:
        held = on_tripod(clip, followed(clip), followed)
    except LostError:
        if by_outline or clip.depth is None or not settings.scene.thrown:
            raise
        clip = replace(clip, notes=(*clip.notes, TURNS))
        held = OnTripod(clip, carried(clip, depth0, spacing_px=settings.experiment.track_spacing_px), None)
        yield Progress("tracks", text=TURNS)
    if held.clip is not clip:
        held = replace(held, clip=_evenly_exposed(held.clip))
        yield Progress("tracks", text=held.clip.notes[-1])
    if by_outline:
        held = replace(held, clip=replace(held.clip, notes=(*held.clip.notes, UNSEEN)))
    rest = None if by_outline or held.clip.depth is None else _rest_of(held.tracks, clip.period_s, settings.scene)
    yield Progress("body", text=f"{held.tracks.pixels.shape[1]} tracks, noise {1e3 * held.tracks.noise_m:.2f} mm; filling the interior")
    if rest is None:
        body = build_body(held.clip, depth0, settings)
    else:
        held, body = _built_at_rest(held, rest, settings)
    return held, depth0, source, replace(body, sources=body.sources | {"metric_scale": source.scale})


def _rest_of(tracks: Tracks, period_s: float, scene: Scene) -> Rest | None:
    """Where an object that is held rests, if that is not told to be, and is not, the shape of frame 0; what nothing holds does not swing about any."""
    return rest_of(tracks, period_s) if scene.tells_clamp and not scene.at_rest else None


def _built_at_rest(held: OnTripod, rest: Rest, settings: Settings) -> tuple[OnTripod, Body]:
    """With tracks that count from rest, and the body in that pose."""
    from ..body import build_body
    from ..depth import surface_depth

    left_mm = 1e3 * float(np.sqrt((rest.offset**2).sum(1).mean()))
    noted = replace(held.clip, notes=(*held.clip.notes, IN_MOTION.format(rest.frame, left_mm)))
    tracks, shown = at_rest(held.tracks, rest), noted.part(rest.frame, len(noted))
    shown, surface = shown_at_rest(shown, surface_depth(shown, settings)[0], tracks, rest)
    return replace(held, clip=noted, tracks=tracks), build_body(shown, surface, settings)


def _plain(clip: Clip, settings: Settings) -> bool:
    """Whether the object's outline is followed from frame 0 on, where it rests: of what is thrown, points are, for its outline is another one when it has turned."""
    from ..outline import plain_at_first

    wanted = settings.tracks.evidence
    return wanted == "outline" or (wanted == "auto" and not settings.scene.thrown and plain_at_first(clip, settings))


def describe_start(start: StartValues, scale: Scale) -> str:
    """The start values in a line or two for people; in a scale."""
    young, name, unit = scale.stiffness(start.young, start.density)
    parts = ", ".join(f"{e:.4g} {unit}".rstrip() + f" (x/ {10**s:.2f})" for e, s in zip(young, start.log10_young_sd, strict=True))
    forced = np.flatnonzero(start.forced)
    span = f"frames {forced[0]}..{forced[-1]}" if len(forced) else "no frame"
    tones = ", ".join(f"{f:.2f}" for f in start.observed_hz)
    return f"start values: {name} = {parts}; seen {tones} Hz; force in {span} ({start.footprint.family}); misfit {100 * np.sqrt(start.track_cost):.1f} %"


def describe_swing(swing: Swing | None) -> str:
    """The prediction of the large swing in a line for people."""
    if swing is None:
        return "the swing before the calm frames could not be followed"
    gives = f"; its modulus falls by {swing.softens:.2f} of its strain, without that and the air's drag {100 * swing.constant_error_share:.1f} %" if swing.softens or swing.drag_per_m else ""
    missed = f"misses the picture by {swing.tip_error_px:.1f} px: {100 * swing.tip_error_share:.1f} %"
    return f"let go as in frame {swing.first}, the free end swings by {swing.tip_motion_px:.1f} px (rms) and {missed}{gives}"
