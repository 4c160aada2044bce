"""The published schedule, on a bar that pictures alone tell of: force on the grid's nodes, frame by frame, then both fields over the clip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from diffphys_ros import result
from diffphys_ros.config import layered
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import Checkpoint, solve
from diffphys_ros.inverse.answer import linear_answer
from diffphys_ros.inverse.carried import CarriedGaussians
from diffphys_ros.inverse.clock import Clock
from diffphys_ros.inverse.fit import fit
from diffphys_ros.inverse.material_prior import of_parts
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.prescribed import prescribed, told_by
from diffphys_ros.inverse.problem import Problem, pose_problem
from diffphys_ros.inverse.published import MOST_STRAIN, as_published
from diffphys_ros.inverse.stages import schedule
from diffphys_ros.inverse.transitions import Walk, held_share, transitions
from diffphys_ros.prior import material_prior
from diffphys_ros.resimulate import simulate_again
from diffphys_ros.types import Splats

from .conftest import make_camera, make_prepared
from .test_solve import drive

FILE = Path(__file__).parents[2] / "config" / "paper.yaml"
FRAMES = 7
QUICK = {"experiment.grid_nodes": None, "experiment.cells": 3, "experiment.per_cell": 1.0, "experiment.transition_iterations": 15, "experiment.field_iterations": 4, "experiment.force_voxels": 6}


def settings(**words):
    return layered([FILE], QUICK | {name.replace("__", "."): value for name, value in words.items()})


def speckled() -> Splats:
    """Discs of random colours on the front of the bar, so small that none covers another: which of two is nearer would be chance."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.linspace(0.005, 0.295, 30), np.linspace(-0.045, 0.045, 10), indexing="ij")
    mean = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.05)], -1).astype(np.float32)
    count, upright = len(mean), np.array([1, 0, 0, 0], np.float32)
    scale = np.tile(np.array([0.0032, 0.0032, 0.0006], np.float32), (count, 1))
    return Splats(mean, np.tile(upright, (count, 1)), scale, np.full(count, 0.95, np.float32), rng.uniform(0, 1, (count, 3)).astype(np.float32))


@pytest.fixture(scope="module")
def filmed(prepared: Prepared) -> Prepared:
    """The first frames of the bar's motion as pictures; what tracks and start values say of it is there, and must not be used."""
    clip, start, tracks = prepared.clip, prepared.start, prepared.tracks
    disc = pose_problem(prepared, None, settings(experiment__schedule="linear", experiment__force_frame="rest", fit__hold=["density"])).disc
    shown = CarriedGaussians.of(speckled(), disc.particles.x_rest, make_camera(), np.full((120, 160, 3), 90, np.uint8), device="cpu")
    moved = disc.particles.x_rest + linear_answer(prepared, disc).displacement
    frames = shown.clip(moved[:FRAMES])
    labels = (np.abs(frames.astype(int) - 90).max(-1) > 8).astype(np.uint8)
    clip = replace(clip, frames=frames, labels=labels)
    start = replace(start, forced=start.forced[:FRAMES], force=start.force[:FRAMES])
    tracks = replace(tracks, pixels=tracks.pixels[:FRAMES], points=tracks.points[:FRAMES], valid=tracks.valid[:FRAMES])
    found = replace(prepared, clip=clip, start=start, tracks=tracks)
    return replace(found, prior=material_prior(clip, settings()))


def posed(filmed: Prepared, **words) -> Problem:
    asked = settings(**words)
    return pose_problem(as_published(filmed, asked), speckled(), asked)


@pytest.fixture(scope="module")
def problem(filmed: Prepared) -> Problem:
    return posed(filmed)


@pytest.fixture(scope="module")
def recovery(filmed: Prepared):
    return drive(solve(filmed, speckled(), settings()))[1]


