"""The scan over one factor of all moduli, as batches of simulations."""

import weakref

import numpy as np
import pytest
import torch

from diffphys_ros.inverse import modulus_scan as scan
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.problem import SHIFTS, pose_problem
from diffphys_ros.simulate import Simulator


@pytest.fixture(scope="module")
def problem(prepared, quick_settings):
    return pose_problem(prepared, None, quick_settings, dtype=torch.float64)


def shifted(problem, *shifts: float) -> np.ndarray:
    trials = np.repeat(problem.layout.start[None], len(shifts), 0)
    trials[:, : problem.layout.parts] += np.array(shifts)[:, None]
    return trials


def test_a_batch_of_trials_costs_what_each_of_them_costs_alone(problem):
    trials = shifted(problem, -0.1, 0.0, 0.15)
    problem.forward.capture(problem.layout.young_of(trials[-1]))
    alone = [Model(problem, z)().value for z in trials]
    assert scan.track_values(problem, trials) == pytest.approx(alone, rel=1e-9)


def test_the_scan_leads_back_from_far_off(problem):
    found = scan.best_scale(problem, shifted(problem, -0.4)[0], room=10.0)
    assert np.abs(found[: problem.layout.parts]).max() < 0.11


def test_the_scan_does_not_pass_what_the_substeps_may_carry(problem):
    start = shifted(problem, -0.4)[0]
    found = scan.best_scale(problem, start, room=0.2)
    assert np.all(found - start <= 0.2 + 1e-12)


def test_a_trial_that_leaves_its_bounds_costs_infinity_and_spoils_no_other(problem):
    trials = shifted(problem, 0.0, -5.0)
    trials[:, problem.layout.force_slice] *= 4.0
    values = scan.track_values(problem, trials)
    assert np.isfinite(values[0])
    assert np.isinf(values[1])


def test_memory_bounds_the_size_of_a_batch(problem, monkeypatch):
    trials = shifted(problem, *SHIFTS)
    whole = np.array([problem.prepared.clip.frames.shape[0] * len(problem.disc.particles.x_rest) * scan.STATE_BYTES])
    monkeypatch.setattr(scan, "MOST_BYTES", 3.0 * whole[0])
    assert max(len(batch) for batch in scan._batches(problem.forward, trials)) <= 3


def test_of_a_trials_states_the_positions_alone_are_held(problem, monkeypatch):
    states, held, march = [], [], Simulator.march

    def watched(simulator, *given, **options):
        for state in march(simulator, *given, **options):
            states.append(weakref.ref(state.data))
            held.append(sum(known() is not None for known in states))
            yield state

    monkeypatch.setattr(Simulator, "march", watched)
    scan.track_values(problem, shifted(problem, -0.1, 0.0))
    assert len(held) == len(problem.prepared.clip)
    assert max(held) <= 3
