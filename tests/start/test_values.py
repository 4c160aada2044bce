"""Start values from made-up and from simulated motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.footprints import gaussian
from diffphys_ros.modes import ModalModel
from diffphys_ros.start import start_values
from diffphys_ros.start.free_tail import FREQUENCY_SD
from diffphys_ros.start.values import widened
from diffphys_ros.types import Body, StartValues, Tracks
from tests.made_bar import BETA, FORCED, FRAMES, LENGTH, PERIOD_S, YOUNG, bar, camera, gust, modes_of, motion, settings, tracks


@pytest.fixture(scope="module")
def body() -> Body:
    return bar()


@pytest.fixture(scope="module")
def truth(body) -> ModalModel:
    return modes_of(body, YOUNG, finer=0.85, count=12)


@pytest.fixture(scope="module")
def seen(truth) -> Tracks:
    return tracks(truth, motion(truth, YOUNG, gust()))


@pytest.fixture(scope="module")
def start(body, seen) -> StartValues:
    return start_values(body, seen, PERIOD_S, settings(at_rest=True))[0]


def log10_error(start: StartValues) -> np.ndarray:
    return np.log10(start.young / YOUNG)


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    return float((a * b).sum() / np.linalg.norm(a) / np.linalg.norm(b))


def test_stiffness_of_both_parts_is_found_within_four_percent(start):
    assert np.abs(log10_error(start)).max() < 0.017
    assert start.identified.all()
    assert start.has_free_tail


def test_the_claimed_spread_covers_the_error_and_is_not_idle(start):
    assert (np.abs(log10_error(start)) < 3 * start.log10_young_sd).all()
    assert start.log10_young_sd.max() < 0.1


def test_the_force_is_found_in_size_and_direction_and_is_zero_elsewhere(start):
    force = gust()
    assert cosine(start.force, force) > 0.99
    assert np.linalg.norm(start.force) == pytest.approx(np.linalg.norm(force), rel=0.08)
    assert not start.force[FORCED.stop + 1 :].any()
    assert start.footprint.family == "uniform"


def test_damping_is_found(start):
    omega2 = (2 * np.pi * start.frequencies_hz[0]) ** 2
    assert start.damping.decay(omega2) == pytest.approx(0.5 * BETA * omega2, rel=0.15)


def test_the_linear_motion_explains_the_tracks(start):
    assert start.track_cost < 2e-3


@pytest.mark.parametrize("scale", [0.3, 3.0])
def test_the_search_forgets_its_first_guess(body, seen, start, scale):
    found = start_values(body, seen, PERIOD_S, settings(at_rest=True), guess_scale=scale)[0]
    assert np.abs(np.log10(found.young / start.young)).max() < 0.002


def test_tracks_without_depth_suffice_for_a_force_in_the_image_plane(body, truth):
    seen = tracks(truth, motion(truth, YOUNG, gust((0.0, 1.0, 0.0))), depth=False)
    found = start_values(body, seen, PERIOD_S, settings(at_rest=True), camera=camera())[0]
    assert np.abs(log10_error(found)).max() < 0.04
    assert cosine(found.force, gust((0.0, 1.0, 0.0))) > 0.98


def test_a_clip_that_starts_in_motion_gives_stiffness_and_initial_motion(body, truth):
    begun = np.zeros((2, truth.modes))
    begun[0, :2], begun[1, :2] = (2.5e-3, -1e-3), (0.02, 0.03)
    q = motion(truth, YOUNG, np.zeros((FRAMES, 3)), initial_displacement=begun[0], initial_velocity=begun[1])
    found, modal = start_values(body, tracks(truth, q), PERIOD_S, settings(at_rest=False))
    assert np.abs(log10_error(found)).max() < 0.04
    tip = np.array([[0.28, 0.02, 0.06]])
    speeds = [m.evaluate(tip)[0][0] @ v for m, v in ((truth, begun[1]), (modal, found.initial_velocity))]
    assert speeds[1] == pytest.approx(speeds[0], abs=0.15 * np.linalg.norm(speeds[0]))
    assert not found.force.any() or np.abs(found.force).max() < 50


def test_a_push_on_the_rim_of_a_plate_is_told_from_wind():
    plate, young = bar(height=0.2, thickness=0.03, edges=()), np.array([1.6e6])
    truth = modes_of(plate, young, finer=0.85, count=12)
    load = 5 * gust((0.0, 0.0, 1.0)) @ truth.footprint_load(lambda points: gaussian(points, np.array([0.24, -0.07, 0.04]))).T
    q = truth.respond(young, damping=Damping(0.0, BETA), load=load, period_s=PERIOD_S)
    found = start_values(plate, tracks(truth, q), PERIOD_S, settings(at_rest=True))[0]
    assert np.abs(np.log10(found.young / young)).max() < 0.02
    assert found.footprint.family == "gaussian"
    assert found.footprint.parameters[1] < -0.03
    assert cosine(found.force, gust((0.0, 0.0, 1.0))) > 0.95


def recovered(body: Body, young: np.ndarray, wind: np.ndarray) -> StartValues:
    """Start values of a body that is told as it is, from its motion in a wind."""
    truth = modes_of(body, young, finer=0.85, count=12)
    return start_values(body, tracks(truth, motion(truth, young, wind)), PERIOD_S, settings(at_rest=True, poisson_ratio=body.poisson.tolist()))[0]


def test_a_wide_plate_that_is_hardly_compressible_is_not_taken_for_stiffer():
    """Held along its root it cannot grow narrower where it is stretched: at a Poisson's ratio of .45 that counts for more than at .3."""
    young = np.array([4e6])
    found = recovered(bar(height=0.3, thickness=0.02, edges=(), poisson=0.45), young, gust((0.0, 0.0, 1.0)))
    assert np.abs(np.log10(found.young / young)).max() < 0.02
    assert found.identified.all()


