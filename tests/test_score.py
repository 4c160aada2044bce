"""Claims about scoring, on a made-up truth with known answers and against the scenes' own scorer."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.result import owned
from diffphys_ros.score import score, score_folder
from tests.script import loaded

FRAMES = 20
START_NS = 1_750_000_000_000_000_000
Arrays = dict[str, np.ndarray]


@pytest.fixture
def truth() -> Arrays:
    """A beam of two parts that is pushed along y in frames 3 to 9, held at x = 0."""
    vertices = np.stack(np.meshgrid(np.linspace(0, 0.4, 11), [-0.03, 0.03], [-0.03, 0.03], indexing="ij"), -1).reshape(-1, 3)
    count, part = len(vertices), (vertices[:, 0] > 0.21).astype(int)
    positions = np.repeat(vertices[None], FRAMES, 0)
    positions[..., 1] += 0.02 * np.sin(0.4 * np.arange(FRAMES))[:, None] * (vertices[:, 0] / 0.4) ** 2
    force = np.zeros((FRAMES, count, 3))
    force[3:10, :, 1] = 500.0
    return {
        "rest_vertices": vertices,
        "positions": positions,
        "part_E": np.array([1e6, 2e5]),
        "vertex_E": np.where(part == 0, 1e6, 2e5),
        "vertex_part": part,
        "interface": np.abs(vertices[:, 0] - 0.2) < 1e-9,
        "vertex_volume": np.full(count, 0.00144 / count),
        "clamped": vertices[:, 0] < 1e-9,
        "force_density": force,
    }


def exact(truth: Arrays) -> Arrays:
    return {
        "points": truth["rest_vertices"],
        "young": truth["vertex_E"],
        "force": truth["force_density"].copy(),
        "trajectory": truth["positions"].copy(),
    }


def scored(folder: Path, truth: Arrays, recovery: Arrays) -> dict:
    np.savez(folder / "truth.npz", **truth)
    np.savez(folder / "recovery.npz", **recovery)
    return score(folder / "recovery.npz", folder / "truth.npz")


def test_the_truth_itself_scores_without_error(tmp_path: Path, truth: Arrays) -> None:
    found = scored(tmp_path, truth, exact(truth))
    assert found["young_log10_error"] == pytest.approx([0, 0], abs=1e-12)
    assert found["young_ratio_error"] == pytest.approx(0, abs=1e-12)
    assert found["net_force_cosine"] == pytest.approx(1)
    assert found["false_force_ratio"] == 0
    assert found["trajectory_rmse_over_rms_motion"] == pytest.approx(0, abs=1e-9)


def test_youngs_error_is_signed_and_by_part(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth) | {"young": truth["vertex_E"] * np.where(truth["vertex_part"] == 0, 10.0, 0.1)}
    found = scored(tmp_path, truth, recovery)
    assert found["young_log10_error"] == pytest.approx([1, -1])
    assert found["young_ratio_error"] == pytest.approx(2)


def test_points_on_an_interface_do_not_count(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth) | {"young": np.where(truth["interface"], 1e12, truth["vertex_E"])}
    assert scored(tmp_path, truth, recovery)["young_log10_error"] == pytest.approx([0, 0], abs=1e-12)


def test_a_part_that_is_not_identified_scores_none(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth) | {"young": np.where(truth["vertex_part"] == 1, np.nan, truth["vertex_E"])}
    found = scored(tmp_path, truth, recovery)
    assert found["young_log10_error"][1] is None
    assert found["young_ratio_error"] is None


def test_a_part_of_which_a_few_points_carry_a_neighbours_modulus_is_not_identified(tmp_path: Path, truth: Arrays) -> None:
    outer = np.flatnonzero(truth["vertex_part"] == 1)
    young = np.where(truth["vertex_part"] == 1, np.nan, truth["vertex_E"])
    young[outer[:4]] = 1e6
    assert scored(tmp_path, truth, exact(truth) | {"young": young})["young_log10_error"][1] is None


def stated(truth: Arrays) -> Arrays:
    """An exact recovery that states what it knows: the outer part's modulus is a bound alone, its density is assumed too high."""
    outer = truth["vertex_part"] == 1
    return exact(truth) | {
        "young": np.where(outer, np.nan, truth["vertex_E"] * 10**0.1),
        "density": np.where(outer, 900.0, 500.0 * 10**0.04),
        "log10_young_sd": np.where(outer, np.nan, 0.05),
        "log10_specific_sd": np.where(outer, np.nan, 0.02),
        "young_lower": np.where(outer, truth["vertex_E"] / 10, np.nan),
    }


