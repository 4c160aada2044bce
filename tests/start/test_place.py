"""Where a force acts: a wind is given up for a small place alone, and what is open of a place is as large as what is found wrong of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.footprints import Footprint
from diffphys_ros.modes import ModalModel
from diffphys_ros.start import place
from diffphys_ros.start.force import CENTRES, ForceProblem
from diffphys_ros.start.free_tail import Physics
from diffphys_ros.start.net_force import largest, net_force_doubt
from diffphys_ros.start.stages import Fit
from diffphys_ros.types import Body
from tests.made_bar import BETA, FRAMES, PERIOD_S, YOUNG, alike_errors, bar, gust, modes_of, moved, tracks, true_fit

PHYSICS = Physics(YOUNG, Damping(0.0, BETA), np.zeros(0))
MISSED = 0.005  # of the motion, alike over a quarter period
MODES = 4  # that are missed


def pushed(body: Body, modal: ModalModel, seed: int, *, widths: tuple[float, float] = (0.08, 0.3), missed_share: float = MISSED) -> tuple[Fit, np.ndarray]:
    """The fit to a push whose place lies between those that are tried, and the true net force (T, 3)."""
    rng = np.random.default_rng(seed)
    whole = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)))).whole
    low, high, length = whole.extent
    there = Footprint("gaussian", np.r_[low + (high - low) * rng.uniform(0.25, 0.95, 2), rng.uniform(*widths) * length])
    load, turn = whole.footprint_load(there), rng.uniform(0, 2 * np.pi)
    force = gust((0.0, np.cos(turn), np.sin(turn))) * np.linalg.norm(whole.uniform_load) / np.linalg.norm(load)
    q = moved(modal, force, load)
    missed = alike_errors(modal, rng, MODES) * missed_share * q[:, :MODES].std(0).max()
    q[:, :MODES] += missed - missed[0]
    fit = true_fit(body, modal, tracks(modal, q, seed=seed))
    return replace(fit, footprint=place.best_footprint(fit.acting, PHYSICS)), force * whole.footprint_volume(there)


def open_beside(body: Body, modal: ModalModel, q: np.ndarray) -> ForceProblem:
    """The problem of basis coordinates (T, r) with the second order left open."""
    fit = true_fit(body, modal, tracks(modal, q))
    second = fit.evidence.second_order(fit.whole)
    assert second is not None
    return second


def test_the_peak_of_a_push_is_off_by_what_is_stated(body: Body, modal: ModalModel) -> None:
    off = []
    for fit, true in (pushed(body, modal, seed) for seed in range(10)):
        if fit.footprint.family != "uniform":
            doubt = net_force_doubt(fit, np.full(2, 0.01))
            peak, sd = doubt.peak(doubt.found)
            off.append((peak - largest(true)) / sd)
    assert len(off) > 4
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.2


def test_a_push_of_usual_width_is_not_found_the_wider_for_what_the_modes_miss(body: Body, modal: ModalModel) -> None:
    fits = [pushed(body, modal, seed, widths=(0.08, 0.12))[0] for seed in range(10)]
    widths = [fit.footprint.parameters[2] / fit.whole.extent[2] for fit in fits if fit.footprint.family != "uniform"]
    assert len(widths) > 6
    assert 0.08 < np.median(widths) < 0.125


@pytest.mark.parametrize(("better", "family"), [("small", "gaussian"), ("wide", "uniform")])
def test_a_wind_is_given_up_for_a_small_place_that_explains_the_motion_better_and_not_for_a_wide_one(
    body: Body, modal: ModalModel, monkeypatch: pytest.MonkeyPatch, better: str, family: str
) -> None:
    whole = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)))).whole

    def cost(problem: ForceProblem, physics: Physics, footprint: Footprint) -> float:
        if footprint.family == "uniform":
            return 100.0
        small = footprint.parameters[2] < place.TOUCH * problem.extent[2]
        return 60.0 if small == (better == "small") else 101.0

    monkeypatch.setattr(place, "_cost", cost)
    assert place.best_footprint(whole, PHYSICS).family == family


def test_a_push_between_the_places_that_are_tried_is_no_wind(body: Body, modal: ModalModel, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)))).whole
    low, high, length = whole.extent
    there = low + (high - low) * np.array([4, 3]) / CENTRES

    def cost(problem: ForceProblem, physics: Physics, footprint: Footprint) -> float:
        if footprint.family == "uniform":
            return 100.0
        off = np.linalg.norm(footprint.parameters[:2] - there) / length
        return 60.0 + 45.0 * (1 - np.exp(-0.5 * (off / 0.05) ** 2))

    monkeypatch.setattr(place, "_cost", cost)
    assert min(cost(whole, PHYSICS, each) for each in whole.local_footprints) > 90
    found = place.best_footprint(whole, PHYSICS)
    assert found.family == "gaussian"
    np.testing.assert_allclose(found.parameters[:2], there, atol=0.01 * length)


def test_what_is_looked_for_between_small_places_is_small(body: Body, modal: ModalModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wider ones explain most winds better than a wind does: one that has grown wide would speak against it in the name of a small one."""
    whole = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)))).whole
    length = whole.extent[2]
    monkeypatch.setattr(place, "_cost", lambda problem, physics, footprint: 100.0 / (footprint.parameters[2] / length) ** 2)
    costs = np.array([place._cost(whole, PHYSICS, each) for each in whole.local_footprints])
    best, found = place.between_tried(whole, PHYSICS, whole.local_footprints, costs)
    assert whole.local_footprints[best].parameters[2] < found.parameters[2]
    assert 0.9 * place.TOUCH < found.parameters[2] / length < place.TOUCH