def test_a_bar_that_hangs_is_not_taken_for_stiffer():
    """Its weight pulls it straight: a sixth of what brings it back."""
    young = np.array([1.1e5])
    found = recovered(bar(edges=(), gravity=(9.81, 0.0, 0.0)), young, 0.5 * gust())
    assert np.abs(np.log10(found.young / young)).max() < 0.02
    assert found.identified.all()


@pytest.mark.parametrize("told", [[600.0], None])
def test_a_part_too_small_for_an_element_is_not_identified_and_takes_nothing_from_the_others(told):
    """A few pixels of another colour at the edge of an object."""
    young = YOUNG[:1]
    truth = modes_of(bar(edges=()), young, finer=0.85, count=12)
    speck = bar(edges=(LENGTH - 1e-3,))
    found = start_values(speck, tracks(truth, motion(truth, young, gust())), PERIOD_S, settings(at_rest=True, density_kg_m3=told, mass_kg=speck.mass_kg))[0]
    assert found.identified.tolist() == [True, False]
    assert abs(np.log10(found.young[0] / young[0])) < 0.02


def test_motion_that_is_never_free_yields_a_guess_that_says_so(body, truth):
    force = 300 * np.random.default_rng(0).standard_normal((FRAMES, 3)) * (0, 1, 1)
    found = start_values(body, tracks(truth, motion(truth, YOUNG, force)), PERIOD_S, settings(at_rest=True))[0]
    assert not found.has_free_tail
    assert not found.identified.any()
    assert "guess" in found.reasons[0]
    assert found.forced.all()


def test_a_body_that_does_not_move_yields_a_guess_that_says_so(body, truth):
    found = start_values(body, tracks(truth, np.zeros((FRAMES, truth.modes))), PERIOD_S, settings(at_rest=True))[0]
    assert not found.identified.any()
    assert "hardly moves" in found.reasons[0]
    assert np.isfinite(found.young).all()


@pytest.mark.slow
def test_a_wrong_body_raises_the_alarm(seen):
    wrong = bar(height=0.04, edges=(0.02,))
    found = start_values(wrong, seen, PERIOD_S, settings(at_rest=True))[0]
    assert not found.identified.all()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["bulging", "backwards"])
def test_a_motion_of_a_shape_that_no_mode_has_tells_no_stiffness(body, seen, how):
    """With one that bulges the fit would else claim a modulus .3 off; from one that moves most at the clamp next to nothing follows."""
    moved, along = seen.points - seen.points[:1], seen.points[0, :, 0]
    order = np.argsort(along)
    if how == "bulging":
        moved *= (1 + 0.6 * np.sin(3 * np.pi * along / LENGTH))[:, None]
    else:
        moved[:, order] = moved[:, order[::-1]]
    points = seen.points[:1] + moved
    found = start_values(body, replace(seen, points=points, pixels=camera().project(points)[0]), PERIOD_S, settings(at_rest=True))[0]
    assert not found.identified.any()
    assert all("differs from the fitted modes" in reason for reason in found.reasons)
    assert np.isfinite(found.log10_young_sd).all()