def test_what_was_stated_of_each_part_stands_beside_its_error(tmp_path: Path, truth: Arrays) -> None:
    found = scored(tmp_path, truth | {"part_rho": np.array([500.0, 300.0])}, stated(truth))
    assert found["young_log10_sd"] == [pytest.approx(0.05), None]
    assert found["young_lower_log10"] == [None, pytest.approx(-1)]
    assert found["specific_log10_error"] == [pytest.approx(0.06), None]
    assert found["specific_log10_sd"] == [pytest.approx(0.02), None]


def test_a_truth_without_densities_scores_no_specific_modulus(tmp_path: Path, truth: Arrays) -> None:
    assert "specific_log10_error" not in scored(tmp_path, truth, stated(truth))


def test_a_net_force_is_scored_by_how_often_the_truth_lies_where_it_was_stated_to_lie(tmp_path: Path, truth: Arrays) -> None:
    net = np.einsum("tnc,n->tc", truth["force_density"], np.where(truth["clamped"], 0.0, truth["vertex_volume"]))
    off, sd = np.zeros_like(net), np.zeros_like(net)
    sd[3:9] = 0.1  # frame 9 carries a force as well, of which nothing is said: its y is missed
    off[3:9] = 0.05, 0.15, 0.25
    off[9, 1] = -net[9, 1]
    stated = {"net_force": net + off, "net_force_sd": sd, "net_force_peak": np.array(0.9), "net_force_peak_sd": np.array(0.1)}
    found = scored(tmp_path, truth, exact(truth) | stated)
    assert found["net_force_inside_1sd"] == pytest.approx((6 + 2) / 21)
    assert found["net_force_inside_2sd"] == pytest.approx((12 + 2) / 21)
    assert (found["force_peak_stated_n"], found["force_peak_sd_n"]) == (0.9, 0.1)
    assert found["net_force_relative_sd"] == pytest.approx(0.1 * np.sqrt(18) / np.sqrt((net**2).sum()))


def test_a_net_force_that_is_not_identified_is_not_scored_by_deviations(tmp_path: Path, truth: Arrays) -> None:
    nothing = np.full((FRAMES, 3), np.nan)
    stated = {"net_force": np.zeros((FRAMES, 3)), "net_force_sd": nothing, "net_force_peak": np.array(np.nan), "net_force_peak_sd": np.array(np.nan)}
    assert "net_force_inside_1sd" not in scored(tmp_path, truth, exact(truth) | stated)


def test_half_the_force_misses_half_of_it(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth)
    recovery["force"] *= 0.5
    found = scored(tmp_path, truth | {"vertex_mass": truth["vertex_volume"] * 500}, recovery)
    assert found["net_force_relative_rmse"] == pytest.approx(0.5)
    assert found["modal_force_relative_rmse"] == [pytest.approx(0.5)]


def test_a_force_that_no_mode_feels_is_no_error_of_the_modal_force(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth)
    recovery["force"][..., 2] += 500.0  # the truth swings along y
    found = scored(tmp_path, truth | {"vertex_mass": truth["vertex_volume"] * 500}, recovery)
    assert found["net_force_relative_rmse"] > 1
    assert found["modal_force_relative_rmse"] == [pytest.approx(0, abs=1e-9)]


def test_a_force_along_the_body_is_no_error_of_what_acts_across_it(tmp_path: Path, truth: Arrays) -> None:
    recovery, axis = exact(truth), truth["rest_vertices"].mean(0) - truth["rest_vertices"][truth["clamped"]].mean(0)
    recovery["force"] = 0.5 * recovery["force"] + 500.0 * axis / np.linalg.norm(axis)  # the truth acts across
    found = scored(tmp_path, truth, recovery)
    assert found["net_force_cosine"] < 0.5
    assert found["net_force_across_cosine"] == pytest.approx(1)
    assert found["net_force_across_relative_rmse"] == pytest.approx(0.5)


def test_a_body_that_nothing_holds_has_no_axis_to_act_across(tmp_path: Path, truth: Arrays) -> None:
    free = truth | {"clamped": np.zeros_like(truth["clamped"])}
    assert not {name for name in scored(tmp_path, free, exact(free)) if "across" in name}


