"""A batch is its simulations, each as if run alone."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from diffphys_ros.errors import InputError, SimulationError
from diffphys_ros.simulate import Handle, ModalDamping, Plane, Simulator, State
from diffphys_ros.simulate.run.launches import PROGRAMS, Parallel

from .bodies import block, full, simulator

BATCH, FRAMES, PERIOD_S = 3, 4, 1 / 60
OPTIONS = {"substeps": 30, "period_s": PERIOD_S, "gravity": (0.2, 0.0, -9.81)}
BORDERS = {"planes": [Plane((0, 0, 1), -0.005, friction=0.2), Plane((-1, 0, 0), -0.085)], "handle": Handle((-1, -1, -1), (0.005, 1, 1))}


def body():
    return block((4, 2, 2), dx=0.02, per_cell=1.5, margin=5)


def draws(sim: Simulator) -> dict[str, Tensor]:
    """Inputs of every simulation, all different; they move apart, so that their boxes differ."""
    rng, count = np.random.default_rng(3), len(sim.volume)
    draw = lambda low, high, *shape: sim.tensor(rng.uniform(low, high, (BATCH, *shape)))  # noqa: E731
    inputs = {
        "x": sim.x_rest + draw(-2e-4, 2e-4, count, 3),
        "v": draw(-0.1, 0.1, count, 3) + draw(-0.8, 0.8, 1, 3),
        "young": draw(5e4, 2e5, count),
        "poisson": draw(0.2, 0.4, count),
        "density": draw(900, 1100, count),
        "force": draw(-2000, 2000, FRAMES, count, 3),
        "mass_damping": draw(0, 1),
    }
    return {k: v.requires_grad_() for k, v in inputs.items()}


def rollout(sim: Simulator, i: dict[str, Tensor], **options: object) -> State:
    """States (T, ..., P, 24) from moving particles, for the inputs of one simulation or of all."""
    start = sim.rest(x=i["x"], v=i["v"])
    force = i["force"].movedim(-3, 0)
    return sim.rollout(start, i["young"], i["poisson"], force, i["mass_damping"], density=i["density"], **options)  # type: ignore[arg-type]


def gradients(states: State, weight: Tensor, inputs: dict[str, Tensor]) -> list[Tensor]:
    return list(torch.autograd.grad((states.data * weight).sum(), list(inputs.values())))


@pytest.mark.parametrize("options", [{}, {"anchored": False}, {"memory_budget_mb": 0.0}, BORDERS], ids=["kept", "moving", "replayed", "borders"])
def test_a_batch_and_its_gradients_equal_its_simulations_run_alone_to_the_bit(options):
    together = simulator(body(), batch=BATCH, **OPTIONS, **options)
    inputs = draws(together)
    ours = rollout(together, inputs)
    weight = torch.randn(ours.data.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    bars = gradients(ours, weight, inputs)
    for b in range(BATCH):
        own = {k: v[b].detach().requires_grad_() for k, v in inputs.items()}
        alone = rollout(simulator(body(), **OPTIONS, **options), own)
        assert torch.equal(ours.data[:, b], alone.data)
        for mine, bar in zip(bars, gradients(alone, weight[:, b], own), strict=True):
            assert torch.equal(mine[b], bar)


def test_shared_inputs_gather_the_gradients_of_all_simulations():
    sim = simulator(body(), batch=BATCH, **OPTIONS)
    young = torch.tensor([[6e4], [9e4], [1.2e5]], dtype=torch.float64, requires_grad=True)
    poisson = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)
    force = torch.full((FRAMES, *sim.x_rest.shape), 300.0, dtype=torch.float64, requires_grad=True)
    state = sim.rollout(sim.rest(), young, poisson, force, 0.1)
    bars = torch.autograd.grad(state.x[-1].square().sum(), (young, poisson, force))
    total = [torch.zeros_like(bar) for bar in bars[1:]]
    for b in range(BATCH):
        one = simulator(body(), **OPTIONS)
        last = one.rollout(one.rest(), young[b], poisson, force, 0.1).x[-1]
        own = torch.autograd.grad(last.square().sum(), (young, poisson, force))
        torch.testing.assert_close(own[0][b], bars[0][b], rtol=1e-12, atol=0)
        total = [t + o for t, o in zip(total, own[1:], strict=True)]
    for mine, other in zip(bars[1:], total, strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-9, atol=1e-12 * float(other.abs().max()))


def test_one_launch_a_simulation_and_one_launch_for_all_give_the_same(monkeypatch):
    results = []
    for program in (PROGRAMS["cpu"], Parallel):
        monkeypatch.setitem(PROGRAMS, "cpu", program)
        sim = simulator(body(), batch=BATCH, **OPTIONS, **BORDERS)
        inputs = draws(sim)
        states = rollout(sim, inputs)
        results.append([states.data, *gradients(states, torch.ones_like(states.data), inputs)])
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_a_forward_only_batch_keeps_no_tape():
    sim = simulator(body(), batch=BATCH, **OPTIONS)
    with torch.no_grad():
        states = rollout(sim, draws(sim))
    assert states.data.shape == (FRAMES + 1, BATCH, len(sim.volume), 24)
    assert sim.replay.lent == 0


def test_damping_of_the_modes_takes_a_batch_and_a_rate_for_each_simulation():
    sim, one = simulator(body(), batch=BATCH, **OPTIONS), simulator(body(), **OPTIONS)
    shapes = np.stack([one.x_rest.numpy() ** 2, one.x_rest.numpy()[:, ::-1]], -1)
    slopes = np.zeros((len(shapes), 3, 3, 2))
    slopes[:, 0, 0, 0] = 2 * one.x_rest.numpy()[:, 0]
    damping = ModalDamping.of(sim, shapes, slopes, np.array([11.0, 23.0]))
    state, beta = sim.rest(v=draws(sim)["v"].detach()), torch.tensor([0.0, 1e-3, 5e-3], dtype=torch.float64)
    after = damping.kick(state, beta)
    for b in range(BATCH):
        alone = damping.kick(State(state.data[b]), beta[b])
        torch.testing.assert_close(after.data[b], alone.data, rtol=0, atol=1e-14)


def test_an_error_names_the_simulation():
    sim = simulator(block((3, 2, 2), dx=0.02, clamped=False), batch=BATCH, substeps=40, period_s=1 / 30, anchored=False)
    push = torch.zeros(BATCH, len(sim.volume), 3)
    push[2, :, 1] = 6e5
    with pytest.raises(SimulationError, match=r"simulation 2, frame 0, substep \d+ of 40, particle \d+: the particle left the grid"):
        sim.frame(sim.rest(), full(sim, 1e5), full(sim, 0.3), push, 0.0)


def test_an_empty_batch_is_refused():
    with pytest.raises(InputError, match="batch is 0"):
        simulator(body(), batch=0, **OPTIONS)


def test_gradients_see_at_most_as_many_frames_back_as_asked():
    sim = simulator(body(), **OPTIONS)
    inputs = {k: v[0].detach().requires_grad_() for k, v in draws(sim).items()}
    cut, whole = (rollout(sim, inputs, cut_every=every) for every in (2, None))
    assert torch.equal(cut.data, whole.data)
    (bar,) = torch.autograd.grad(cut.x[-1].sum(), inputs["force"])
    assert bar[:2].abs().max() == 0
    start, state = (State(whole.data[k].detach()) for k in (0, 2))
    force = inputs["force"][2:].detach().requires_grad_()
    for push in force:
        state = sim.frame(state, inputs["young"], inputs["poisson"], push, inputs["mass_damping"], density=inputs["density"], anchor=start)
    (expected,) = torch.autograd.grad(state.x.sum(), force)
    assert torch.equal(bar[2:], expected)
