"""How far a step of the search may go, and which moduli it may reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.config import Settings, build, flat
from diffphys_ros.inverse import solve
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.problem import Problem, pose_problem
from diffphys_ros.inverse.stages.constants import allowed

from .conftest import YOUNG
from .test_solve import drive


@pytest.fixture(scope="module")
def soft(prepared: Prepared) -> Prepared:
    """The same clip with start values of half the modulus."""
    return replace(prepared, start=replace(prepared.start, young=0.5 * YOUNG, log10_young_sd=np.full(2, 0.3)))


@pytest.fixture(scope="module")
def problem(soft: Prepared, quick_settings: Settings) -> Problem:
    return pose_problem(soft, None, quick_settings)


@pytest.mark.parametrize(("block", "size", "share"), [("young", 0.8, 0.5), ("young", -0.8, 0.5), ("damping", 4.0, 0.25), ("force", 9.0, 1.0), ("young", 0.1, 1.0)])
def test_a_step_changes_log_e_by_two_fifths_and_damping_by_one_unit_at_most(problem: Problem, block: str, size: float, share: float) -> None:
    layout = problem.layout
    step = np.zeros(layout.size)
    step[layout.slices[block].start] = size
    free = layout.index(layout.free)
    assert allowed(problem, layout.start[free], step[free]) == pytest.approx(share)


def test_no_modulus_is_found_beyond_what_max_substeps_carry(soft: Prepared, problem: Problem, quick_settings: Settings) -> None:
    """Half the true modulus is carried with a margin of a half: the search wants to go on and stops there."""
    simulator = problem.forward.simulator
    settings = build(flat(quick_settings) | {"experiment.max_substeps": simulator.substeps, "fit.iterations": 5})
    stiffest = drive(solve(soft, None, settings))[1].young_solver.max()
    assert 0.95 < stiffest / simulator.max_young() < 1.001
