"""Fields of many parameters in the fit: on a bar whose material and force are known."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator

import numpy as np
import pytest
import torch

from diffphys_ros import result
from diffphys_ros.config import build, leaves
from diffphys_ros.fields import FORCE_FIELDS, MATERIAL_FIELDS
from diffphys_ros.inverse import Checkpoint, Clock, solve
from diffphys_ros.inverse.fit import fit
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.problem import Problem, pose_problem
from diffphys_ros.inverse.stages.fields import fields
from diffphys_ros.inverse.zones import zones_of
from diffphys_ros.resimulate import simulate_again
from diffphys_ros.types import MaterialPrior
from tests.coarse import coarse_elements

from .conftest import YOUNG, as_one_part
from .test_solve import drive, with_young

FORCE_ITERATIONS, MATERIAL_ITERATIONS = 14, 24  # that suffice
ITERATIONS = 12  # of what is compared bit by bit: with fewer linear modes explain the clip as well


def settings(**words):
    names = {name.partition(".")[2]: name for name in leaves() if name.startswith(("fit.", "experiment."))}
    return build({"scene.at_rest": True, "experiment.cells": 3, "experiment.per_cell": 1.0, "fit.iterations": 2} | {names[k]: v for k, v in words.items()})


def with_force(prepared: Prepared, share: float) -> Prepared:
    """The same clip, its start with a share of the true force."""
    return dataclasses.replace(prepared, start=dataclasses.replace(prepared.start, force=share * prepared.start.force))


@pytest.fixture(scope="module", autouse=True)
def coarse(prepared) -> Iterator[None]:
    """For the zones, which are sought twice; the bar that all tests of the solver share has its modes already."""
    with coarse_elements():
        yield


@pytest.fixture(scope="module")
def one_part(prepared) -> Prepared:
    return as_one_part(prepared, 0.4)


@pytest.fixture(scope="module")
def posed(prepared) -> Problem:
    """Whatever fields are asked for: they begin where its search ended."""
    return pose_problem(prepared, None, settings(material_field="residual"))


@pytest.fixture(scope="module")
def constants(posed) -> float:
    """Loss of constants per part and vectors per frame at the start values."""
    with torch.no_grad():
        return Model(posed)().value


@pytest.fixture(scope="module")
def exact(prepared) -> Problem:
    """In double precision."""
    return pose_problem(prepared, None, settings(material_field="residual"), dtype=torch.float64)


@pytest.fixture(scope="module")
def unforced(prepared) -> Problem:
    """Its start knows next to nothing of the gust."""
    return pose_problem(with_force(prepared, 0.01), None, settings(material_field="residual"))


def asking(problem: Problem, **words) -> Problem:
    """The same problem with other words for its fields."""
    return dataclasses.replace(problem, settings=settings(**words))


def with_fields(problem: Problem, shift: float = 0.0) -> Model:
    """At the start values, or beside them, with fields that know nothing yet."""
    model = Model(problem, problem.layout.start + shift)
    model.begin_fields()
    return model


def trained(problem: Problem):
    """News, the model after the stages of the fields, and its terms."""
    news, found = drive(fit(Model(problem), fields(problem), checkpoint=Checkpoint(None), clock=Clock()))
    with torch.no_grad():
        return news, found.model, found.model()


def change_spread(problem: Problem, model: Model) -> float:
    """Standard deviation of the change of log10 E over the particles."""
    with torch.no_grad():
        ratio = (model.material(model.x).young / model.start.young).log10()
    return float(ratio[problem.disc.particles.own].std())


def test_the_words_of_the_settings_are_the_fields() -> None:
    assert set(leaves()["fit.material_field"].choices) == set(MATERIAL_FIELDS)
    assert set(leaves()["fit.force_field"].choices) == set(FORCE_FIELDS)


@pytest.mark.parametrize("word", FORCE_FIELDS)
def test_every_force_field_finds_the_gust_from_next_to_nothing_and_leaves_the_material_alone(prepared, unforced, word: str) -> None:
    problem = asking(unforced, force_field=word, material_field="residual", field_iterations=FORCE_ITERATIONS)
    news, model, terms = trained(problem)
    p, motion = problem.disc.particles, terms.motion
    assert terms.parts["track"] < 0.1 * news[0].loss
    net = np.einsum("tpc,p->tc", motion.field_force.numpy().astype(float)[:, p.own], p.volume[p.own])
    true = prepared.start.force[:-1]
    assert (net * true).sum() / np.linalg.norm(net) / np.linalg.norm(true) > 0.85
    assert np.linalg.norm(net) / (np.linalg.norm(true) * p.volume[p.own].sum()) == pytest.approx(0.9, abs=0.25)
    assert change_spread(problem, model) < 0.05
    assert not motion.field_force.numpy()[~prepared.start.forced[:-1]].any()


@pytest.mark.parametrize("word", ["residual", "triplane"])
def test_a_material_field_finds_the_stiffer_root_that_one_constant_cannot_hold(one_part, word: str) -> None:
    problem = pose_problem(one_part, None, settings(material_field=word, field_iterations=MATERIAL_ITERATIONS, per_cell=1.5))
    constant = Model(problem)().parts["track"]
    _, _, terms = trained(problem)
    x, young = problem.disc.particles.x_rest[:, 0], terms.motion.young.numpy()
    root, rest = young[(x > 0) & (x < 0.08)].mean(), young[(x > 0.12) & (x < 0.25)].mean()
    assert terms.parts["track"] < 0.5 * constant
    assert 1.08 < root / rest < 2 * YOUNG[0] / YOUNG[1]


@pytest.mark.parametrize("word", FORCE_FIELDS)
@pytest.mark.parametrize(("material", "where"), [("part", "rest"), ("residual", "rest"), ("residual", "current")])
def test_untrained_fields_cost_what_the_search_ended_with(posed, constants, word: str, material: str, where: str) -> None:
    model = with_fields(asking(posed, force_field=word, material_field=material, force_frame=where))
    with torch.no_grad():
        assert model().value == pytest.approx(constants, rel=1e-5)


@pytest.mark.parametrize("where", ["rest", "current"])
def test_gradients_of_both_fields_through_the_simulation_match_central_differences(exact, where: str) -> None:
    model = with_fields(asking(exact, force_field="voxels", material_field="residual", force_frame=where), 0.02)
    noise = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for parameter in [*model.material.parameters(), *model.force.parameters()]:
            parameter += 0.05 * torch.randn(parameter.shape, generator=noise, dtype=torch.float64)
    biases = [model.material.young.layers[-1].bias, model.material.poisson.layers[-1].bias, model.force.decoder.layers[-1].bias, model.blocks["damping"]]
    gradients = torch.autograd.grad(model().total, biases)
    for parameter, gradient in zip(biases, gradients, strict=True):
        values = []
        for step in (1e-4, -2e-4):
            with torch.no_grad():
                parameter.view(-1)[-1] += step
                values.append(model().value)
        with torch.no_grad():
            parameter.view(-1)[-1] += 1e-4
        assert float(gradient.view(-1)[-1]) == pytest.approx((values[0] - values[1]) / 2e-4, rel=2e-3, abs=1e-9)


def roughened(problem: Problem) -> Model:
    """Voxels that differ strongly from place to place and push hard."""
    model = with_fields(problem)
    noise = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in model.force.parameters():
            parameter += 0.4 * torch.randn(parameter.shape, generator=noise, dtype=torch.float64)
    return model


def test_a_force_that_stays_in_space_is_that_of_where_each_particle_is_when_the_frame_starts(prepared, exact) -> None:
    problem = asking(exact, force_field="voxels", force_frame="current")
    model = roughened(problem)
    with torch.no_grad():
        motion = model().motion
        for k in (0, 3, 4):
            expected = model.force(motion.x[k], torch.tensor([k]))[0] * float(prepared.start.forced[k])
            torch.testing.assert_close(motion.field_force[k], expected, rtol=0, atol=0)
        at_rest = model.force(motion.x[0], torch.tensor([4]))[0]
    assert float((motion.field_force[4] - at_rest).norm() / at_rest.norm()) > 0.02


def test_the_gradient_of_a_force_that_stays_in_space_passes_through_where_the_body_is(exact) -> None:
    """Stiffness moves the body, and so decides which voxels push it."""
    problem = asking(exact, force_field="voxels", material_field="residual", force_frame="current")
    model = roughened(problem)
    bias = model.material.young.layers[-1].bias
    (gradient,) = torch.autograd.grad(model().total, bias)
    assert float(gradient) == pytest.approx(central_difference(model, bias), rel=1e-5)
    places = model().motion.x.detach()
    model._force_at = lambda x, k: model.force(places[k], model.frames[k : k + 1])[0] * model.allowed[k]  # does not know that it moves
    assert abs(float(gradient) - central_difference(model, bias)) > 1e-3 * abs(float(gradient))


def central_difference(model: Model, bias: torch.Tensor, step: float = 2e-4) -> float:
    values = []
    with torch.no_grad():
        for move in (step, -2 * step):
            bias += move
            values.append(model().value)
        bias += step
    return (values[0] - values[1]) / (2 * step)


def test_the_loss_never_rises_and_the_fields_are_those_of_the_last_step(one_part) -> None:
    problem = pose_problem(one_part, None, settings(material_field="residual", force_field="modes", field_iterations=5))
    news, _, terms = trained(problem)
    losses = [n.loss for n in news]
    assert losses == sorted(losses, reverse=True)
    assert terms.value == pytest.approx(losses[-1], rel=1e-6)


@pytest.fixture(scope="module")
def zoned(one_part) -> Prepared:
    """With the zones that solve would find."""
    return dataclasses.replace(one_part, zones=drive(zones_of(one_part, settings(material_field="residual")))[1])


@pytest.fixture(scope="module")
def answer(zoned):
    return drive(solve(zoned, None, settings(material_field="residual", force_field="modes", field_iterations=ITERATIONS)))


def test_the_answer_holds_a_modulus_and_a_force_of_every_particle(answer) -> None:
    news, recovery = answer
    assert len({n.iteration for n in news if n.stage == "fields"}) == ITERATIONS
    assert recovery.metrics["refined"]
    assert np.ptp(recovery.young) > 100
    np.testing.assert_allclose(recovery.young, recovery.young_solver * recovery.apparent_stiffness, rtol=1e-6)
    assert np.ptp(recovery.poisson) > 0
    assert np.ptp(recovery.force[2, :, 1]) > 0
    assert json.loads(json.dumps(recovery.metrics["fields"]))["force_field"] == "modes"


def test_the_answer_is_simulated_again_from_its_file_with_the_field_that_was_simulated(answer, zoned, tmp_path) -> None:
    """Also where zones stood for the parts that it speaks of."""
    result.save(answer[1], zoned.clip, build({}), tmp_path)
    stored = result.load(tmp_path)
    assert set(stored.part) == {1}
    np.testing.assert_array_equal(simulate_again(with_young(stored, stored.young_solver)), stored.trajectory)
    assert np.abs(simulate_again(with_young(stored, stored.young)) - stored.trajectory).max() > 1e-5


def test_two_runs_with_fields_are_equal_to_the_bit(answer, one_part) -> None:
    """The second finds the zones by itself."""
    _, again = drive(solve(one_part, None, settings(material_field="residual", force_field="modes", field_iterations=ITERATIONS)))
    for name in ("young", "poisson", "force", "trajectory"):
        np.testing.assert_array_equal(getattr(again, name), getattr(answer[1], name))


@pytest.mark.parametrize("stop", [0, 1, 5])
def test_training_that_was_interrupted_goes_on_to_the_same_answer_to_the_bit(answer, zoned, tmp_path, stop: int) -> None:
    """In the warm-up of the force, at its end, and after it."""
    words = settings(material_field="residual", force_field="modes", field_iterations=ITERATIONS)
    steps = solve(zoned, None, words, checkpoint=Checkpoint(tmp_path / "c.npz", every_s=1e9))
    while (news := next(steps)).stage != "fields" or news.iteration < stop:
        pass
    steps.close()
    news, resumed = drive(solve(zoned, None, words, checkpoint=Checkpoint(tmp_path / "c.npz", resume=True)))
    assert [n.iteration for n in news if n.stage == "fields"] == list(range(stop + 1, ITERATIONS))
    for name in ("young", "poisson", "force", "trajectory"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(answer[1], name))
    assert resumed.metrics["fields"]["loss_history"] == answer[1].metrics["fields"]["loss_history"]


def test_without_words_for_fields_nothing_is_trained(prepared) -> None:
    news, recovery = drive(solve(prepared, None, settings()))
    assert "fields" not in recovery.metrics
    assert "fields" not in {n.stage for n in news}
    assert len(np.unique(recovery.young)) == 2


def test_the_prior_s_pattern_inside_a_part_is_where_its_field_starts_and_the_part_keeps_its_level(one_part) -> None:
    left_half = (np.arange(160) < 80)[None].repeat(120, 0)
    prior = MaterialPrior(
        np.where(left_half, 0, 1).astype(np.int16), ("a", "b"), np.array([4e8, 1e8]), np.full(2, 0.3), np.full(2, 0.3), np.full(2, 600.0), "test"
    )
    problem = pose_problem(dataclasses.replace(one_part, prior=prior), None, settings(material_field="residual"))
    with torch.no_grad():
        young = with_fields(problem).material(problem.forward.simulator.x_rest).young.numpy()
    assert young.max() / young.min() == pytest.approx(4.0, rel=1e-4)
    level = np.average(np.log(young), weights=problem.disc.particles.volume)
    assert level == pytest.approx(np.log(problem.layout.young[0]), abs=1e-4)
