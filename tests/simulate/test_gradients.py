"""Gradients of the simulator are those of the motion it computes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor

from diffphys_ros.simulate import Simulator, State
from diffphys_ros.simulate.laws import LAWS
from diffphys_ros.simulate.run.launches import PROGRAMS, Parallel, Serial

from . import twin
from .bodies import block, simulator
from .laws.points import OWN

GRAVITY = (0.3, -9.81, 0.5)
DT = 4e-4
PARTS = {"x": (slice(0, 3), 0.02), "v": (slice(3, 6), 0.3), "C": (slice(6, 15), 2.0), "F": (slice(15, 24), 0.05)}  # and step
NAMES = [*PARTS, "young", "poisson", "force", "mass_damping", "density"]


@dataclass
class Case:
    """A deformed block in motion: inputs, and a scalar of the state one frame later."""

    sim: Simulator
    inputs: dict[str, Tensor]
    weight: Tensor

    def after(self, inputs: dict[str, Tensor]) -> State:
        i = inputs
        self.sim.law_parameters = self.own(i)
        return self.sim.frame(State(i["state"]), i["young"], i["poisson"], i["force"], i["mass_damping"], density=i["density"])

    def own(self, inputs: dict[str, Tensor]) -> dict[str, Tensor]:
        """Those of the inputs that are the law's."""
        return {p.name: inputs[p.name] for p in self.sim.law.parameters}

    def loss(self, inputs: dict[str, Tensor]) -> Tensor:
        return (self.after(inputs).data * self.weight).sum()


def case(
    substeps: int, *, law: str = "neo_hookean", budget_mb: float = 64.0, force_on: str = "particles", anchored: bool | None = None
) -> Case:
    body = block((4, 3, 3), dx=0.02, per_cell=1.5, jitter=0.2)
    options = {"law": law, "memory_budget_mb": budget_mb, "gravity": GRAVITY, "force_on": force_on, "anchored": LAWS[law].elastic if anchored is None else anchored}
    sim = simulator(body, substeps=substeps, period_s=substeps * DT, **options)
    rng, count = np.random.default_rng(1), len(sim.volume)
    draw = lambda *shape: sim.tensor(rng.normal(size=shape))  # noqa: E731
    state = sim.rest(v=0.3 * draw(count, 3), C=2 * draw(count, 3, 3), F=torch.eye(3) + 0.05 * draw(count, 3, 3))
    inputs = {
        "state": state.data,
        "young": sim.tensor(rng.uniform(5e4, 2e5, count)),
        "poisson": sim.tensor(rng.uniform(0.2, 0.4, count)),
        "force": 3000 * draw(*((count, 3) if force_on == "particles" else (*sim.grid.size, 3))),
        "mass_damping": sim.tensor(0.7),
        "density": sim.tensor(rng.uniform(800, 1200, count)),
        **{p.name: sim.tensor(OWN[p.name] * rng.uniform(0.8, 1.2, count)) for p in sim.law.parameters},
    }
    scale = sim.tensor(np.repeat([100.0, 1.0, 0.01, 1.0], [3, 3, 9, 9]))
    return Case(sim, {k: v.clone().requires_grad_() for k, v in inputs.items()}, draw(count, 24) * scale)


def direction(given: Case, name: str) -> tuple[str, Tensor]:
    """The input that holds `name`, and a random direction in it about as large as the input itself."""
    rng = np.random.default_rng(2)
    if name not in PARTS:
        value = given.inputs[name].detach()
        return name, given.sim.tensor(rng.normal(size=value.shape)) * value.abs().mean()
    part, scale = PARTS[name]
    step = torch.zeros_like(given.inputs["state"])
    step[:, part] = given.sim.tensor(rng.normal(size=step[:, part].shape)) * scale
    return "state", step


def relative_error(given: Case, name: str) -> float:
    """Of the gradient along a direction against the best of three central differences."""
    key, step = direction(given, name)
    (gradient,) = torch.autograd.grad(given.loss(given.inputs), given.inputs[key])
    exact, errors = float((gradient * step).sum()), []
    for size in (1e-3, 1e-4, 1e-5):
        with torch.no_grad():
            up, down = (float(given.loss({**given.inputs, key: given.inputs[key] + sign * size * step})) for sign in (1, -1))
        errors.append(abs((up - down) / (2 * size) - exact) / abs(exact))
    return min(errors)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("substeps", [1, 100, 1000])