def test_a_force_turned_by_sixty_degrees_has_half_the_cosine(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth)
    recovery["force"][..., 2] = np.sqrt(3) * recovery["force"][..., 1]
    assert scored(tmp_path, truth, recovery)["net_force_cosine"] == pytest.approx(0.5)


def test_force_on_held_vertices_does_not_count(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth)
    recovery["force"][:, truth["clamped"]] = 1e6
    assert scored(tmp_path, truth, recovery)["false_force_ratio"] == pytest.approx(0, abs=1e-12)


def test_false_force_is_relative_to_the_true_peak(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth)
    recovery["force"][10:, :, 0] = 50.0
    quiet = FRAMES - 7
    assert scored(tmp_path, truth, recovery)["false_force_ratio"] == pytest.approx(0.1 * np.sqrt((FRAMES - 10) / quiet))


def test_predicting_no_motion_scores_one(tmp_path: Path, truth: Arrays) -> None:
    recovery = exact(truth) | {"trajectory": np.repeat(truth["positions"][:1], FRAMES, 0)}
    assert scored(tmp_path, truth, recovery)["trajectory_rmse_over_rms_motion"] == pytest.approx(1)


def test_a_truth_that_misses_arrays_is_refused(tmp_path: Path, truth: Arrays) -> None:
    del truth["part_E"]
    with pytest.raises(InputError, match="misses part_E"):
        scored(tmp_path, truth, exact(truth))


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("vertex_part", lambda a: a[:-1], r"vertex_part is of shape \(43,\), must be \(V = 44\)"),
        ("positions", lambda a: a[0], "positions is of shape"),
        ("positions", lambda a: a * np.nan, "positions must be finite"),
        ("clamped", lambda a: a.astype(float), "clamped is of float64, must be truth"),
        ("part_E", lambda a: a * 0, "part_E must be > 0"),
        ("part_E", lambda a: a[:0], "an array is empty"),
    ],
)
def test_a_truth_whose_arrays_do_not_fit_each_other_is_refused(tmp_path: Path, truth: Arrays, name: str, change, said: str) -> None:
    with pytest.raises(InputError, match=f"truth .*{said}.*; give the truth.npz as it was written"):
        scored(tmp_path, truth | {name: change(truth[name])}, exact(truth))


@pytest.mark.parametrize("name", ["force", "trajectory", "young", "points"])
def test_a_recovery_whose_arrays_do_not_fit_each_other_is_refused(tmp_path: Path, truth: Arrays, name: str) -> None:
    recovery = exact(truth)
    with pytest.raises(InputError, match=f"recovery .*{name}|recovery .*is of shape"):
        scored(tmp_path, truth, recovery | {name: recovery[name][..., :1]})


def test_scoring_a_folder_in_which_a_run_works_is_refused(tmp_path: Path, truth: Arrays) -> None:
    scored(tmp_path, truth, exact(truth))
    with owned(tmp_path), pytest.raises(InputError, match="another run owns it"):
        score_folder(tmp_path, tmp_path / "truth.npz")


def test_scoring_a_folder_adds_to_its_metrics(tmp_path: Path, truth: Arrays) -> None:
    scored(tmp_path, truth, exact(truth))
    (tmp_path / "metrics.json").write_text('{"psnr_masked": 30.5}')
    score_folder(tmp_path, tmp_path / "truth.npz")
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["psnr_masked"] == 30.5
    assert metrics["net_force_cosine"] == pytest.approx(1)


def with_clock(truth: Arrays) -> Arrays:
    """The truth with stamps at 30 Hz."""
    return truth | {"stamps_ns": START_NS + np.rint(np.arange(FRAMES) * 1e9 / 30).astype(np.int64), "time": np.arange(FRAMES) / 30, "fps": np.array(30)}


def seen_in(truth: Arrays, frames: slice, *, jitter_s: float = 0.0) -> Arrays:
    """What a perfect recovery of a clip with these frames of the truth alone holds."""
    step = frames.step or 1
    stamps = truth["stamps_ns"][frames][0] + np.rint((np.arange(len(truth["stamps_ns"][frames])) * step / 30 + jitter_s) * 1e9).astype(np.int64)
    whole = exact(truth)
    force = np.stack([whole["force"][k : k + step].mean(0) for k in range(FRAMES)[frames]])
    return whole | {"trajectory": whole["trajectory"][frames], "force": force, "period_s": np.array(step / 30), "stamps_ns": stamps}


