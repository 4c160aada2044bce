"""A soft two-part bar with tracks computed from its own modes: a problem whose answer is known."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.damping import Damping
from diffphys_ros.elements.assemble import Elements, modal_model
from diffphys_ros.footprints import Footprint
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.types import Body, Camera, Clip, MaterialDoubt, StartValues, Tracks
from tests.coarse import coarse_elements

YOUNG = np.array([2.0e5, 1.2e5])
PERIOD_S = 1 / 30
FRAMES = 14


@pytest.fixture(autouse=True, scope="module")
def coarse(request: pytest.FixtureRequest) -> Iterator[None]:
    """But for the large swing, whose frequency must be right over many periods."""
    with nullcontext() if request.module.__name__.endswith("test_swing") else coarse_elements():
        yield


def make_body(gravity=(0.0, 0.0, 0.0)) -> Body:
    """0.3 x 0.1 x 0.1 m, clamped at x = 0, part 2 beyond 0.1 m."""
    pitch = 0.004
    nx, ny = 75, 25
    inside = np.ones((nx, ny), bool)
    part = np.ones((nx, ny), np.uint8)
    part[25:] = 2
    return Body(
        world_from_body=np.eye(4),
        inside=inside,
        origin=np.array([pitch / 2, -0.05 + pitch / 2]),
        pitch_m=pitch,
        half_thickness=np.full((nx, ny), 0.05),
        part=part,
        density=np.array([600.0, 600.0]),
        poisson=np.array([0.3, 0.3]),
        gravity=np.array(gravity),
        clamped=True,
        sources={"density": "given"},
    )


def make_camera() -> Camera:
    """Looks along -z from 1 m."""
    k = np.array([[300.0, 0, 79.5], [0, 300.0, 59.5], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = [0.15, 0.0, 1.05]
    return Camera(k, pose, 160, 120, "optical", "world")


def make_start(body: Body, modal, young=YOUNG, force_peak=600.0) -> StartValues:
    """A gust along y in frames 1..4."""
    force = np.zeros((FRAMES, 3))
    force[1:5, 1] = force_peak * np.sin(np.pi * np.arange(1, 5) / 5)
    forced = np.zeros(FRAMES, bool)
    forced[1:5] = True
    r = modal.modes
    f = modal.frequencies(young)
    return StartValues(
        young.copy(), np.full(2, 0.03), Damping(0.2, 1e-3), forced, Footprint(), force, np.zeros(r), np.zeros(r),
        f, f[:1], np.zeros(1), 1e-4, np.ones(2, bool), ("seen", "seen"), True, True, np.full(2, 0.01), np.full(2, np.nan), MaterialDoubt.none(2), body.density, body.poisson,
    )  # fmt: skip


def make_tracks(body: Body, modal, start: StartValues, has_depth=True) -> Tracks:
    """Front-face points that move exactly as the linear model says."""
    x, y = np.meshgrid(np.linspace(0.01, 0.29, 12), np.linspace(-0.04, 0.04, 5), indexing="ij")
    points0 = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.05)], -1)
    q = modal.respond(
        start.young,
        damping=start.damping,
        load=start.force @ modal.footprint_load().T,
        period_s=PERIOD_S,
    )
    points = body.to_world(points0 + np.einsum("mcr,tr->tmc", modal.evaluate(points0)[0], q))
    pixels, _ = make_camera().project(points)
    return Tracks(pixels, points, np.ones(points.shape[:2], bool), has_depth, 1e-4)


def make_prepared(gravity=(0.0, 0.0, 0.0), has_depth=True) -> Prepared:
    """Everything that the solver needs, without images."""
    body = make_body(gravity)
    modal = modal_model(Elements.of(body), [YOUNG, YOUNG * [1, 2], YOUNG * [1, 0.5]], [6, 6, 6])
    start = make_start(body, modal)
    camera = make_camera()
    clip = Clip(np.zeros((FRAMES, 120, 160, 3), np.uint8), 0, PERIOD_S, camera, labels=np.ones((FRAMES, 120, 160), np.uint8), source="synthetic")
    tracks = make_tracks(body, modal, start, has_depth)
    return Prepared(clip, np.zeros((120, 160), np.float32), "none", tracks, body, start, modal)


def as_one_part(prepared: Prepared, log10_young_sd: float) -> Prepared:
    """The same motion, with a body in which nobody saw the boundary and a start at one modulus."""
    body = replace(prepared.body, part=np.ones_like(prepared.body.part), density=np.array([600.0]), poisson=np.array([0.3]))
    mean = np.array([1.7e5])
    modal = modal_model(Elements.of(body), [mean], [8])
    still = np.zeros(modal.modes)
    one = {"young": mean, "log10_young_sd": np.array([log10_young_sd]), "identified": np.ones(1, bool), "reasons": ("seen",), "geometry_sd": np.full(1, 0.01), "young_lower": np.full(1, np.nan), "material": MaterialDoubt.none(1), "density": body.density, "poisson": body.poisson}
    start = replace(prepared.start, initial_displacement=still, initial_velocity=still, frequencies_hz=modal.frequencies(mean), **one)
    return replace(prepared, body=body, modal=modal, start=start)


@pytest.fixture(scope="session")
def prepared() -> Prepared:
    return make_prepared()


@pytest.fixture(scope="session")
def quick_settings():
    """Coarse and short."""
    return build({"scene.at_rest": True, "experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 3})