def test_forces_act_on_nodes_and_the_gradient_to_them_agrees_with_finite_differences(filmed: Prepared) -> None:
    asked = settings()
    problem = pose_problem(as_published(filmed, asked), speckled(), asked, dtype=torch.float64)
    forward, model = problem.forward, Model(problem)
    model.begin_fields()
    unknowns = problem.layout.unpack(model.z.detach(), modes=forward.basis.shape[2])
    material = tuple(value.detach() for value in model.material(model.x))
    start, generator = forward.start_of(unknowns, *material), torch.Generator().manual_seed(0)
    force = 300 * torch.randn(2, len(forward.nodes.number), 3, dtype=torch.float64, generator=generator)
    weight, along = torch.randn(start.x.shape, dtype=torch.float64, generator=generator), torch.randn(force.shape, dtype=torch.float64, generator=generator)

    def seen(force: torch.Tensor) -> torch.Tensor:
        return (forward.advance(start, start, unknowns, *material, force, 0)[-1].x * weight).sum()

    slope = torch.autograd.grad(seen(leaf := force.clone().requires_grad_(True)), leaf)[0]
    step = 1e-2
    with torch.no_grad():
        difference = (seen(force + step * along) - seen(force - step * along)) / (2 * step)
    assert float((slope * along).sum()) == pytest.approx(float(difference), rel=1e-5)
    even = forward.at_particles(torch.ones_like(force))
    inside = problem.disc.particles.x_rest[:, 0] > 0.1  # beyond the nodes that the clamp holds
    np.testing.assert_allclose(even[:, inside], 1.0, atol=1e-12)  # a uniform density is the same on nodes and particles


def test_e_begins_no_softer_than_what_carries_the_weight_of_what_hangs() -> None:
    """By 30 times the earth's gravity the soft end of what is believed would be strained several times its length."""
    hangs = make_prepared(gravity=(300.0, 0.0, 0.0))
    hangs = replace(hangs, prior=material_prior(hangs.clip, settings()))
    belief = of_parts(hangs.prior, hangs.body, hangs.clip.camera)
    soft = belief.young * 10 ** (-2 * belief.log10_young_sd)
    assert hangs.modal.strain_by_weight(soft) > 2
    started = as_published(hangs, settings())
    np.testing.assert_allclose(started.start.young / soft, hangs.modal.strain_by_weight(soft) / MOST_STRAIN)
    forward = pose_problem(started, None, settings()).forward
    strain = 0.5 * (forward.disc.sag_gradient + np.swapaxes(forward.disc.sag_gradient, 1, 2))
    assert 0.2 < np.abs(np.linalg.eigvalsh(strain)).max() < 1
    z = torch.as_tensor(forward.layout.start, dtype=forward.dtype)
    unknowns = forward.layout.unpack(z, modes=forward.basis.shape[2])
    state = forward.start_of(unknowns, unknowns.young[forward.part], forward.poisson)
    assert float(torch.linalg.det(state.F).min()) > 0
    lying = replace(hangs, body=replace(hangs.body, gravity=np.zeros(3)))
    np.testing.assert_allclose(as_published(lying, settings()).start.young, soft)


def test_frame_by_frame_lowers_the_loss_of_pictures_alone(problem: Problem) -> None:
    model, stages = Model(problem), schedule(problem)
    assert [stage.name for stage in stages] == ["frames", "fields", "fields"]
    assert stages[0].free == ("force_field",)
    fitted = drive(fit(model, stages[:1], checkpoint=Checkpoint(None), clock=Clock()))[1]
    assert len(fitted.losses["frames"]) == FRAMES - 1
    with torch.no_grad():
        terms = model()
    assert set(terms.parts) - {"prior", "fields", "track", "depth"} == {"image"}
    assert terms.parts["track"] == terms.parts["depth"] == 0.0
    assert terms.parts["image"] < 0.25  # 0.5 is that of a body that stands still
    np.testing.assert_array_equal(model.material(model.x).young.detach(), model.start.young)  # which the material had no part in


def test_over_the_whole_clip_the_loss_is_lowered_on_from_where_frame_by_frame_ended(filmed: Prepared) -> None:
    """Not by Adam: its steps of one size found nothing lower in 40 iterations."""
    problem = posed(filmed, experiment__transition_iterations=2, experiment__field_iterations=8)
    model, stages = Model(problem), schedule(problem)
    fitted = drive(fit(model, stages, checkpoint=Checkpoint(None), clock=Clock()))[1]
    losses = fitted.losses["fields"]
    assert len(losses) <= 8
    assert losses[-1] < 0.9 * losses[0]