@pytest.mark.parametrize("anchored", [True, False])
def test_the_gradient_of_a_frame_equals_central_differences(anchored, substeps, name):
    assert relative_error(case(substeps, anchored=anchored), name) < 1e-5


@pytest.mark.parametrize("law", [law for law in LAWS if law != "neo_hookean"])
def test_every_law_has_the_gradient_of_its_stress(law):
    given = case(6, law=law)
    names = ["F", "C", "young", "poisson", *given.own(given.inputs)]
    assert max(relative_error(given, name) for name in names) < 1e-5


def test_the_gradient_through_forces_on_nodes_equals_central_differences():
    given = case(5, force_on="nodes")
    assert max(relative_error(given, name) for name in ("x", "force")) < 1e-5


@pytest.mark.parametrize(("law", "anchored"), [(law, anchored) for law in LAWS for anchored in (False, True) if LAWS[law].elastic or not anchored])
def test_one_substep_and_its_gradients_equal_the_torch_twin(law, anchored):
    given = case(1, law=law, anchored=anchored)
    i, sim = given.inputs, given.sim
    rest = {k: i[k] for k in ("young", "poisson", "density", "force", "mass_damping")} | {"law_parameters": given.own(i)}
    expected = twin.substep(State(i["state"]), sim.grid, DT, law=law, volume=sim.volume, gravity=sim.gravity, **rest)
    if anchored:  # the same substep: weights have not moved yet, and C is taken to the positions after it
        expected = expected.replace(C=expected.C @ torch.linalg.inv(expected.F @ torch.linalg.inv(State(i["state"]).F)))
    ours = given.after(i)
    torch.testing.assert_close(ours.data, expected.data, rtol=1e-11, atol=1e-12)
    gradients = [torch.autograd.grad((s.data * given.weight).sum(), list(i.values())) for s in (ours, expected)]
    for mine, reference in zip(*gradients, strict=True):
        torch.testing.assert_close(mine, reference, rtol=1e-9, atol=1e-11 * float(reference.abs().max()))


def test_a_kept_frame_a_whole_replay_and_a_chunked_replay_give_the_same_gradient():
    gradients, plans = [], []
    for budget in (64.0, 0.9, 0.0):
        given = case(23, budget_mb=budget)
        gradients.append(torch.autograd.grad(given.loss(given.inputs), list(given.inputs.values())))
        plans.append((given.sim.replay.plan.kept > 0, given.sim.replay.plan.keep_velocity, given.sim.replay.plan.marks > 0))
    assert plans == [(True, True, False), (False, False, False), (False, False, True)]
    assert all(torch.equal(a, b) for other in gradients[1:] for a, b in zip(gradients[0], other, strict=True))


@pytest.mark.parametrize("budget_mb", [64.0, 0.0])
@pytest.mark.parametrize("force_on", ["particles", "nodes"])
def test_one_launch_a_frame_and_one_launch_a_kernel_give_the_same(budget_mb, force_on, monkeypatch):
    results = []
    for program in (Serial, Parallel):
        monkeypatch.setitem(PROGRAMS, "cpu", program)
        given = case(9, budget_mb=budget_mb, force_on=force_on)
        results.append([given.after(given.inputs).data, *torch.autograd.grad(given.loss(given.inputs), list(given.inputs.values()))])
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


@pytest.mark.parametrize("budget_mb", [1.5, 3.0])
def test_frames_that_share_tapes_have_the_gradients_of_frames_that_each_keep_one(budget_mb):
    gradients = []
    for budget in (64.0, budget_mb):
        given = case(23, budget_mb=budget)
        i, frames = given.inputs, 5
        path = given.sim.rollout(State(i["state"]), i["young"], i["poisson"], i["force"].expand(frames, -1, -1), i["mass_damping"])
        gradients.append(torch.autograd.grad((path.data[1:] * given.weight).sum(), [i[k] for k in ("state", "young", "force")]))
        assert (given.sim.replay.plan.kept >= frames) == (budget == 64.0)
        assert given.sim.replay.lent == len(given.sim.replay.free) <= given.sim.replay.plan.kept
    assert all(torch.equal(a, b) for a, b in zip(*gradients, strict=True))


