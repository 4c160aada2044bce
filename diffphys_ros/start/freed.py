"""The free tail that a joint fit of stiffness and force uncovers where the motion alone does not show it: two modes of nearly equal frequency beat, and what
swells passes for pushed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..config import Settings
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from ..vibration.forced_frames import Support, least_tail_frames, runs
from .second_reading import fit_at
from .values import one_swing_hz, values_under, widened

UNSEEN = "the motion alone does not show where its free part begins"
FREED_SD = 0.03  # of log10 E, at the least, by force that is left in such a tail: seven parts at the clamp were off by .009 at the most [docs/measurements/choices.md]
FAINT = 0.3  # of the largest force: what ends a clip with no more may be what the modes miss of a large swing [chosen]


def freed_values(
    body: Body, tracks: Tracks, period_s: float, settings: Settings, start: StartValues, modal: ModalModel, *, camera: Camera
) -> tuple[StartValues, ModalModel] | None:
    """Start values by the frames after the last force of a joint fit, faint ones at its end left out where need be, to FREED_SD of log10 E at best, and their modes; None where
    that tells no stiffness, where those frames are too few, or where free modes do not explain them. Arguments as for joint_values, whose result `start` is."""
    if start.has_free_tail or not start.identified.any() or tracks.normals is not None:
        return None
    fit = fit_at(body, tracks, period_s, settings, start, modal, camera=camera, first_order=False)
    hz = modal.frequencies(start.young)[[fit.tail.leading_mode(start.young)]]
    support = replace(fit.support, has_free_tail=True, frequencies_hz=hz, decay_per_s=start.damping.decay((2 * np.pi * hz) ** 2))
    needed = least_tail_frames(max(float(hz[0]), one_swing_hz(fit.evidence)), period_s)
    evidence = replace(fit.evidence, belief=None)
    for each in _without_faint(support, np.linalg.norm(start.force, axis=1)):
        if len(each.forced) - each.tail_start < needed:
            continue
        found, modes = values_under(evidence, each)
        if found.modes_hold and found.identified.any():
            return widened(found, FREED_SD, UNSEEN), modes
    return None


def _without_faint(support: Support, size: np.ndarray) -> Iterator[Support]:
    """The same support, and those without its last runs of forced frames one by one, as long as their forces, of amplitudes `size` (T,), are faint."""
    yield support
    for first, last in reversed(runs(support.forced)):
        if size[first : last + 1].max() > FAINT * size.max():
            return
        yield replace(support, forced=support.forced & (np.arange(len(size)) < first))