def test_a_simulated_two_part_beam_is_recovered(scenes):
    truth = dict(np.load(scenes / "beam_two_part" / "truth.npz"))
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # body z points to the camera, along world -y
    beam = replace(bar(length=0.44, height=0.05, thickness=0.07, edges=(0.22,), density=700.0), world_from_body=pose)
    rng = np.random.default_rng(0)
    rest = beam.to_body(truth["rest_vertices"])
    front = np.flatnonzero((rest[:, 2] > 0.034) & (rest[:, 0] > 0.03))
    path = truth["positions"][:, front].astype(float)
    noisy = path + 1e-4 * rng.standard_normal(path.shape)
    seen = Tracks(noisy[..., :2], noisy, np.ones(path.shape[:2], bool), True, 1e-4)
    found = start_values(beam, seen, 1 / 30, settings(at_rest=True, density_kg_m3=[700.0]))[0]
    assert np.abs(np.log10(found.young / truth["part_E"])).max() < 0.03
    assert cosine(beam.rotate_to_world(found.force), truth["force"].sum(1)) > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [(100.0, 0.0, 0.0), (-60.0, 0.0, 0.0)])  # across the bar: tests/gates/test_doubts.py
def test_a_gravity_that_is_not_there_leaves_no_stiffness(body, seen, gravity):
    """The frequencies are met at another stiffness, but not all of them at once."""
    found = start_values(replace(body, gravity=np.array(gravity)), seen, PERIOD_S, settings(at_rest=True))[0]
    assert not found.identified.any()
    assert np.abs(log10_error(found)).max() > 0.03
    assert "gravity" in found.reasons[0] or "check mask" in found.reasons[0]


def test_a_gravity_that_hardly_matters_leaves_the_stiffness_and_a_spread_that_covers_the_error(body, seen):
    found = start_values(replace(body, gravity=np.array([0.0, 0.0, -9.81])), seen, PERIOD_S, settings(at_rest=True))[0]
    assert found.identified.all()
    assert (np.abs(log10_error(found)) < 3 * found.log10_young_sd).all()


@pytest.mark.slow
def test_the_spread_grows_with_what_a_frequency_is_off_by_beyond_what_is_allowed_for(body, seen):
    thicker = replace(body, half_thickness=1.12 * body.half_thickness)
    known = settings(at_rest=True, density_kg_m3=body.density.tolist())
    found, even = (start_values(each, seen, PERIOD_S, known)[0] for each in (thicker, body))
    assert found.detuning > 2 * even.detuning
    assert (found.log10_young_sd > 1.2 * even.log10_young_sd).all()
    assert found.log10_young_sd[1] > 4.8 * even.log10_young_sd[1]  # 4.1 times from how far the worst is off, more from how little they agree


def test_an_outline_is_no_surer_of_its_one_mode_than_a_mode_can_be_known():
    """Outline, thickness and density put any frequency off by a percent, E by two, whatever a fit of that one frequency says."""
    body = bar(edges=())
    modal = modes_of(body, YOUNG[:1], finer=0.85, count=12)
    moved = motion(modal, YOUNG[:1], gust((0.0, 1.0, 0.0)))
    seen = replace(tracks(modal, moved, depth=False), normals=np.tile([0.0, 1.0, 0.0], (200, 1)))
    start = start_values(body, seen, PERIOD_S, settings(at_rest=True), camera=camera())[0]
    assert 2 * FREQUENCY_SD / np.log(10) < start.log10_young_sd[0] < 0.03
    assert abs(np.log10(start.young[0] / YOUNG[0])) < start.log10_young_sd[0]


def test_a_part_that_the_shape_leaves_open_is_not_identified(start):
    little, much = (widened(start, extra, "the clamp is not seen") for extra in (0.05, 0.4))
    assert little.identified.all()
    assert little.reasons == start.reasons
    np.testing.assert_allclose(little.log10_young_sd, np.hypot(start.log10_young_sd, 0.05))
    assert not much.identified.any()
    assert much.reasons[0].endswith("only: the clamp is not seen.")
