"""Claims about a fit as it goes from stage to stage."""

from __future__ import annotations

import weakref
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from diffphys_ros.config import build
from diffphys_ros.inverse import fit as module
from diffphys_ros.inverse.checkpoint import Checkpoint
from diffphys_ros.inverse.clock import Clock
from diffphys_ros.inverse.fit import fit
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.prepare import describe_start
from diffphys_ros.inverse.problem import pose_problem
from diffphys_ros.inverse.stages import schedule
from diffphys_ros.types import Scale

from .test_solve import drive

FEW = {"scene.at_rest": True, "experiment.cells": 2, "experiment.per_cell": 1.0, "fit.iterations": 1}


def test_a_fit_that_is_over_holds_no_tapes(prepared) -> None:
    """They are the largest part of what it held, and of no use to what follows."""
    model = Model(pose_problem(prepared, None, build(FEW)))
    replay = model.problem.forward.simulator.replay
    fitted = drive(fit(model, schedule(model.problem), checkpoint=Checkpoint(None), clock=Clock()))[1]
    assert fitted.simulated
    assert model.problem.forward.simulator.replay is replay
    assert replay.plan.kept
    assert (replay.lent, replay.free) == (0, [])


def test_other_moduli_are_tried_without_the_history_of_the_start(prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    model = Model(pose_problem(prepared, None, build(FEW)))
    monkeypatch.setattr(module, "POOR", 0.0)  # whatever the start explains
    motions, held, simulate = list[weakref.ref](), list[bool](), model.engine.simulate

    def simulated(*arguments, **options):
        motion = simulate(*arguments, **options)
        motions.append(weakref.ref(motion.x))
        return motion

    def scanned(problem, z: np.ndarray, *, room: float) -> np.ndarray:
        held.extend(ref() is not None for ref in motions)
        return z

    monkeypatch.setattr(model.engine, "simulate", simulated)
    monkeypatch.setattr(module, "best_scale", scanned)
    drive(fit(model, schedule(model.problem)[:1], checkpoint=Checkpoint(None), clock=Clock()))
    assert held
    assert not any(held)


@pytest.mark.parametrize(("density", "length", "unit"), [(True, True, "Pa"), (False, True, "m^2/s^2"), (True, False, "")])
def test_the_lines_of_a_run_are_in_units_that_are_known(density: bool, length: bool, unit: str) -> None:
    scale, young, stage = Scale(density, length), np.array([2e5, 1e5]), SimpleNamespace(fields=False)
    start = SimpleNamespace(young=young, density=np.full(2, 1000.0), log10_young_sd=np.zeros(2), forced=np.zeros(3, bool), observed_hz=[2.0], footprint=SimpleNamespace(family="uniform"), track_cost=0.01)
    problem = SimpleNamespace(
        layout=SimpleNamespace(young_of=lambda z: young), disc=SimpleNamespace(apparent=1.0), prepared=SimpleNamespace(start=start, body=SimpleNamespace(scale=scale))
    )
    begun, fitted = describe_start(start, scale), module._words(SimpleNamespace(problem=problem, z=torch.zeros(2)), stage)
    first = {"Pa": "2e+05", "m^2/s^2": "200", "": "1"}[unit]
    assert fitted.endswith(unit)
    assert f"= {first} {unit}".rstrip() in begun
    assert ("Pa" in begun) == ("Pa" in fitted) == scale.absolute
