"""Where on the body the force acts, read once more: from tracks of which a simulation has taken what linear modes miss.

A push at the tip and a wind along the whole body differ by a few per cent of the motion, and large swings, sag and shortening hide that. A
simulation with nearly right physics knows them. What it moves beyond its own linear motion, taken off the tracks, leaves a motion that
modes explain to the noise (deferred correction, Fox 1947; Stetter 1978), and with it the place of the force.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Settings
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from ..vibration.coordinates import observe
from ..vibration.forced_frames import Support
from .evidence import Evidence
from .free_tail import Physics
from .stages import Fit, footprint_again, physics_again, run
from .values import of_motion

GAUSSIAN_GAIN = 0.5  # another place must lower the cost below this share of that of the place before: a push at a tip that was taken for a wind has .22 of it (tests/inverse/test_second_reading.py), a wind that would be taken for a push .68 (seed 559284) [chosen]


def read_again(
    body: Body, tracks: Tracks, period_s: float, settings: Settings, start: StartValues, modal: ModalModel, *, camera: Camera, refined: bool
) -> StartValues | None:
    """`start` with the footprint, and the force under it, that explain tracks of first order clearly better than its own; None where none does.

    Args:
        body: filled solid.
        tracks: surface points, less what the linear modes miss of their motion.
        period_s: time between frames [s].
        settings: `scene.at_rest` and `experiment.mode_count`.
        start: physics, forced frames and footprint of the simulation that the correction is from; what is believed of E.
        modal: the modes of the linear motion that the correction is from.
        camera: for the lines of sight, where the tracks have no depth.
        refined: whether stiffness and damping follow the new footprint.
    """
    begun = fit_at(body, tracks, period_s, settings, start, modal, camera=camera, first_order=True)
    found = run(footprint_again(), begun)
    if not _cost(found) < GAUSSIAN_GAIN * _cost(begun):
        return None
    if refined:
        found = run(physics_again(), found)
    return replace(start, **of_motion(found))


def fit_at(
    body: Body, tracks: Tracks, period_s: float, settings: Settings, start: StartValues, modal: ModalModel, *, camera: Camera, first_order: bool
) -> Fit:
    """The fit that would end with `start`, on tracks that hold what is of first order alone, or all; other arguments as for read_again."""
    evidence = Evidence(body, tracks, observe(body, tracks, camera), period_s, settings, belief=start, first_order=first_order)
    return Fit(evidence, modal, support_of(start), Physics(start.young, start.damping, np.zeros(0)), start.footprint)


def support_of(start: StartValues) -> Support:
    """The forced frames of start values."""
    return Support(_inner(start.forced), start.has_free_tail, start.observed_hz, start.decay_per_s, 0.0)


def _inner(forced: np.ndarray) -> np.ndarray:
    """Forced frames (T,) without the one at either side that Support.allowed adds; all of one or two that have no more beside them."""
    held = np.r_[True, forced, True]
    inner = forced & held[:-2] & held[2:]
    added = np.r_[False, inner[:-1]] | np.r_[inner[1:], False]
    return inner | (forced & ~added)


def _cost(fit: Fit) -> float:
    return fit.whole.solve(fit.physics, fit.load).cost