def test_a_longer_swing_does_not_tell_a_place_ever_more_surely(body: Body, modal: ModalModel) -> None:
    """Errors of the modes, which are most of what is missed, are the same in every period."""
    whole = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)))).whole
    short, long, longer = (place.independent(replace(whole, known=np.ones(count, bool)), PHYSICS) for count in (4, 400, 4000))
    assert short < long == longer


def test_some_place_that_is_tried_explains_a_push_between_them(body: Body, modal: ModalModel) -> None:
    """A push beside the axis twists a blade: places that lie further apart across it than they are wide let a wind pass for the better."""
    whole = open_beside(body, modal, np.zeros((FRAMES, modal.modes)))
    low, high, length = whole.extent
    near = [whole.footprint_load(each) for each in whole.local_footprints]
    for across in np.linspace(low[1], high[1], 9):
        there = whole.footprint_load(Footprint("gaussian", np.r_[0.9 * length, across, place.USUAL * length]))
        alike = max(float((there * each).sum() / (np.linalg.norm(there) * np.linalg.norm(each))) for each in near)
        assert alike > 0.99, across


def test_a_push_is_as_probable_as_its_width_is_usual_before_the_motion_is_looked_at(body: Body, modal: ModalModel) -> None:
    whole = open_beside(body, modal, np.zeros((FRAMES, modal.modes)))
    length = whole.extent[2]
    usual, wide, narrow = (Footprint("gaussian", np.r_[0.5 * length, 0.0, width * length]) for width in place.USUAL * np.exp([0.0, 2 * place.SPREAD, -2 * place.SPREAD]))
    found = place.before(whole, [Footprint(), usual, wide, narrow])
    assert found.sum() == pytest.approx(1.0)
    assert found[0] == place.EVEN
    np.testing.assert_allclose(found[2:] / found[1], np.exp(-2.0))
    four_times = replace(usual, parameters=usual.parameters * (1, 1, 4))
    assert place.before(whole, [Footprint(), usual, four_times])[2] < 0.05


def test_a_cost_speaks_by_its_share_of_what_is_missed_however_large_that_is(body: Body, modal: ModalModel) -> None:
    whole = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)))).whole
    costs = np.array([10.0, 20.0])
    few, many = (np.diff(place.unlikely(whole, PHYSICS, size * costs)) for size in (1e-3, 1e3))
    np.testing.assert_allclose(few, many)
    np.testing.assert_allclose(few, place.independent(whole, PHYSICS) * np.log(2.0))
    told = np.diff(place.unlikely(whole, PHYSICS, costs, missed=1e3))
    assert told < 0.01 * few