def test_a_second_backward_pass_over_the_same_frame_gives_the_same_gradient():
    given = case(7)
    loss = given.loss(given.inputs)
    first = torch.autograd.grad(loss, given.inputs["young"], retain_graph=True)
    assert torch.equal(first[0], torch.autograd.grad(loss, given.inputs["young"])[0])


def test_a_body_that_outruns_its_box_is_simulated_on_the_whole_grid():
    body = block((3, 2, 2), dx=0.02, clamped=False, margin=12)
    states = []
    for push in (0.0, 8e4):
        sim = simulator(body, substeps=60, period_s=1 / 30, anchored=False)
        force = torch.full_like(sim.x_rest, push, requires_grad=True)
        state = sim.frame(sim.rest(), torch.full_like(sim.volume, 1e5), sim.tensor(0.3), force, 0.0)
        states.append((sim, state, torch.autograd.grad(state.x.sum(), force)[0]))
    (_, still, slope), (sim, moved, fast_slope) = states
    assert (moved.x - still.x).abs().min() > 2 * sim.grid.dx
    torch.testing.assert_close(fast_slope, slope, rtol=1e-6, atol=0)  # a rigid push: linear in the force


def test_a_frame_runs_on_the_nodes_that_its_particles_can_reach():
    body = block((3, 2, 2), dx=0.02, clamped=False, margin=12)
    sim = simulator(body, substeps=60, period_s=1 / 30, anchored=False)
    state = sim.rest(v=sim.tensor([1.0, 0.0, -0.5]).expand(len(sim.volume), 3))
    sim.frame(state, torch.full_like(sim.volume, 1e5), sim.tensor(0.3), None, 0.0)
    low, size = sim.replay.scratch.boxes[0, :3].numpy(), sim.replay.scratch.boxes[0, 3:6].numpy()
    first, last = (np.floor((end - sim.grid.origin) / sim.grid.dx - 0.5) for end in (body[0].x_rest.min(0), body[0].x_rest.max(0)))
    reach = np.array([3, 1, 2])  # cells: a frame's way of 1.7, 0 and 0.8 cells, rounded up, and one more
    np.testing.assert_array_equal(low, first - reach)
    np.testing.assert_array_equal(low + size - 1, last + reach + 2)


def test_gradients_reach_the_first_frame_through_a_rollout():
    given = case(8)
    i, sim = given.inputs, given.sim
    force = torch.zeros(4, len(sim.volume), 3, dtype=torch.float64)
    force[0] = i["force"].detach()

    def tip(young: Tensor, push: Tensor) -> Tensor:
        path = sim.rollout(sim.rest(), young, i["poisson"], torch.cat([push, force[1:]]), i["mass_damping"])
        return 1e6 * (path.x[-1] - sim.x_rest)[-1].sum()

    young, push = i["young"].detach().requires_grad_(), force[:1].clone().requires_grad_()
    along_young, along_push = torch.autograd.grad(tip(young, push), (young, push))
    with torch.no_grad():
        stiffer, softer = (float(tip(young * (1 + s), push)) for s in (1e-3, -1e-3))
        harder, lighter = (float(tip(young, push * (1 + s))) for s in (1e-3, -1e-3))
    assert float((along_young * young.detach()).sum()) == pytest.approx((stiffer - softer) / 2e-3, rel=1e-5)
    assert float((along_push * push.detach()).sum()) == pytest.approx((harder - lighter) / 2e-3, rel=1e-5)


def test_single_precision_gradients_agree_with_double():
    results = []
    for dtype in (torch.float32, torch.float64):
        body = block((6, 3, 3), dx=0.02, per_cell=1.5)
        sim = simulator(body, substeps=60, period_s=1 / 30, gravity=GRAVITY, dtype=dtype)
        young = torch.full_like(sim.volume, 1e5, requires_grad=True)
        force = torch.full_like(sim.x_rest, 500.0, requires_grad=True)
        state = sim.rest()
        for _ in range(3):
            state = sim.frame(state, young, sim.tensor(0.3), force, 0.2)
        results.append(torch.autograd.grad((state.x - sim.x_rest).square().sum(), (young, force)))
    for single, double in zip(*results, strict=True):
        assert torch.linalg.vector_norm(single - double) < 0.01 * torch.linalg.vector_norm(double)
