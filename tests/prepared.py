"""A made-up prepared clip."""

from __future__ import annotations

import dataclasses

import numpy as np

from diffphys_ros.damping import Damping
from diffphys_ros.footprints import Footprint
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.modes.model import ModalModel
from diffphys_ros.types import Body, Clip, MaterialDoubt, StartValues, Tracks


def make_prepared(made_clip: Clip) -> Prepared:
    """A body of two parts with seven tracks and a model of three modes."""
    rng = np.random.default_rng(0)
    frames, parts, modes, points = len(made_clip), 2, 3, 7
    shapes = {
        "nodes": (20, 3),
        "basis": (20, 3, modes),
        "stiffness": (parts, modes, modes),
        "by_poisson": (parts, modes, modes),
        "inertia": (parts, modes, modes),
        "prestress": (parts, modes, modes),
        "weight": (parts, modes),
        "retuning": (modes, modes),
    }
    drawn = {f.name: rng.normal(size=shapes.get(f.name, (modes,))) for f in dataclasses.fields(ModalModel)}
    model = ModalModel(**drawn | {"tets": np.arange(10)[None], "part": np.ones(1, int), "reference": np.array([1e5, 2e4]), "density": np.array([600.0, 700.0]), "poisson": np.full(2, 0.3)})
    start = StartValues(
        young=np.array([1e5, 2e4]),
        log10_young_sd=np.array([0.02, 0.03]),
        damping=Damping(0.1, 1e-3),
        forced=np.arange(frames) < 5,
        footprint=Footprint(),
        force=rng.normal(size=(frames, 3)),
        initial_displacement=np.zeros(modes),
        initial_velocity=np.zeros(modes),
        frequencies_hz=np.array([2.0, 5.0, 9.0]),
        observed_hz=np.array([2.1]),
        decay_per_s=np.array([0.3]),
        track_cost=0.01,
        identified=np.array([True, False]),
        reasons=("seen", "hardly strains"),
        has_free_tail=True,
        modes_hold=True,
        geometry_sd=np.array([0.01, 0.01]),
        young_lower=np.array([np.nan, 1e4]),
        material=MaterialDoubt.none(2),
        density=np.full(2, 600.0),
        poisson=np.full(2, 0.3),
    )
    tracks = Tracks(rng.normal(size=(frames, points, 2)), rng.normal(size=(frames, points, 3)), np.ones((frames, points), bool), True, 1e-4)
    body = Body(
        np.eye(4),
        np.ones((4, 3), bool),
        np.zeros(2),
        0.01,
        np.full((4, 3), 0.02),
        np.ones((4, 3), np.uint8),
        np.array([500.0, 400.0]),
        np.array([0.3, 0.3]),
        np.zeros(3),
        True,
        {"density": "mass_kg"},
    )
    return Prepared(made_clip, np.ones(made_clip.frames.shape[1:3], np.float32), "depth topic", tracks, body, start, model)
