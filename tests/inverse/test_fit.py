"""Claims about a fit as it goes from stage to stage."""

from __future__ import annotations

from diffphys_ros.config import build
from diffphys_ros.inverse.checkpoint import Checkpoint
from diffphys_ros.inverse.clock import Clock
from diffphys_ros.inverse.fit import fit
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.problem import pose_problem
from diffphys_ros.inverse.stages import schedule

from .test_solve import drive


def test_a_fit_that_is_over_holds_no_tapes(prepared) -> None:
    """They are the largest part of what it held, and of no use to what follows."""
    few = {"scene.at_rest": True, "particles.cells": 2, "experiment.per_cell": 1.0, "fit.iterations": 1}
    model = Model(pose_problem(prepared, None, build(few)))
    replay = model.problem.forward.simulator.replay
    fitted = drive(fit(model, schedule(model.problem), checkpoint=Checkpoint(None), clock=Clock()))[1]
    assert fitted.simulated
    assert model.problem.forward.simulator.replay is replay
    assert replay.plan.kept
    assert (replay.lent, replay.free) == (0, [])