def test_the_file_runs_end_to_end_and_claims_no_stiffness(filmed: Prepared, recovery) -> None:
    assert recovery.simulation.engine == "mpm"
    assert not recovery.identified.any()
    assert not recovery.force_identified
    assert "explains the video" in recovery.reasons[0]
    assert recovery.metrics["refined"]
    assert recovery.metrics["loss"]["image"] < 0.25  # 0.5 is that of a body that stands still
    assert recovery.simulation.node_force.shape[1:] == (len(recovery.simulation.node), 3)


def test_a_motion_by_forces_on_nodes_is_had_again_from_the_result_to_the_bit(filmed: Prepared, recovery, tmp_path: Path) -> None:
    result.save(recovery, filmed.clip, settings(), tmp_path)
    np.testing.assert_array_equal(simulate_again(tmp_path), recovery.trajectory)
    assert np.isfinite(simulate_again(recovery, force_scale=1.2, free_frames=2)).all()  # in a roomier grid


@pytest.mark.parametrize(("held", "free"), [("force", ("material_field",)), ("young", ("force_field",))])
def test_what_is_held_leaves_force_only_or_material_only(filmed: Prepared, held: str, free: tuple[str, ...]) -> None:
    problem = posed(filmed, fit__hold=["density", "damping", held])
    assert {stage.free for stage in schedule(problem)} == {free}


def test_the_scene_behind_is_read_from_the_clip_where_it_is_not_given(filmed: Prepared, problem: Problem) -> None:
    asked, given = settings(), np.full((120, 160, 3), 51, np.uint8)
    told = pose_problem(as_published(filmed, asked), speckled(), asked, behind=given)
    assert (told.renderer.background == 0.2).all()
    assert float(problem.renderer.background[0, 0, 0]) == pytest.approx(90 / 255)


def test_the_force_is_sought_on_a_body_as_soft_as_the_prior_allows(filmed: Prepared) -> None:
    believed, soft = (as_published(filmed, settings(experiment__soft_sd=sd)).start for sd in (0.0, 2.0))
    np.testing.assert_allclose(np.log10(believed.young / soft.young), 2 * believed.log10_young_sd)
    held = as_published(filmed, settings(experiment__soft_sd=0.0, fit__hold=["density", "damping", "young"])).start
    np.testing.assert_array_equal(held.young, believed.young)  # force only: at the prior's material, not at what tracks say


def test_a_force_that_is_sought_is_braked_by_the_drag_of_a_frame_and_a_told_one_is_not(filmed: Prepared) -> None:
    period, own = filmed.clip.period_s, filmed.start.damping.mass_per_s
    sought, told = (as_published(filmed, settings(experiment__frame_drag=1.5, fit__hold=["density", *held])).start for held in (["damping"], ["damping", "force"]))
    assert sought.damping.mass_per_s == pytest.approx(own + 1.5 / period)
    assert told.damping.mass_per_s == own


def test_what_swings_out_of_the_mask_costs_and_the_unit_is_the_frozen_frame(filmed: Prepared, problem: Problem) -> None:
    term = problem.objective.evidence["pixels"].term
    assert (term.mask == term.mask[0]).all()
    x = problem.forward.simulator.x_rest[None].expand(FRAMES, -1, -1)
    still = term(x, torch.eye(3).expand(*x.shape[:2], 3, 3), 1.0)[0]
    assert float(still) == pytest.approx(0.5, rel=1e-4)  # however many pixels the body moves


@pytest.mark.parametrize("drag", [0.0, 0.5, 2.0, 8.0])
def test_the_share_of_a_force_that_takes_its_velocity_back_is_that_of_a_free_body(drag: float) -> None:
    share, place, velocity, steps, ends = held_share(drag), 0.0, 0.0, 20_000, []
    for force in (1.0, -share):
        for _ in range(steps):
            velocity += (force - drag * velocity) / steps
            place += velocity / steps
        ends.append(place)
    assert ends[1] == pytest.approx(ends[0], rel=1e-3)


def test_a_search_begins_with_the_share_of_the_last_force_that_shows_the_next_picture_best(problem: Problem) -> None:
    model = Model(problem)
    model.enter(schedule(problem)[0])
    walk, held = Walk(model, Clock()), held_share(problem.settings.experiment.frame_drag)
    with torch.no_grad():
        walk.field.features[0] = 1.0
    for share in (1.0, 1 - held, 0.0, -held):
        walk._loss = lambda features, frame, block_px=1, share=share: (features - share).square().sum()  # type: ignore[method-assign]
        assert walk._guess(1).mean().item() == pytest.approx(share)


