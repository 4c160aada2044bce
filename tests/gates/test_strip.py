"""The hanging strip that linear modes miss: only a simulation that is fitted to the clip comes within these bounds.

Without the descent the trajectory is off by more than twice its bound: .16 for the linear motion, .19 for the simulation of the
start values.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder

from .conftest import Answer, Recover

YOUNG, TRAJECTORY, COSINE, FALSE_FORCE = 0.03, 0.05, 0.95, 0.05
STILL_M = 7e-4
DAMPING_S = 5e-4  # of strain; with nothing that holds it, it ends below zero


@pytest.fixture(scope="module")
def answer(recovered: Recover) -> Answer:
    return recovered("strip")


def test_stiffness_force_and_trajectory_are_those_of_the_other_simulator(answer: Answer) -> None:
    assert abs(answer.log10_young_error[0]) < YOUNG
    assert answer.trajectory_error < TRAJECTORY
    assert answer.metrics["net_force_cosine"] > COSINE
    assert answer.metrics["false_force_ratio"] < FALSE_FORCE


def test_what_brakes_it_is_its_strain_as_in_the_other_simulator(answer: Answer) -> None:
    with np.load(sample_folder("strip") / "truth.npz") as truth:
        assert abs(answer.recovery.damping.stiffness_s - truth["damping_stiffness_beta_effective"]) < DAMPING_S


def test_it_hangs_still_without_the_gust(answer: Answer, tmp_path: Path) -> None:
    """Without the stress that gravity puts into frame 0 it would sag by 1.5 mm and bounce."""
    assert main(["simulate", str(answer.folder), "--out", str(tmp_path / "still.npz"), "--force_scale", "0"]) == 0
    free = np.load(tmp_path / "still.npz")["trajectory"]
    assert np.linalg.norm(free - free[0], axis=-1).max() < STILL_M


def test_the_simulation_is_the_answer_and_the_better_explanation(answer: Answer) -> None:
    assert answer.metrics["refined"]
    assert answer.metrics["misfit_refined"] < 0.3 * answer.metrics["misfit_start"]
