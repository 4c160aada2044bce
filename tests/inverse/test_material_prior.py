"""The material prior on its way into the body, the start values and the answer."""

import dataclasses

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.config import build
from diffphys_ros.inverse.answer import notes
from diffphys_ros.inverse.material_prior import believed, of_parts, on_points, parted
from diffphys_ros.inverse.posterior import of_start
from diffphys_ros.start import joint_values, start_values
from diffphys_ros.types import MaterialPrior

from .conftest import FRAMES, PERIOD_S, YOUNG, make_camera, make_tracks

WOOD, FOAM = 0, 1


def make_prior(split_px: int) -> MaterialPrior:
    """Wood to the left of a column of the image, foam to its right; the bar's parts meet where x = 0.1 m projects to."""
    index = np.where(np.arange(160) < split_px, WOOD, FOAM)[None].repeat(120, 0).astype(np.int16)
    return MaterialPrior(
        index, ("wood", "foam"), np.array([1e10, 1e5]), np.array([0.2, 0.4]), np.array([0.35, 0.2]), np.array([600.0, 40.0]), "a test", ("prior: said so",)
    )


@pytest.fixture(scope="module")
def boundary_px(prepared) -> int:
    return int(np.ceil(make_camera().project(np.array([0.1, 0.0, 0.05]))[0][0]))


def test_each_part_takes_the_constants_of_the_material_that_it_is_seen_in(prepared, boundary_px) -> None:
    prior, camera = make_prior(boundary_px), make_camera()
    body = believed(prepared.body, prior, camera, build({}).scene)
    np.testing.assert_allclose(body.density, [600, 40], rtol=0.05)
    np.testing.assert_allclose(body.poisson, [0.35, 0.2], rtol=0.05)
    belief = of_parts(prior, prepared.body, camera)
    np.testing.assert_allclose(np.log10(belief.young), [10, 5], atol=0.1)
    np.testing.assert_allclose(belief.log10_young_sd[1], 0.4, rtol=0.05)
    assert body.sources["density"] == body.sources["poisson_ratio"] == "a test"


def test_a_part_of_two_materials_takes_volume_means_and_says_how_far_they_lie_apart(prepared) -> None:
    middle = int(make_camera().project(np.array([0.2, 0.0, 0.05]))[0][0]) + 1
    prior = make_prior(middle)
    body = believed(prepared.body, prior, make_camera(), build({}).scene)
    belief = of_parts(prior, prepared.body, make_camera())
    assert body.density[1] == pytest.approx(320, rel=0.03)
    assert np.log10(belief.young[1]) == pytest.approx(7.5, abs=0.1)
    assert belief.log10_young_sd[1] == pytest.approx(np.sqrt(2.5**2 + 0.1), rel=0.02)


def test_what_a_person_gave_stands(prepared, boundary_px) -> None:
    scene = build({"scene.density_kg_m3": [1.0], "scene.poisson_ratio": [0.1]}).scene
    body = believed(prepared.body, make_prior(boundary_px), make_camera(), scene)
    np.testing.assert_array_equal(body.density, prepared.body.density)
    np.testing.assert_array_equal(body.poisson, prepared.body.poisson)
    assert body.sources == prepared.body.sources


def test_a_known_mass_scales_the_prior_s_densities_and_keeps_their_ratio(prepared, boundary_px) -> None:
    plain = believed(prepared.body, make_prior(boundary_px), make_camera(), build({}).scene)
    scaled = believed(prepared.body, make_prior(boundary_px), make_camera(), build({"scene.mass_kg": 0.5}).scene)
    volumes = np.array([0.1, 0.2]) * 0.1 * 0.1
    assert scaled.density @ volumes == pytest.approx(0.5)
    assert scaled.density[0] / scaled.density[1] == pytest.approx(plain.density[0] / plain.density[1])
    assert "scaled to mass_kg" in scaled.sources["density"]


def test_particles_take_the_material_of_the_pixel_that_they_project_to(prepared, boundary_px) -> None:
    points = np.array([[0.02, 0.01, -0.04], [0.25, 0.01, 0.0], [0.4, 0.3, 0.0]])
    young, poisson = on_points(make_prior(boundary_px), prepared.body, make_camera(), points)
    np.testing.assert_array_equal(young, [1e10, 1e5, 1e5])
    np.testing.assert_array_equal(poisson, [0.35, 0.2, 0.2])


@dataclasses.dataclass
class Belief:
    young: np.ndarray
    log10_young_sd: np.ndarray


@pytest.fixture(scope="module")
def blurred(prepared):
    """Tracks too noisy for their motion to tell anything."""
    return dataclasses.replace(prepared.tracks, noise_m=0.01)