def test_a_held_force_is_the_told_one_and_acts_on_nodes(filmed: Prepared) -> None:
    problem = posed(filmed, fit__hold=["density", "damping", "force"])
    with torch.no_grad():
        motion = Model(problem)().motion
    told = filmed.start.force[:-1, 1]
    assert motion.node_force[..., 1].abs().max().item() == pytest.approx(np.abs(told).max(), rel=1e-5)


def test_a_held_force_that_an_earlier_result_tells_on_nodes_acts_there_again_and_repeats_its_motion(filmed: Prepared, tmp_path: Path) -> None:
    quick = {"experiment__transition_iterations": 5, "experiment__field_iterations": 1}  # the second ends where it begins
    earlier = drive(solve(filmed, speckled(), settings(fit__hold=["density", "damping", "young"], **quick)))[1]
    result.save(earlier, filmed.clip, settings(), tmp_path)
    told = {"fit__hold": ["density", "damping", "force"], "fit__prescribe": str(tmp_path)}
    again = drive(solve(filmed, speckled(), settings(**told, **quick)))[1]
    moved = np.abs(earlier.trajectory - earlier.trajectory[0]).max()
    assert np.abs(earlier.simulation.node_force).max() > 10 * np.abs(earlier.simulation.node_force.mean(1)).max()  # no uniform force
    np.testing.assert_allclose(again.simulation.node_force, earlier.simulation.node_force, rtol=1e-6)
    np.testing.assert_allclose(again.trajectory, earlier.trajectory, atol=1e-4 * moved)
    assert again.metrics["psnr_masked"] == pytest.approx(earlier.metrics["psnr_masked"], abs=0.01)
    with pytest.raises(InputError, match=r"its force acts on nodes of another grid or body .* mm apart; here \d+ of"):
        drive(solve(filmed, speckled(), settings(**told, **quick | {"experiment__cells": 4})))


def test_of_a_told_force_on_nodes_only_the_net_force_acts_where_forces_act_on_particles_and_that_is_said(filmed: Prepared, recovery, tmp_path: Path) -> None:
    result.save(recovery, filmed.clip, settings(), tmp_path)
    asked = settings(fit__hold=["density", "damping", "force"], fit__prescribe=str(tmp_path), experiment__force_frame="rest")
    found = prescribed(filmed, asked, told_by(asked))
    assert "the net force of each frame alone is taken, as that of a uniform force" in found.clip.notes[-1]
    assert np.abs(found.start.force).max() > 0


def test_what_cannot_be_asked_for_is_refused(filmed: Prepared) -> None:
    with pytest.raises(InputError, match="one of them must be sought"):
        schedule(posed(filmed, fit__hold=["density", "force", "young"]))
    with pytest.raises(InputError, match="choose the schedule paper"):
        posed(filmed, experiment__schedule="joint")
    with pytest.raises(InputError, match="knows pictures alone"):
        schedule(posed(filmed, experiment__image_weight=0.0, experiment__track_weight=1.0))


def test_planes_over_x_y_and_time_are_sought_over_the_whole_clip(filmed: Prepared) -> None:
    problem = posed(filmed, fit__force_field="planes", experiment__field_iterations=2)
    model, stages = Model(problem), schedule(problem)
    assert {stage.way for stage in stages} == {"lbfgs"}
    fitted = drive(fit(model, stages, checkpoint=Checkpoint(None), clock=Clock()))[1]
    assert np.isfinite(fitted.value)


def test_a_walk_goes_on_from_a_checkpoint_as_if_it_had_not_stopped(filmed: Prepared) -> None:
    problem, ends = posed(filmed, experiment__transition_iterations=2), []
    for stop in (None, 2):
        model = Model(problem)
        model.begin_fields()
        space, state = model.space(("force_field",)), None
        for state in transitions(model, space, None, Clock()):
            if state.iteration == stop:
                break
        if stop:
            other = Model(problem)
            other.begin_fields()
            space = other.space(("force_field",))
            space.assign(state.at)
            *_, state = transitions(other, space, state, Clock())
        ends.append(state)
    np.testing.assert_array_equal(ends[0].at, ends[1].at)
    assert ends[0].value == pytest.approx(ends[1].value)
