"""A result folder is enough to have its motion again."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
import torch

from diffphys_ros import result
from diffphys_ros.config import Settings, build
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.answer import assemble, linear_answer, simulated_answer
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.posterior import of_start
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.problem import Problem, pose_problem
from diffphys_ros.resimulate import simulate_again
from diffphys_ros.types import MpmProblem, Recovery
from tests.inverse.conftest import make_prepared

COARSE = {"scene.at_rest": True, "experiment.cells": 3, "experiment.per_cell": 1.5}
FLOOR_M = 0.25  # under the lowest face of the bar as it is placed
FIELDS = {"fit.material_field": "residual", "fit.force_field": "voxels", "experiment.force_frame": "current"}
STILL, HEAVY = (0.0, 0.0, 0.0), (0.0, -2.0, -9.81)  # gravity in the body frame
CASES: dict[str, tuple[tuple[float, ...], dict[str, object]]] = {  # gravity, settings
    "at rest": (STILL, {}),
    "with ghosts that reach free nodes": (STILL, {"experiment.per_cell": 2.0}),
    "under gravity": (HEAVY, {}),
    "moving": (HEAVY, {"scene.at_rest": False}),
    "on a floor": ((0.0, 0.0, -9.81), {"scene.floor_z_m": FLOOR_M}),
    "with fields": (HEAVY, FIELDS),
    "by modes": (HEAVY, {"scene.at_rest": False}),
}


def placed(prepared: Prepared) -> Prepared:
    """The same bar and camera, turned about the vertical and moved: the body frame is not the world."""
    pose, turn = np.eye(4), 0.7
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, 3] = (0.1, -0.2, FLOOR_M + 0.05)
    camera, body = prepared.clip.camera, dataclasses.replace(prepared.body, world_from_body=pose)
    clip = dataclasses.replace(prepared.clip, camera=dataclasses.replace(camera, world_from_camera=pose @ camera.world_from_camera))
    return dataclasses.replace(prepared, clip=clip, body=body, tracks=dataclasses.replace(prepared.tracks, points=body.to_world(prepared.tracks.points)))


def prepared_for(name: str) -> Prepared:
    """A bar in a gust, that already moves in frame 0 unless it is at rest then."""
    gravity, settings = CASES[name]
    prepared = placed(make_prepared(gravity))
    start, modal = prepared.start, prepared.modal
    if not settings.get("scene.at_rest", True):
        motion = {key: scale * np.arange(1.0, modal.modes + 1) ** -2 for key, scale in (("displacement", 2e-3), ("velocity", 0.05))}
        start = dataclasses.replace(start, **{f"initial_{key}": value for key, value in motion.items()})
    if name in ("by modes", "at rest"):
        modal = modal.retuned(start.young, np.array([0.05]))
    return dataclasses.replace(prepared, start=start, modal=modal)


def recovered(prepared: Prepared, name: str) -> Recovery:
    """The result of a search that ended where it began; whichever engine's answer the case is about."""
    problem = pose_problem(prepared, None, build(COARSE | CASES[name][1]))
    with torch.no_grad():
        terms = roughened(problem)() if name == "with fields" else Model(problem)()
    core = linear_answer(prepared, problem.disc) if name == "by modes" else simulated_answer(problem.forward, terms)
    substeps = problem.forward.simulator.substeps
    return assemble(prepared, problem.disc, core, None, confidence=of_start(prepared), substeps=substeps, metrics={})


