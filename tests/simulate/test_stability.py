"""Substeps, memory, and what is said when a run leaves its bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError, SimulationError
from diffphys_ros.simulate import Simulator, State, max_young, substeps_per_frame
from diffphys_ros.simulate.run.sizes import TapePlan

from .bodies import block, full, simulator

PERIOD_S = 1 / 30


def test_substeps_follow_the_pressure_wave_at_cfl_one_half_with_margin():
    speed = math.sqrt(1.5 * 2e5 * 0.7 / (1.3 * 0.4 * 1000))
    assert substeps_per_frame(2e5, 0.3, 1000.0, dx=0.015, period_s=PERIOD_S) == math.ceil(speed * PERIOD_S / 0.0075)


def test_substeps_follow_the_stiffest_part():
    young, poisson, density = np.array([1e4, 3e5]), np.array([0.3, 0.2]), np.array([500.0, 1000.0])
    both = substeps_per_frame(young, poisson, density, dx=0.01, period_s=PERIOD_S)
    assert both == substeps_per_frame(3e5, 0.2, 1000.0, dx=0.01, period_s=PERIOD_S)


def test_max_young_is_the_inverse_of_substeps():
    limit = float(max_young(120, 0.3, 1000.0, dx=0.015, period_s=PERIOD_S))
    assert substeps_per_frame(limit * 0.999, 0.3, 1000.0, dx=0.015, period_s=PERIOD_S, margin=1.0) == 120
    assert substeps_per_frame(limit * 1.001, 0.3, 1000.0, dx=0.015, period_s=PERIOD_S, margin=1.0) == 121


def test_a_simulator_says_what_its_own_substeps_carry():
    sim = simulator(block((3, 2, 2), dx=0.02), substeps=40, period_s=PERIOD_S)
    assert sim.max_young() == pytest.approx(float(max_young(40, 0.3, 1000.0, dx=0.02, period_s=PERIOD_S)))


def test_incompressible_material_has_no_number_of_substeps():
    with pytest.raises(InputError, match="Poisson's ratio"):
        substeps_per_frame(1e5, 0.5, 1000.0, dx=0.01, period_s=PERIOD_S)


def run(sim: Simulator, *, young: float = 1e5, force: float = 0.0, state: State | None = None) -> None:
    push = torch.zeros(3, *sim.x_rest.shape)
    push[1:, :, 1] = force
    sim.rollout(state or sim.rest(), full(sim, young), full(sim, 0.3), push, 0.0)


def test_a_particle_that_leaves_the_grid_is_named_with_frame_substep_and_cure():
    sim = simulator(block((3, 2, 2), dx=0.02, clamped=False), substeps=40, period_s=PERIOD_S, anchored=False)
    with pytest.raises(
        SimulationError, match=r"frame [12], substep \d+ of 40, particle \d+: the particle left the grid near .* lower the force"
    ):
        run(sim, force=3e5)


def test_material_turned_inside_out_is_named_with_frame_substep_and_cure():
    sim = simulator(block((3, 2, 2), dx=0.02), substeps=40, period_s=PERIOD_S)
    crush = torch.eye(3).repeat(len(sim.volume), 1, 1)
    crush[5, 0, 0] = 0.02
    inward = torch.zeros(len(sim.volume), 3, 3)
    inward[:, 0, 0] = -3e3
    with pytest.raises(SimulationError, match=r"frame 0, substep 0 of 40, particle \d+: the material turned inside out"):
        run(sim, state=sim.rest(C=inward, v=sim.x_rest * sim.tensor([-3e3, 0.0, 0.0]), F=crush))


def test_material_too_stiff_for_the_substeps_is_answered_with_the_stiffness_they_carry():
    sim = simulator(block((3, 2, 2), dx=0.02), substeps=10, period_s=PERIOD_S)
    allowed = f"{sim.max_young():.3g}"
    with pytest.raises(
        SimulationError, match=rf"lower Young's modulus from 1e\+07 below {allowed.replace('+', chr(92) + '+')} Pa or raise the substeps"
    ):
        run(sim, young=1e7, force=1e4)


def test_a_state_that_is_not_finite_is_named():
    sim = simulator(block((3, 2, 2), dx=0.02), substeps=10, period_s=PERIOD_S)
    broken = sim.rest().data.clone()
    broken[3, 4] = math.nan
    with pytest.raises(SimulationError, match=r"frame 0, substep 0 of 10, particle \d+: the state is no longer finite"):
        run(sim, young=1e4, state=State(broken))


@pytest.mark.parametrize("keep", [False, True])
def test_a_simulator_runs_again_after_an_error(keep):
    sim = simulator(block((3, 2, 2), dx=0.02, per_cell=1.0), substeps=10, period_s=PERIOD_S)
    force = torch.zeros_like(sim.x_rest, requires_grad=keep)
    broken = sim.rest().data.clone()
    broken[:, 3:6] = math.nan
    with pytest.raises(SimulationError):
        sim.frame(State(broken), full(sim, 1e4), full(sim, 0.3), force, 0.0)
    assert sim.replay.scratch.velocity.isfinite().all()
    assert all(tape.velocity.isfinite().all() for tape in sim.replay.free)
    after = sim.frame(sim.rest(), full(sim, 1e4), full(sim, 0.3), force, 0.0)
    torch.testing.assert_close(after.data, sim.rest().data)


def test_a_grid_that_does_not_hold_the_particles_is_refused():
    particles, grid = block((3, 2, 2), dx=0.02)
    with pytest.raises(InputError, match="larger reach"):
        simulator((particles, type(grid)(grid.origin, grid.dx, (6, 8, 8), 3)), substeps=10, period_s=PERIOD_S)


@pytest.mark.parametrize(("option", "value", "hint"), [("law", "neo_hooken", "'neo_hookean'"), ("force_on", "particle", "'particles'")])
def test_a_misspelt_name_is_answered_with_the_known_one(option, value, hint):
    with pytest.raises(InputError, match=f"did you mean {hint}"):
        simulator(block((3, 2, 2), dx=0.02), substeps=10, period_s=PERIOD_S, **{option: value})


@pytest.mark.parametrize("substeps", [1, 2, 60, 351, 2000])
def test_a_small_budget_keeps_about_two_roots_of_the_substeps(substeps):
    plan = TapePlan.within(0, substeps=substeps, state=1, velocity=1)
    assert plan.states <= 2 * math.sqrt(substeps) + 3
    assert plan.chunk * max(plan.marks, 1) >= substeps


def test_a_larger_budget_keeps_states_then_velocities_then_frames():
    def level(budget: float) -> tuple[int, bool, int]:
        plan = TapePlan.within(budget, substeps=60, state=96, velocity=32)
        return plan.chunk, plan.keep_velocity, plan.kept

    states, whole = 61 * 96, 61 * 96 + 60 * 32
    assert [level(b) for b in (states - 1, states, whole, 5 * whole)] == [(8, False, 0), (60, False, 0), (60, True, 1), (60, True, 5)]


def test_a_few_frames_of_many_are_not_kept():
    whole = 61 * 96 + 60 * 32
    kept = [TapePlan.within(5 * whole, substeps=60, state=96, velocity=32, frames=frames).kept for frames in (0, 5, 25, 26, 500)]
    assert kept == [5, 5, 5, 1, 1]


@pytest.mark.parametrize("budget_mb", [0.0, 1.5, 20.0])
def test_the_simulator_holds_what_its_formula_says(budget_mb):
    sim = simulator(block((6, 3, 3), dx=0.02), substeps=50, period_s=PERIOD_S, memory_budget_mb=budget_mb, dtype=torch.float32)
    states = sim.rollout(sim.rest(), full(sim, 1e4).requires_grad_(), full(sim, 0.3), torch.zeros(30, *sim.x_rest.shape), 0.0)
    states.x.sum().backward()
    held = tensors_of(sim.replay, set())
    assert held == pytest.approx(sim.scratch_bytes(), rel=0.1)
    own = 96 * len(sim.volume)
    bound = own * (2 * math.sqrt(50) + 7) + 100 * math.prod(sim.grid.size)
    assert held < bound + budget_mb * 2**20


@pytest.mark.parametrize("batch", [1, 4])
def test_a_rollout_and_its_gradient_hold_what_the_memory_formula_says(batch):
    """Without a budget; nodes: 18 scalars each (three grids, a velocity grid and the drag)."""
    body, substeps, frames = block((12, 3, 3), dx=0.02, per_cell=1.5), 64, 20
    sim = simulator(body, substeps=substeps, period_s=PERIOD_S, memory_budget_mb=0.0, dtype=torch.float32, batch=batch)
    saved: dict[int, int] = {}

    def note(tensor: torch.Tensor) -> torch.Tensor:
        saved[tensor.untyped_storage().data_ptr()] = tensor.untyped_storage().nbytes()
        return tensor

    force = torch.zeros(frames, *sim.x_rest.shape, requires_grad=True)
    with torch.autograd.graph.saved_tensors_hooks(note, lambda t: t):
        path = sim.rollout(sim.rest(), full(sim, 1e4).requires_grad_(), full(sim, 0.3), force, 0.0)
    path.x.sum().backward()
    held, count = tensors_of(sim.replay, set()) + sum(saved.values()), batch * len(sim.volume)
    formula = 96 * count * (frames + 2 * math.sqrt(substeps) + 7) + 12 * count * frames + 72 * batch * sim.replay.room
    assert 0.8 * formula < held < formula


def tensors_of(thing: object, seen: set[int]) -> int:
    """Bytes of all tensors that an object reaches."""
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    if isinstance(thing, torch.Tensor):
        storage = thing.untyped_storage()
        known = storage.data_ptr() in seen
        seen.add(storage.data_ptr())
        return 0 if known else storage.nbytes()
    if isinstance(thing, (list, tuple)):
        return sum(tensors_of(item, seen) for item in thing)
    if type(thing).__module__.startswith("diffphys_ros.simulate"):
        return sum(tensors_of(item, seen) for item in vars(thing).values())
    return 0


def test_tapes_come_back_when_a_graph_is_dropped_without_a_backward_pass():
    sim = simulator(block((4, 2, 2), dx=0.02), substeps=20, period_s=PERIOD_S)
    for _ in range(3):
        sim.frame(sim.rest(), full(sim, 1e4).requires_grad_(), full(sim, 0.3), None, 0.0)
    assert sim.replay.lent == len(sim.replay.free) == 1


@pytest.mark.parametrize("budget_mb", [0.0, 20.0])
def test_tapes_that_are_released_are_made_again_and_change_nothing(budget_mb):
    sim, gradients = simulator(block((6, 3, 3), dx=0.02), substeps=50, period_s=PERIOD_S, memory_budget_mb=budget_mb), []
    before = tensors_of(sim.replay, set())
    for _ in range(2):
        young = full(sim, 1e4).requires_grad_()
        sim.rollout(sim.rest(), young, full(sim, 0.3), torch.ones(4, *sim.x_rest.shape), 0.0).x.square().sum().backward()
        gradients.append(young.grad)
        assert tensors_of(sim.replay, set()) > 1.5 * before
        sim.release()
        assert tensors_of(sim.replay, set()) < 1.3 * before
    assert torch.equal(*gradients)


def test_a_rollout_saves_about_96_bytes_per_particle_and_frame():
    sim = simulator(block((6, 3, 3), dx=0.02), substeps=20, period_s=PERIOD_S, dtype=torch.float32)
    storages: dict[int, int] = {}

    def note(tensor: torch.Tensor) -> torch.Tensor:
        storages[tensor.untyped_storage().data_ptr()] = tensor.untyped_storage().nbytes()
        return tensor

    frames = 30
    force = torch.zeros(frames, *sim.x_rest.shape, requires_grad=True)
    with torch.autograd.graph.saved_tensors_hooks(note, lambda t: t):
        path = sim.rollout(sim.rest(), full(sim, 1e4).requires_grad_(), full(sim, 0.3), force, 0.0)
    assert path.x.requires_grad
    own = 96 * len(sim.volume)
    assert own * frames <= sum(storages.values()) < 1.25 * own * frames


def test_without_gradients_nothing_is_kept():
    sim = simulator(block((4, 2, 2), dx=0.02), substeps=20, period_s=PERIOD_S)
    with torch.no_grad():
        state = sim.frame(sim.rest(), full(sim, 1e4), full(sim, 0.3), None, 0.0)
    assert state.data.grad_fn is None
    assert sim.replay.lent == 0
