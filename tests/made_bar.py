"""Bars and their motion, made from the modal model on a mesh of its own, so that nothing is fitted on the mesh it came from."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np

from diffphys_ros.config import Scene, Settings
from diffphys_ros.damping import Damping
from diffphys_ros.elements.assemble import Elements, modal_model
from diffphys_ros.elements.mesh import element_size, solid_mesh
from diffphys_ros.modes.model import ModalModel
from diffphys_ros.start.evidence import Evidence
from diffphys_ros.start.free_tail import Physics
from diffphys_ros.start.stages import Fit
from diffphys_ros.types import Body, Camera, Tracks
from diffphys_ros.vibration.coordinates import observe
from diffphys_ros.vibration.forced_frames import Support

LENGTH, HEIGHT, THICKNESS = 0.3, 0.1, 0.125  # m
YOUNG = np.array([2.0e5, 1.1e5])  # Pa
FRAMES, PERIOD_S = 42, 1 / 30
FORCED = slice(3, 11)
BETA = 1e-3  # s
SMALL = 0.01  # of a swing of a tenth of the bar: linear modes are right about it to the noise, which is as much less
NOISE_M, COHERENT_M = SMALL * 1e-4, SMALL * 3e-5


def bar(
    *,
    length: float = LENGTH,
    height: float = HEIGHT,
    thickness: float = THICKNESS,
    edges: tuple[float, ...] = (LENGTH / 3,),
    density: float = 600.0,
    poisson: float = 0.3,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    clamped: bool = True,
    pitch: float = 1e-3,
) -> Body:
    """A bar along x, of parts that meet at `edges` [m]; world and body frames agree."""
    nx, ny = round(length / pitch), round(height / pitch)
    x = (np.arange(nx) + 0.5) * pitch
    part = np.repeat((1 + np.searchsorted(edges, x)).astype(np.uint8)[:, None], ny, 1)
    parts = len(edges) + 1
    return Body(
        np.eye(4),
        np.ones((nx, ny), bool),
        np.array([pitch / 2, -height / 2 + pitch / 2]),
        pitch,
        np.full((nx, ny), thickness / 2),
        part,
        np.full(parts, density),
        np.full(parts, poisson),
        np.array(gravity),
        clamped,
        {"density": "density_kg_m3", "metric_scale": "depth topic"},
    )


def blade(poisson: float) -> Body:
    """Wide and thin, of two parts; twisting is its third mode."""
    return bar(length=0.4, height=0.12, thickness=0.03, edges=(0.2,), poisson=poisson)


def push_on_its_corner(modal: ModalModel, push: np.ndarray) -> np.ndarray:
    """Modal loads (T, r) of a force density (T, 3) [N/m^3] on the corner of a blade."""
    return push @ modal.footprint_load(lambda points: (points[:, 0] > 0.25) * (points[:, 1] > 0.02)).T


def modes_of(body: Body, young: np.ndarray, *, finer: float = 1.0, count: int = 8) -> ModalModel:
    """Modes at Young's moduli on a mesh of its own size; made once for all tests of a process that ask for the same."""
    asked = pickle.dumps((body, young, finer, count))
    if asked not in _made:
        mesh = solid_mesh(body, finer * element_size(body))
        _made[asked] = modal_model(Elements.of(body, mesh), [young], [count])
    return _made[asked]


_made: dict[bytes, ModalModel] = {}


def gust(direction: tuple[float, float, float] = (0.0, 0.6, 1.0), peak: float = 2500.0) -> np.ndarray:
    """Uniform force density (T, 3): one sine over the forced frames, SMALL times as large as its peak [N/m^3]."""
    count = FORCED.stop - FORCED.start
    force = np.zeros((FRAMES, 3))
    force[FORCED] = SMALL * peak * np.sin(2 * np.pi * (np.arange(count) + 0.5) / count)[:, None] * direction
    return force


def motion(modal: ModalModel, young: np.ndarray, force: np.ndarray, **start: np.ndarray) -> np.ndarray:
    """Basis coordinates (T, r) under a uniform force."""
    load = force @ modal.footprint_load().T
    return modal.respond(young, damping=Damping(0.0, BETA), load=load, period_s=PERIOD_S, **start)


def moved(modal: ModalModel, force: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Basis coordinates (T, r) under a force (T, 3) with modal loads (r, 3)."""
    return modal.respond(YOUNG, damping=Damping(0.0, BETA), load=force @ load.T, period_s=PERIOD_S)


def alike_errors(modal: ModalModel, rng: np.random.Generator, count: int) -> np.ndarray:
    """Errors (T, count) of unit size that frames of a quarter period share."""
    frames = np.arange(FRAMES) * modal.frequencies(YOUNG)[0] * PERIOD_S
    alike = np.exp(-0.5 * ((frames[:, None] - frames) / 0.1) ** 2)
    return np.linalg.cholesky(alike + 1e-9 * np.eye(FRAMES)) @ rng.standard_normal((FRAMES, count))


def true_fit(body: Body, modal: ModalModel, seen: Tracks, *, young: np.ndarray = YOUNG, forced: slice = FORCED) -> Fit:
    """The fit to tracks whose physics and forced frames are right."""
    frames = np.zeros(FRAMES, bool)
    frames[forced] = True
    support = Support(frames, True, modal.frequencies(young), np.zeros(modal.modes), 0.0)
    return Fit(Evidence(body, seen, observe(body, seen), PERIOD_S, settings(at_rest=True)), modal, support, Physics(young, Damping(0.0, BETA), np.zeros(0)))


def camera() -> Camera:
    """Looks along -z at the bar from 0.6 m."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = [LENGTH / 2, 0.0, 0.6]
    return Camera(np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]]), pose, 320, 240, "camera", "world")


def tracks(modal: ModalModel, q: np.ndarray, *, seed: int = 0, count: int = 200, depth: bool = True, points: np.ndarray | None = None) -> Tracks:
    """Noisy points (M, 3), of the front face where none are given; without depth they keep the depth of frame 0."""
    rng = np.random.default_rng(seed)
    size = modal.nodes.max(0)
    if points is None:
        points = np.column_stack([rng.uniform(0.1, 0.98, count) * size[0], rng.uniform(-0.95, 0.95, count) * size[1], np.full(count, size[2])])
    path = points + np.einsum("mcr,tr->tmc", modal.evaluate(points)[0], q - q[:1])
    noise = NOISE_M * rng.standard_normal(path.shape) + COHERENT_M * rng.standard_normal((len(q), 1, 3))
    noise[0] = 0.0
    valid = rng.random(path.shape[:2]) < 0.95
    valid[0] = True
    seen = path + noise
    pixels, distance = camera().project(seen)
    if not depth:
        seen = camera().backproject(pixels, np.repeat(distance[:1], len(q), 0))
    return Tracks(pixels, seen, valid, depth, NOISE_M)


def settings(**scene: object) -> Settings:
    """Defaults, with what is known of the scene; the density of the bars is told unless it is said not to be."""
    return replace(Settings(), scene=replace(Scene(), **({"density_kg_m3": [600.0]} | scene)))  # type: ignore[arg-type]