def roughened(problem: Problem) -> Model:
    """Fields that differ from place to place."""
    model, noise = Model(problem), torch.Generator().manual_seed(0)
    model.begin_fields()
    with torch.no_grad():
        for parameter in (*model.material.parameters(), *model.force.parameters()):
            parameter += 0.2 * torch.randn(parameter.shape, generator=noise)
    return model


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Cases by name -> the folder of each result, that holds its recovery.npz alone."""

    @cache
    def folder(name: str):
        prepared, made = prepared_for(name), tmp_path_factory.mktemp("result")
        result.save(recovered(prepared, name), prepared.clip, Settings(), made)
        (made / result.METRICS).unlink()
        return made

    return folder


def away(recovery: Recovery, trajectory: np.ndarray) -> float:
    """Largest distance from the stored trajectory over the largest motion in it."""
    moved = np.linalg.norm(recovery.trajectory - recovery.trajectory[0], axis=-1).max()
    return float(np.linalg.norm(trajectory.astype(float) - recovery.trajectory, axis=-1).max() / moved)


@pytest.mark.parametrize("name", CASES)
def test_the_file_alone_gives_its_trajectory_to_the_bit(folders, name: str) -> None:
    recovery = result.load(folders(name))
    assert recovery.simulation.engine == ("modes" if name == "by modes" else "mpm")
    again = simulate_again(folders(name))
    assert again.dtype == np.float32
    np.testing.assert_array_equal(again, recovery.trajectory)


def changed(recovery: Recovery, **parts: np.ndarray) -> Recovery:
    return dataclasses.replace(recovery, simulation=dataclasses.replace(recovery.simulation, **parts))


def without_ghosts(recovery: Recovery) -> Recovery:
    problem = recovery.simulation
    assert isinstance(problem, MpmProblem)
    count = len(problem.ghost)
    return changed(recovery, **{n: v[~problem.ghost] for n, v in vars(problem).items() if isinstance(v, np.ndarray) and v.shape[:1] == (count,)})


def zeroed(name: str):
    """A recovery without one of its arrays or of its problem's."""
    return lambda r: changed(r, **{name: 0 * getattr(r.simulation, name)}) if hasattr(r.simulation, name) else dataclasses.replace(r, **{name: 0 * getattr(r, name)})


LEFT_OUT = {
    "ghosts": ("with ghosts that reach free nodes", without_ghosts),
    "prestress": ("under gravity", lambda r: changed(r, deformation_gradient=0 * r.simulation.deformation_gradient + np.eye(3, dtype=np.float32))),
    "gravity": ("under gravity", zeroed("gravity")),
    "place of frame 0": ("under gravity", lambda r: changed(r, position=r.simulation.rest.astype(np.float32))),
    "velocity": ("moving", zeroed("velocity")),
    "velocity gradient": ("moving", zeroed("velocity_gradient")),
    "frequencies of the damping": ("at rest", zeroed("damping_frequencies")),
    "gradients of the damping's modes": ("at rest", zeroed("damping_gradients")),
    "frequencies as seen": ("at rest", zeroed("retuning")),
    "mass damping": ("at rest", lambda r: dataclasses.replace(r, damping=dataclasses.replace(r.damping, mass_per_s=0.0))),
    "pose": ("at rest", lambda r: dataclasses.replace(r, world_from_body=np.eye(4))),
    "substeps": ("at rest", lambda r: dataclasses.replace(r, substeps=r.substeps + 1)),
    "force": ("at rest", zeroed("force_weight")),
    "force field": ("with fields", zeroed("field_force")),
    "field of Poisson's ratio": ("with fields", lambda r: changed(r, poisson=np.full_like(r.simulation.poisson, 0.3))),
    "floor": ("on a floor", lambda r: changed(r, **{n: v[:0] for n, v in vars(r.simulation).items() if n.startswith("plane_")})),
    "friction": ("on a floor", zeroed("plane_friction")),
    "prestress of modes": ("by modes", zeroed("geometric")),
    "frequencies of modes as seen": ("by modes", zeroed("retuning")),
    "initial displacement of modes": ("by modes", zeroed("initial_displacement")),
    "initial rates of modes": ("by modes", zeroed("initial_velocity")),
}


@pytest.mark.parametrize("left_out", LEFT_OUT)
def test_nothing_of_the_file_can_be_left_out(folders, left_out: str) -> None:
    name, change = LEFT_OUT[left_out]
    recovery = result.load(folders(name))
    assert away(recovery, simulate_again(change(recovery))) > 1e-5