@pytest.mark.parametrize(
    ("frames", "jitter_s"),
    [(slice(0, FRAMES), 0.003), (slice(4, FRAMES), 0.0), (slice(2, 15), -0.004), (slice(0, FRAMES, 2), 0.0), (slice(1, FRAMES, 2), 0.003)],
    ids=["jitter", "first frames lost", "both ends lost", "every other lost", "first and every other lost"],
)
def test_a_clip_that_lost_frames_is_put_back_on_the_truths_stamps(tmp_path: Path, truth: Arrays, frames: slice, jitter_s: float) -> None:
    truth = with_clock(truth)
    found = scored(tmp_path, truth, seen_in(truth, frames, jitter_s=jitter_s))
    assert found["net_force_cosine"] == pytest.approx(1)
    assert found["force_peak_n"] == pytest.approx(found["force_peak_true_n"])
    assert found["trajectory_rmse_over_rms_motion"] == pytest.approx(0, abs=1e-6 if frames.step is None else 0.01)


def test_a_clip_of_another_clock_begins_with_the_truth(tmp_path: Path, truth: Arrays) -> None:
    truth = with_clock(truth)
    recovery = seen_in(truth, slice(0, 12)) | {"stamps_ns": np.arange(12)}
    assert scored(tmp_path, truth, recovery)["trajectory_rmse_over_rms_motion"] == pytest.approx(0, abs=1e-9)


def test_a_truth_that_shares_no_time_with_the_clip_is_refused(tmp_path: Path, truth: Arrays) -> None:
    truth = with_clock(truth)
    with pytest.raises(InputError, match="lasts 1 frames of the truth"):
        scored(tmp_path, truth, seen_in(truth, slice(0, 10)) | {"period_s": np.array(1e-5), "stamps_ns": truth["stamps_ns"][:10]})


@pytest.mark.parametrize("scene", ["beam_gust", "beam_two_part", "plant_poke"])
def test_figures_equal_the_scenes_own_scorer(tmp_path: Path, scenes: Path, scene: str) -> None:
    other = _scorer(scenes)
    truth = other.load_truth(scenes / scene / "truth.npz")
    rng = np.random.default_rng(0)
    some = rng.permutation(truth["N"])[:300]
    recovery = {
        "points": truth["rest_vertices"][some] + rng.normal(0, 2e-3, (300, 3)),
        "young": np.where(np.arange(300) < 20, np.nan, truth["vertex_E"][some] * 10 ** rng.normal(0.05, 0.1, 300)),
        "force": truth["force_density"][:, some] + rng.normal(0, 30, (truth["T"], 300, 3)),
        "trajectory": truth["positions"][:, some] + rng.normal(0, 3e-3, (truth["T"], 300, 3)),
    }
    np.savez(tmp_path / "recovery.npz", **recovery)
    ours, theirs = score(tmp_path / "recovery.npz", scenes / scene / "truth.npz"), other.score(truth, recovery)
    raw, force = theirs["E"]["raw"], theirs["force"]["raw"]
    assert np.abs(ours["young_log10_error"]) == pytest.approx(
        [abs(np.log10(part["E_median"] / part["E_true"])) for part in raw["per_part"].values()], rel=1e-9
    )
    assert ours["young_ratio_error"] == (
        pytest.approx(max(r["abs_log10_error"] for r in raw["part_ratios"].values()), rel=1e-9) if raw["part_ratios"] else None
    )
    assert ours["net_force_cosine"] == pytest.approx(force["net_cosine_active_mean"], rel=1e-9)
    assert ours["false_force_ratio"] == pytest.approx(force["false_force"]["net_rms_ratio_vs_true_peak"], rel=1e-9)
    assert ours["net_force_relative_rmse"] == pytest.approx(force["net_rel_rmse"], rel=1e-9)
    assert ours["modal_force_relative_rmse"] == pytest.approx([mode["rel_rmse"] for mode in force["modal"]], rel=1e-6)
    assert ours["trajectory_rmse_over_rms_motion"] == pytest.approx(theirs["trajectory"]["rmse_over_rms_motion"], rel=1e-9)


def _scorer(scenes: Path) -> ModuleType:
    return loaded(scenes / "score.py")