def test_without_a_free_tail_the_start_is_the_belief_and_without_belief_the_clip_s_frequency(prepared, blurred) -> None:
    belief = Belief(np.array([3e5, 9e4]), np.array([0.2, 0.6]))
    told, _ = start_values(prepared.body, blurred, PERIOD_S, build({}), belief=belief)
    guessed, _ = start_values(prepared.body, blurred, PERIOD_S, build({}))
    assert not told.has_free_tail
    np.testing.assert_array_equal(told.young, belief.young)
    np.testing.assert_array_equal(told.log10_young_sd, belief.log10_young_sd)
    assert all("the material prior's" in reason for reason in told.reasons)
    assert guessed.young[0] == guessed.young[1] != told.young[0]
    assert all("is a guess" in reason for reason in guessed.reasons)


def test_a_belief_too_soft_to_stand_is_made_stiffer_until_it_does(prepared, blurred) -> None:
    heavy = dataclasses.replace(prepared.body, gravity=np.array([-9.81, 0.0, 0.0]))
    start, modal = start_values(heavy, blurred, PERIOD_S, build({}), belief=Belief(np.full(2, 1500.0), np.full(2, 0.5)))
    assert start.young[0] > 1500.0
    assert modal.eigen(start.young)[0][0] > 0


@pytest.mark.parametrize(("sd", "least", "most"), [(0.003, -0.02, 0.02), (3.0, -0.35, -0.1)])
def test_a_sure_belief_holds_the_joint_fit_and_an_unsure_one_gives_way_to_the_clip(prepared, sd: float, least: float, most: float) -> None:
    start = dataclasses.replace(
        prepared.start,
        young=1.6 * YOUNG,
        log10_young_sd=np.full(2, sd),
        forced=np.ones(FRAMES, bool),
        force=np.zeros((FRAMES, 3)),
        has_free_tail=False,
    )
    tracks = make_tracks(prepared.body, prepared.modal, prepared.start)
    found = joint_values(prepared.body, tracks, PERIOD_S, build({"scene.at_rest": True}), start, prepared.modal, camera=make_camera(), believed=True)
    assert least <= np.log10(found.young[0] / start.young[0]) <= most
    assert (found.log10_young_sd <= sd).all()


def test_the_prior_goes_to_disk_and_back_with_the_prepared_clip_and_its_notes_into_the_answer(prepared, tmp_path) -> None:
    with_prior = dataclasses.replace(prepared, prior=make_prior(80))
    back = result.load_prepared(result.save_prepared(tmp_path / "clip.npz", with_prior, build({})))
    assert back.prior is not None
    np.testing.assert_array_equal(back.prior.index, make_prior(80).index)
    assert back.prior.name == ("wood", "foam")
    assert "prior: said so" in notes(back, of_start(back))


def test_a_clip_in_which_a_force_acts_to_the_end_has_start_values_all_the_same(prepared) -> None:
    t = prepared.tracks
    short = dataclasses.replace(t, pixels=t.pixels[:8], points=t.points[:8], valid=t.valid[:8])
    start, _ = start_values(prepared.body, short, PERIOD_S, build({}))
    assert not start.has_free_tail
    assert not start.identified.any()
    assert np.isfinite(start.young).all()


@pytest.fixture
def whole(prepared):
    """The bar's body, its parts not seen."""
    return dataclasses.replace(prepared.body, part=np.ones_like(prepared.body.part), density=np.array([600.0]), poisson=np.array([0.3]))


@pytest.mark.parametrize("swapped", [False, True])
def test_where_no_parts_were_seen_the_prior_s_materials_are_the_parts_and_the_first_is_at_the_clamp(prepared, whole, boundary_px, swapped: bool) -> None:
    prior = make_prior(boundary_px)
    if swapped:
        prior = dataclasses.replace(prior, index=1 - prior.index, name=prior.name[::-1])
    body = parted(whole, prior, make_camera())
    assert body.parts == 2
    assert (body.part == prepared.body.part).mean() > 0.98
    np.testing.assert_array_equal(body.density, [600, 600])
    assert body.sources["parts"] == "a test"


def test_parts_that_were_seen_stay_and_specks_of_a_material_are_no_part(prepared, whole, boundary_px) -> None:
    assert parted(prepared.body, make_prior(boundary_px), make_camera()) is prepared.body
    assert parted(whole, make_prior(0), make_camera()) is whole
    speck = make_prior(0)
    u, v = make_camera().project(np.array([0.2, 0.0, 0.05]))[0].astype(int)
    speck.index[v - 2 : v + 2, u - 2 : u + 2] = WOOD
    assert parted(whole, speck, make_camera()) is whole