@pytest.mark.parametrize("name", ["at rest", "by modes"])
def test_a_softer_body_moves_further_and_a_stiffer_one_less(folders, name: str) -> None:
    recovery = result.load(folders(name))
    still = recovery if name == "at rest" else changed(recovery, **{f"initial_{key}": np.zeros_like(recovery.simulation.initial_velocity) for key in ("displacement", "velocity")})
    soft, same, stiff = (reach(simulate_again(still, young_scale=scale)) for scale in (0.8, 1.0, 5.0))
    assert soft > 1.1 * same > 2.2 * stiff > 0


def reach(trajectory: np.ndarray) -> float:
    """Largest distance from frame 0 [m]."""
    return float(np.linalg.norm(trajectory - trajectory[0], axis=-1).max())


def test_without_force_a_body_at_rest_stays_and_half_the_force_moves_it_half_as_far(folders) -> None:
    recovery = result.load(folders("at rest"))
    still, half = (simulate_again(recovery, force_scale=scale) for scale in (0.0, 0.5))
    assert reach(still) == 0
    np.testing.assert_allclose(half - half[0], 0.5 * (recovery.trajectory - recovery.trajectory[0]), atol=0.03 * reach(recovery.trajectory))


@pytest.mark.parametrize("name", ["at rest", "with fields", "by modes"])
def test_free_frames_follow_the_recovered_ones_and_no_force_acts_in_them(folders, name: str) -> None:
    recovery = result.load(folders(name))
    count, last = len(recovery.trajectory), recovery.simulation.force.copy()
    last[-1] = 1e3 * np.abs(last).max()  # acts from the last recovered frame on
    free, pushed = (simulate_again(r, free_frames=4) for r in (recovery, changed(recovery, force=last)))
    assert len(free) == count + 4
    np.testing.assert_allclose(free[:count], recovery.trajectory, atol=1e-6)
    np.testing.assert_array_equal(pushed, free)
    steps = np.linalg.norm(np.diff(free, axis=0), axis=-1).max(1)
    assert (steps[count - 1 :] > 0).all()
    assert steps[count - 1 :].max() < 2 * steps.max(initial=0, where=np.arange(len(steps)) < count - 1)


def test_a_push_that_leaves_the_fits_grid_is_given_room(folders) -> None:
    recovery = result.load(folders("at rest"))
    pushed = simulate_again(recovery, force_scale=20.0)
    inner = recovery.world_from_body[:3, :3].T @ (pushed - recovery.world_from_body[:3, 3]).reshape(-1, 3).T
    above = recovery.grid.origin + recovery.grid.dx * (np.array(recovery.grid.size) - 1.5)
    assert (inner.max(1) > above).any()
    assert reach(pushed) > 10 * reach(recovery.trajectory)


def test_progress_is_heard(folders) -> None:
    heard: list[float] = []
    frames = len(simulate_again(folders("at rest"), report=heard.append))
    assert len(heard) == frames - 1
    assert heard[-1] == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"young_scale": 0.0}, "young_scale is 0, must be > 0; 1 simulates"),
        ({"young_scale": float("nan")}, "young_scale is nan, must be > 0"),
        ({"force_scale": float("inf")}, "force_scale is inf, must be finite"),
        ({"free_frames": -1}, "free_frames is -1, must be at least 0; 0 ends with"),
        ({"device": "cuda:7"}, "device is 'cuda:7', must be one of cpu, cuda:0"),
    ],
)
def test_options_out_of_bounds_are_refused_in_a_sentence(folders, options, said: str) -> None:
    with pytest.raises(InputError, match=said):
        simulate_again(folders("at rest"), **options)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there_is_refused_in_a_sentence(folders) -> None:
    with pytest.raises(InputError, match="device is 'cuda:0': there is no CUDA device; choose cpu"):
        simulate_again(folders("at rest"), device="cuda:0")
