"""Bodies that meet floors, walls and a handle obey mechanics, and gradients come through."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from diffphys_ros.errors import InputError
from diffphys_ros.simulate import Handle, Plane, Simulator, State
from diffphys_ros.simulate.handle import substep_poses, twist_matrix
from diffphys_ros.simulate.run.launches import PROGRAMS, Parallel, Serial

from .bodies import block, full, masses, simulator
from .test_physics import energy

G, DX, PERIOD_S = 9.81, 0.02, 1 / 60
ANCHORED = pytest.mark.parametrize("anchored", [True, False], ids=["anchored", "moving"])
ROOT = Handle(low=(-math.inf,) * 3, high=(0.0, math.inf, math.inf))  # holds what a clamp of the beam at x = 0 holds


def mean(sim: Simulator, field: Tensor) -> Tensor:
    """Average over the body's mass of a field (..., P, 3)."""
    return (masses(sim)[:, None] * field).sum(-2) / masses(sim).sum()


def tilted(degrees: float, friction: float, *, anchored: bool | None = None) -> tuple[Simulator, Tensor, Tensor]:
    """A block that lies on a floor which is inclined against the grid; unit vectors down the slope and out of the floor."""
    turn = _turn(degrees)
    particles, grid = block((4, 3, 2), dx=DX, clamped=False, margin=7)
    middle = np.array([2.0, 1.5, 1.0]) * DX
    particles = dataclasses.replace(particles, x_rest=(particles.x_rest - middle) @ turn.T + middle)
    up, bottom = turn[:, 2], middle - DX * turn[:, 2]
    options = {"planes": [Plane(up, up @ bottom, friction=friction)], "anchored": anchored}
    sim = simulator((particles, grid), substeps=60, period_s=PERIOD_S, gravity=(0, 0, -G), **options)
    return sim, sim.tensor(turn[:, 0]), sim.tensor(up)


