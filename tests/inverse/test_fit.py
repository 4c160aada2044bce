"""Claims about a fit as it goes from stage to stage."""

from __future__ import annotations

import weakref

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.inverse import fit as module
from diffphys_ros.inverse.checkpoint import Checkpoint
from diffphys_ros.inverse.clock import Clock
from diffphys_ros.inverse.fit import fit
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.problem import pose_problem
from diffphys_ros.inverse.stages import schedule

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