def test_beside_a_second_order_that_is_left_open_two_that_miss_hardly_anything_are_alike(body: Body, modal: ModalModel) -> None:
    whole = open_beside(body, modal, moved(modal, gust(), modal.footprint_load()))
    none, many = (np.diff(place.unlikely(whole, PHYSICS, size * np.array([10.0, 20.0])))[0] for size in (1e-3, 1e5))
    assert many == pytest.approx(place.independent(whole, PHYSICS) * np.log(2.0), rel=1e-3)
    assert none < 0.01 * many


def test_beside_it_what_calms_a_force_does_not_tell_its_place(body: Body, modal: ModalModel) -> None:
    """A wind that sets in at once costs much by the priors that calm it, which made it a push (seed 948840)."""
    whole = open_beside(body, modal, moved(modal, gust(), modal.footprint_load()))
    solution = whole.solve_under(PHYSICS, Footprint(), freely=True)
    cost = place._cost(whole, PHYSICS, Footprint())
    assert cost == pytest.approx((whole.missed(solution) ** 2).sum())
    assert cost < 0.7 * solution.cost
    assert place._cost(replace(whole, swing=None), PHYSICS, Footprint()) == pytest.approx(replace(whole, swing=None).solve_under(PHYSICS, Footprint()).cost)


def test_a_push_on_a_branch_that_acts_along_the_stem_as_well_is_found_where_it_is() -> None:
    """Held for a force that hardly moves the body, what acts along the stem was priced twenty times what acts across: the place gave way to it, and the force with the place."""
    stem, young = bar(length=0.3, height=0.3, thickness=0.05, edges=(), pitch=2e-3), np.array([7e5])
    x, y = np.meshgrid(*(start + stem.pitch_m * np.arange(count) for start, count in zip(stem.origin, stem.inside.shape, strict=True)), indexing="ij")
    body = replace(stem, inside=(np.abs(y) < 0.025) | ((np.abs(x - 0.2) < 0.025) & (y < 0) & (y > -0.14)))
    modal, physics, there = modes_of(body, young), replace(PHYSICS, young=young), Footprint("gaussian", np.array([0.2, -0.11, 0.03]))
    points = np.random.default_rng(0).permutation(modal.nodes[modal.nodes[:, 2] > modal.nodes[:, 2].max() - 1e-6])[:200]
    still = true_fit(body, modal, tracks(modal, np.zeros((FRAMES, modal.modes)), points=points), young=young).whole
    load = still.footprint_load(there)
    force = gust((-0.8, 1.0, 0.25)) * np.linalg.norm(still.uniform_load) / np.linalg.norm(load)
    q = modal.respond(young, damping=Damping(0.0, BETA), load=force @ load.T, period_s=PERIOD_S)
    fit = true_fit(body, modal, tracks(modal, q, points=points), young=young)
    fit = replace(fit, footprint=place.best_footprint(fit.acting, physics))
    assert fit.acting.moves_along(physics, load)
    off = fit.last().solve_under(physics, fit.footprint).force * still.footprint_volume(fit.footprint) - force * still.footprint_volume(there)
    assert np.linalg.norm(off) < 0.3 * np.linalg.norm(force * still.footprint_volume(there))  # .7 so priced


def test_a_force_along_a_slim_bar_costs_more_than_one_across_wherever_it_acts() -> None:
    slim = bar(length=0.4, height=0.04, thickness=0.04, edges=(), pitch=2e-3)
    young = np.array([7e5])
    modal, physics = modes_of(slim, young), replace(PHYSICS, young=young)
    whole = true_fit(slim, modal, tracks(modal, np.zeros((FRAMES, modal.modes))), young=young).whole
    assert not any(whole.moves_along(physics, whole.footprint_load(each)) for each in (Footprint(), Footprint("gaussian", np.array([0.35, 0.01, 0.04]))))


def test_nothing_is_open_near_a_wind(body: Body, modal: ModalModel) -> None:
    fit, _ = pushed(body, modal, 1)
    assert place.open_nearby(fit.whole, PHYSICS, Footprint()) == []
    near = place.open_nearby(fit.whole, PHYSICS, fit.footprint)
    assert len(near) == 3
    unsure = place.open_nearby(fit.whole, PHYSICS, fit.footprint, missed=1e6)
    moved = [np.linalg.norm([each.parameters - fit.footprint.parameters for each in some]) for some in (near, unsure)]
    assert moved[1] > moved[0]