def _turn(degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def roll(sim: Simulator, frames: int, *, start: State | None = None, young: float = 2e5, damping: float = 0.0, **options: Tensor) -> State:
    """A roll-out without forces, without gradient."""
    with torch.no_grad():
        force = torch.zeros(frames, *sim.x_rest.shape)
        return sim.rollout(start or sim.rest(), full(sim, young), full(sim, 0.3), force, damping, **options)


@ANCHORED
@pytest.mark.parametrize(("degrees", "friction"), [(30, 0.3), (20, 0.0), (45, 0.5)])
def test_a_block_slides_down_an_inclined_floor_at_g_sin_minus_mu_cos(degrees, friction, anchored):
    sim, down, up = tilted(degrees, friction, anchored=anchored)
    path, angle = roll(sim, 6), math.radians(degrees)
    expected = G * (math.sin(angle) - friction * math.cos(angle)) * 6 * PERIOD_S
    assert float(mean(sim, path.v[-1]) @ down) == pytest.approx(expected, rel=0.01)
    assert float((mean(sim, path.x[-1] - path.x[0]) @ up).abs()) < 0.02 * DX, "it must stay on the floor"


@ANCHORED
def test_below_the_friction_angle_a_block_sticks(anchored):
    sim, down, _ = tilted(10, 0.3, anchored=anchored)
    path = roll(sim, 16)  # the first half for the block to sag under its own weight
    free_slide = G * math.sin(math.radians(10)) * (8 * PERIOD_S) ** 2 / 2
    assert abs(float(mean(sim, path.x[-1] - path.x[8]) @ down)) < 0.01 * free_slide
    assert abs(float(mean(sim, path.v[-1]) @ down)) < 0.01 * G * 8 * PERIOD_S


def falling(kind: str, friction: float, offset: float = 0.0, margin: int = 6, anchored: bool | None = None) -> Simulator:
    """A block a cell above a floor."""
    body = block((3, 3, 2), dx=DX, clamped=False, margin=margin, offset=offset)
    options = {"planes": [Plane((0, 0, 1), -DX, kind, friction)], "anchored": anchored}
    return simulator(body, substeps=35, period_s=PERIOD_S, gravity=(0, 0, -G), **options)


@ANCHORED
@pytest.mark.parametrize("offset", [0.0, 0.3, 0.6, 0.9])  # of the grid against the floor, in cells
def test_a_dropped_block_comes_to_rest_on_the_floor_and_keeps_its_horizontal_momentum(offset, anchored):
    sim = falling("separate", 0.0, offset, anchored=anchored)
    glide = sim.tensor([0.07, -0.03, 0.0]).expand_as(sim.x_rest)
    landed = State(roll(sim, 20, start=sim.rest(v=glide), young=1e5, damping=20.0).data[-1])
    still = landed.replace(v=landed.v + glide - mean(sim, landed.v))  # its horizontal speed again, after the heavy damping
    path = roll(sim, 10, start=still, young=1e5)
    gap = float(path.x[-1, :, 2].min() - DX / 4 + DX) / DX
    assert abs(gap) < 0.01
    assert (path.x[:, :, 2] - path.x[0, :, 2]).abs().max() < 0.02 * DX
    torch.testing.assert_close(mean(sim, path.v[-1])[:2], mean(sim, still.v)[:2], rtol=1e-10, atol=0)


@ANCHORED
def test_where_a_block_comes_to_rest_does_not_depend_on_how_high_it_fell_from_and_the_gradient_says_so(anchored):
    """Anchored at one place whatever the height: where that lies in the grid changes the resting height by 0.005 cells."""
    sim = falling("separate", 0.0, 0.3, anchored=anchored)
    height = torch.tensor(0.2 * DX, dtype=torch.float64, requires_grad=True)
    states = [sim.rest(x=sim.x_rest + height * sim.tensor(np.array([0.0, 0.0, 1.0])))]
    for _ in range(16):
        states.append(sim.frame(states[-1], full(sim, 1e5), full(sim, 0.3), None, 20.0, anchor=sim.rest()))
    falls, rests = (torch.autograd.grad(mean(sim, states[k].x)[2], height, retain_graph=True)[0] for k in (3, -1))
    assert float(falls) == pytest.approx(1.0)
    assert abs(float(rests)) < 0.1


@ANCHORED
def test_a_sliding_block_loses_mu_times_the_momentum_that_the_floor_gives_it(anchored):
    sim, friction = falling("separate", 0.1, margin=14, anchored=anchored), 0.1
    path = roll(sim, 10, start=sim.rest(v=sim.tensor([1.2, 0.0, 0.0]).expand_as(sim.x_rest)), young=1e5)
    time = torch.arange(11) * PERIOD_S
    speed = mean(sim, path.v)
    pressed = speed[:, 2] + G * time  # momentum from the floor over the mass, bounces included
    assert float(pressed[-1]) > 0.5 * G * float(time[-1])
    torch.testing.assert_close(1.2 - speed[:, 0], friction * pressed, rtol=1e-2, atol=1e-6)  # nodes do not all slide quite the same way


@pytest.mark.parametrize(("kind", "friction"), [("sticky", 0.0), ("slip", 0.3), ("separate", 0.0), ("separate", 0.3)])
def test_a_floor_does_no_work_on_what_falls_onto_it(kind, friction):
    sim, young = falling(kind, friction), 1e5
    path = roll(sim, 12, start=sim.rest(v=sim.tensor([0.3, 0.0, -0.5]).expand_as(sim.x_rest)), young=young)
    states = [State(data) for data in path.data]
    total = torch.tensor([energy(sim, s, young) + float(G * masses(sim) @ s.x[:, 2]) for s in states])
    assert (total[1:] - total[:-1]).max() < 1e-4 * (total[0] - total[-1]), "energy must not rise"
    assert states[-1].v[:, 2].abs().max() < 0.5


def test_a_sticky_floor_holds_what_a_separating_one_lets_go():
    lift = []
    for kind in ("sticky", "separate"):
        body = block((3, 3, 2), dx=DX, clamped=False, margin=6)
        sim = simulator(body, substeps=35, period_s=PERIOD_S, gravity=(0, 0, G), planes=[Plane((0, 0, 1), 0.0, kind)])
        path = roll(sim, 6, young=1e5)
        lift.append(float(path.x[-1, :, 2].min() - path.x[0, :, 2].min()))
    assert lift[0] < 0.02 * DX
    assert lift[1] == pytest.approx(G * (6 * PERIOD_S) ** 2 / 2, rel=0.01)


def test_a_corner_of_floor_and_wall_holds_a_body_that_slides_into_it():
    body = block((3, 2, 2), dx=DX, clamped=False, margin=6)
    planes = [Plane((0, 0, 1), 0.0, "slip"), Plane((1, 0, 0), -DX)]
    sim = simulator(body, substeps=35, period_s=PERIOD_S, gravity=(-G, 0, -G), planes=planes)
    path = roll(sim, 25, young=1e5, damping=10.0)
    assert float(path.x[..., 0].min()) > -DX
    assert float(path.x[..., 2].min()) > 0
    assert float(path.v[-1].abs().max()) < 0.01


def test_a_still_handle_is_a_clamp_to_the_last_bit():
    paths = []
    for clamped, handle in ((True, None), (False, ROOT)):
        body = block((6, 2, 2), dx=DX, clamped=clamped)
        sim = simulator(body, substeps=40, period_s=PERIOD_S, gravity=(0, -G, 0), handle=handle, anchored=False)
        paths.append(roll(sim, 4))
    assert torch.equal(paths[0].data, paths[1].data)


def turning(frames: int, rate: float) -> Tensor:
    """Poses (frames + 1, 4, 4) of a handle that turns about the z axis through the origin at `rate` [rad/s]."""
    twist = torch.tensor([0.0, 0.0, rate * PERIOD_S, 0.0, 0.0, 0.0], dtype=torch.float64)
    return torch.stack([torch.linalg.matrix_exp(k * twist_matrix(twist)) for k in range(frames + 1)])


def spin(sim: Simulator, rate: float) -> State:
    """The body at rest in a frame that turns."""
    gradient = sim.tensor([[0.0, -rate, 0.0], [rate, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return sim.rest(v=sim.x_rest @ gradient.T, C=gradient.expand(len(sim.volume), 3, 3))


def turned(handle: Handle, rate: float, frames: int) -> tuple[Tensor, Tensor]:
    """Strains (P,) of a beam that its handle has turned at `rate` [rad/s], and distances (P,) [m] from where it would be if rigid."""
    sim = simulator(block((6, 2, 2), dx=DX, clamped=False, margin=6), substeps=40, period_s=PERIOD_S, handle=handle)
    end = State(roll(sim, frames, start=spin(sim, rate), young=1e5, handle_poses=turning(frames, rate)).data[-1])
    rigid = sim.x_rest @ turning(frames, rate)[-1, :3, :3].T
    return (end.F.mT @ end.F - torch.eye(3)).abs().amax((1, 2)), (end.x - rigid).norm(dim=1)


def test_a_handle_that_holds_a_whole_body_moves_it_rigidly():
    strain, away = turned(Handle((-1.0,) * 3, (1.0,) * 3), 6.0, 6)
    assert strain.max() < 1e-9
    assert away.max() < 1e-9 * DX


def test_a_handle_that_turns_a_beam_by_its_root_strains_it_only_by_the_centrifugal_force():
    fast, slow = (turned(ROOT, rate, frames) for rate, frames in ((3.0, 12), (1.5, 24)))  # 34 degrees
    stretch = 1000.0 * (1.5 * 6 * DX) ** 2 / 1e5  # rho (omega L)^2 / E: twice the mean strain at the root of a long beam
    assert slow[0].mean() < stretch
    assert slow[0].max() < 10 * stretch, "at the corners of the root"
    assert slow[1].max() < 0.01 * DX
    assert 3.0 < fast[0].mean() / slow[0].mean() < 6.0, "it must go with the square of the rate"


def test_a_shaken_beam_moves_as_in_the_accelerated_frame():
    frames, amplitude, hz, rho, young = 30, 0.5 * DX, 4.0, 1000.0, 1e5
    time = torch.arange(frames + 1, dtype=torch.float64) * PERIOD_S
    shift = amplitude * (1 - torch.cos(2 * math.pi * hz * time))
    poses = torch.eye(4, dtype=torch.float64).repeat(frames + 1, 1, 1)
    poses[:, 1, 3] = shift
    speed = torch.cat([shift[1:2], (shift[2:] - shift[:-2]) / 2, shift[-1:] - shift[-2:-1]]) / PERIOD_S  # as substep_poses has it at frames
    shaken = simulator(block((10, 3, 3), dx=DX, per_cell=1.5, clamped=False, margin=5), substeps=45, period_s=PERIOD_S, handle=ROOT)
    clamped = simulator(block((10, 3, 3), dx=DX, per_cell=1.5, margin=5), substeps=45, period_s=PERIOD_S)
    inertia = torch.zeros(frames, *clamped.x_rest.shape, dtype=torch.float64)
    inertia[..., 1] = (-rho * (speed[1:] - speed[:-1]) / PERIOD_S)[:, None]
    start = clamped.rest(v=clamped.tensor([0.0, -float(speed[0]), 0.0]).expand_as(clamped.x_rest))
    with torch.no_grad():
        rides = clamped.rollout(start, full(clamped, young), full(clamped, 0.3), inertia, 0.0)
    moved = roll(shaken, frames, young=young, handle_poses=poses)
    tip = shaken.x_rest[:, 0] > 9 * DX
    seen, expected = (a[:, tip, 1].mean(1) for a in (moved.x - shaken.x_rest, rides.x - clamped.x_rest))
    bend = seen - shift
    assert expected.abs().max() > 0.2 * DX, "the beam must bend for this to mean anything"
    assert (bend - expected).abs().max() < 0.05 * expected.abs().max()


@dataclasses.dataclass
class Case:
    """A deformed block in motion between a floor, a wall and a handle: inputs, and a scalar of the state a frame later."""

    sim: Simulator
    inputs: dict[str, Tensor]
    weight: Tensor

    def after(self, i: dict[str, Tensor]) -> Tensor:
        borders: dict[str, Any] = {"friction": i["friction"]}
        if "twist" in i:
            poses = torch.stack([torch.eye(4).double(), torch.linalg.matrix_exp(twist_matrix(i["twist"]))])
            borders["handle_path"] = substep_poses(poses, self.sim.substeps)[0]
        if "anchor" in i:
            borders["anchor"] = State(i["anchor"])
        return self.sim.frame(State(i["state"]), i["young"], i["poisson"], i["force"], i["mass_damping"], **borders).data

    def loss(self, inputs: dict[str, Tensor]) -> Tensor:
        return (self.after(inputs) * self.weight).sum()


def case(substeps: int, *, budget_mb: float = 64.0, anchored: bool = False) -> Case:
    """With a handle and a slip wall, or anchored at a start from which the motion has turned the nodes."""
    body = block((5, 3, 3), dx=DX, per_cell=1.5, clamped=False, margin=4, jitter=0.2)
    planes = [Plane((0.1, 0.05, 1.0), 0.0031, friction=0.3), Plane((0.0, 1.0, 0.1), 0.0027, "separate" if anchored else "slip", 0.2)]
    handle = None if anchored else Handle((0.0731, -1.0, -1.0), (1.0, 1.0, 1.0))
    options = {"planes": planes, "handle": handle, "gravity": (0, 0, -G), "memory_budget_mb": budget_mb, "anchored": anchored}
    sim = simulator(body, substeps=substeps, period_s=substeps * 4e-4, **options)
    rng, count = np.random.default_rng(1), len(sim.volume)
    draw = lambda *shape: sim.tensor(rng.normal(size=shape))  # noqa: E731
    sink = sim.tensor([0.4, -0.2, -0.2])
    state = sim.rest(v=sink + 0.2 * draw(count, 3), C=2 * draw(count, 3, 3), F=torch.eye(3) + 0.03 * draw(count, 3, 3))
    inputs = {
        "state": state.data,
        "young": sim.tensor(rng.uniform(5e4, 2e5, count)),
        "poisson": sim.tensor(rng.uniform(0.2, 0.4, count)),
        "force": 3000 * draw(count, 3),
        "mass_damping": sim.tensor(0.7),
        "friction": sim.tensor([0.3, 0.2]),
        "twist": draw(6) * sim.tensor([10, 10, 10, 0.3, 0.3, 0.3]) * substeps * 4e-4,
    }
    if anchored:
        del inputs["twist"]
        lean = sim.tensor([[0.0, 0.1, 0.05], [-0.1, 0.0, 0.1], [-0.05, -0.1, 0.0]])
        inputs["anchor"] = sim.rest(x=sim.x_rest @ (torch.eye(3) + lean), F=torch.eye(3) + lean + 0.03 * draw(count, 3, 3)).data
    scale = sim.tensor(np.repeat([100.0, 1.0, 0.01, 1.0], [3, 3, 9, 9]))
    return Case(sim, {k: v.clone().requires_grad_() for k, v in inputs.items()}, draw(count, 24) * scale)


def relative_error(given: Case, name: str) -> float:
    """Of the gradient along a random direction against the best of three central differences."""
    value = given.inputs[name].detach()
    size = value.abs().mean(0) if name in ("state", "anchor") else value.abs().mean()
    step = given.sim.tensor(np.random.default_rng(2).normal(size=value.shape)) * size
    (gradient,) = torch.autograd.grad(given.loss(given.inputs), given.inputs[name])
    exact, errors = float((gradient * step).sum()), []
    for size in (1e-4, 1e-5, 1e-6):
        with torch.no_grad():
            up, down = (float(given.loss({**given.inputs, name: value + sign * size * step})) for sign in (1, -1))
        errors.append(abs((up - down) / (2 * size) - exact) / abs(exact))
    return min(errors)


@pytest.mark.parametrize("name", ["state", "young", "force", "mass_damping", "friction", "twist"])
@pytest.mark.parametrize("substeps", [1, 50])
def test_gradients_through_planes_and_handle_equal_central_differences(substeps, name):
    assert relative_error(case(substeps), name) < 1e-5


@pytest.mark.parametrize("name", ["state", "anchor", "young", "force", "mass_damping", "friction"])
@pytest.mark.parametrize("substeps", [1, 50])
def test_gradients_of_anchored_particles_through_planes_equal_central_differences(substeps, name):
    assert relative_error(case(substeps, anchored=True), name) < 1e-5


@ANCHORED
def test_kept_frames_and_replays_give_the_same_gradient_through_borders(anchored):
    gradients, plans = [], []
    for budget in (64.0, 0.0):
        given = case(11, budget_mb=budget, anchored=anchored)
        gradients.append(torch.autograd.grad(given.loss(given.inputs), list(given.inputs.values())))
        plans.append((given.sim.replay.plan.keep_velocity, given.sim.replay.plan.marks > 0))
    assert plans == [(True, False), (False, True)]
    assert all(torch.equal(a, b) for a, b in zip(*gradients, strict=True))


@ANCHORED
@pytest.mark.parametrize("budget_mb", [64.0, 0.0])
def test_one_launch_a_frame_and_one_launch_a_kernel_give_the_same_at_borders(budget_mb, anchored, monkeypatch):
    results = []
    for program in (Serial, Parallel):
        monkeypatch.setitem(PROGRAMS, "cpu", program)
        given = case(5, budget_mb=budget_mb, anchored=anchored)
        results.append([given.after(given.inputs), *torch.autograd.grad(given.loss(given.inputs), list(given.inputs.values()))])
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_paths_and_frictions_need_handles_and_planes():
    body = block((3, 2, 2), dx=DX)
    plain = simulator(body, substeps=5, period_s=PERIOD_S)
    held = simulator(body, substeps=5, period_s=PERIOD_S, handle=ROOT)
    with pytest.raises(InputError, match="give the simulator a handle"):
        roll(plain, 2, handle_poses=turning(2, 1.0))
    with pytest.raises(InputError, match="give one pose a frame"):
        roll(held, 3, handle_poses=turning(2, 1.0))
    with pytest.raises(InputError, match="for 0 planes; give one coefficient a plane"):
        roll(held, 2, friction=torch.tensor([0.3]))


def solved(function, guess: float, *, steps: int = 6) -> float:
    """Root of a function of a tensor, by Newton's method with its gradient."""
    value = torch.tensor(guess, dtype=torch.float64)
    for _ in range(steps):
        value.requires_grad_()
        miss = function(value)
        (slope,) = torch.autograd.grad(miss, value)
        value = (value - miss / slope).detach()
    return float(value)


def test_friction_is_recovered_from_how_far_a_block_slid():
    sim, down, _ = tilted(30, 0.0)

    def slid(friction: Tensor) -> Tensor:
        path = sim.rollout(sim.rest(), full(sim, 2e5), full(sim, 0.3), torch.zeros(6, *sim.x_rest.shape), 0.0, friction=friction.reshape(1))
        return mean(sim, path.x[-1] - path.x[0]) @ down

    seen = slid(torch.tensor(0.27, dtype=torch.float64)).detach()
    assert solved(lambda friction: slid(friction) - seen, 0.1) == pytest.approx(0.27, rel=1e-3)


def test_stiffness_is_recovered_from_a_beam_that_a_handle_shook():
    sim = simulator(block((8, 2, 2), dx=DX, clamped=False, margin=4), substeps=45, period_s=PERIOD_S, handle=ROOT)
    poses = torch.eye(4, dtype=torch.float64).repeat(7, 1, 1)
    poses[:, 2, 3] = 0.3 * DX * torch.tensor([0.0, 0.5, 1.0, 1.0, 0.5, 0.0, -0.5])

    def tip(log_young: Tensor) -> Tensor:
        young = full(sim, 1.0) * log_young.exp()
        path = sim.rollout(sim.rest(), young, full(sim, 0.3), torch.zeros(6, *sim.x_rest.shape), 0.0, handle_poses=poses)
        return path.x[-1, sim.x_rest[:, 0] > 7 * DX, 2].mean()

    seen = tip(torch.tensor(math.log(6e4), dtype=torch.float64)).detach()
    assert math.exp(solved(lambda log_young: tip(log_young) - seen, math.log(4.5e4))) == pytest.approx(6e4, rel=1e-3)


def test_simulations_of_a_batch_have_floors_of_their_own_friction_and_handles_of_their_own_path():
    friction = torch.tensor([[0.1], [0.4]], dtype=torch.float64, requires_grad=True)
    poses = torch.stack([turning(3, 1.0), turning(3, -2.0)]).requires_grad_()
    weight = torch.from_numpy(np.random.default_rng(4).normal(size=(4, 4 * 2 * 2 * 8, 3)))

    def run(batch: int | None, rubbing: Tensor, path: Tensor) -> tuple[Tensor, ...]:
        body = block((4, 2, 2), dx=DX, clamped=False, margin=4)
        options = {"planes": [Plane((0, 0, 1), 0.0)], "handle": ROOT, "gravity": (1.0, 0, -G), "batch": batch}
        sim = simulator(body, substeps=20, period_s=PERIOD_S, **options)
        force = torch.zeros(3, *sim.x_rest.shape)
        x = sim.rollout(sim.rest(), full(sim, 5e4), full(sim, 0.3), force, 0.0, friction=rubbing, handle_poses=path).x
        loss = (x * (weight if batch is None else weight[:, None])).sum()
        return x, *torch.autograd.grad(loss, (rubbing, path))

    x, along_friction, along_path = run(2, friction, poses)
    for k in range(2):
        alone = run(None, friction[k].detach().requires_grad_(), poses[k].detach().requires_grad_())
        for mine, own in zip((x[:, k], along_friction[k], along_path[k]), alone, strict=True):
            torch.testing.assert_close(mine, own, rtol=1e-12, atol=1e-14)
    assert not torch.equal(x[:, 0], x[:, 1])
