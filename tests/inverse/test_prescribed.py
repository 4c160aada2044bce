"""What is held stays, and takes the values of an earlier result where that is asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import inverse, result, store
from diffphys_ros.config import Settings, build, flat
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import solve
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.prescribed import prescribed, told_by
from diffphys_ros.types import Recovery

from .conftest import YOUNG
from .test_solve import drive

FORCE_ALONE = ["young", "damping", "density", "poisson"]
MATERIAL_ALONE = ["force", "density", "poisson"]


@pytest.fixture(scope="module")
def earlier(prepared: Prepared, quick_settings: Settings, tmp_path_factory: pytest.TempPathFactory) -> tuple[Recovery, Path]:
    """A result of the clip, and its folder."""
    folder = tmp_path_factory.mktemp("earlier")
    recovery = drive(solve(prepared, None, quick_settings))[1]
    result.save(recovery, prepared.clip, quick_settings, folder)
    return recovery, folder


def solved(prepared: Prepared, quick_settings: Settings, **fit: object) -> Recovery:
    return drive(solve(prepared, None, build(flat(quick_settings) | {f"fit.{name}": value for name, value in fit.items()})))[1]


def young_of(recovery: Recovery) -> np.ndarray:
    return np.array([np.median(recovery.young[recovery.part == part]) for part in (1, 2)])


def off(prepared: Prepared, **changes: object) -> Prepared:
    return replace(prepared, start=replace(prepared.start, **changes))


def unfelt_at_the_clamp(result_file: Path, path: Path) -> Path:
    """The same result as another simulator tells it: what is held feels no force."""
    arrays = store.read_arrays(result_file, "result")
    return store.write_arrays(path, arrays | {"force": np.where(arrays["clamped"][None, :, None], 0, arrays["force"])})


def test_a_modulus_that_is_held_stays_though_the_clip_speaks_against_it(prepared: Prepared, quick_settings: Settings) -> None:
    stiff = off(prepared, young=1.3 * YOUNG, log10_young_sd=np.full(2, 0.15))
    np.testing.assert_allclose(young_of(solved(stiff, quick_settings, hold=FORCE_ALONE)), 1.3 * YOUNG, rtol=1e-6)


def test_force_alone_is_sought_where_the_stiffness_is_that_of_an_earlier_result(prepared: Prepared, quick_settings: Settings, earlier: tuple[Recovery, Path]) -> None:
    stiff = off(prepared, young=1.3 * YOUNG, force=0.5 * prepared.start.force)
    found = solved(stiff, quick_settings, hold=FORCE_ALONE, prescribe=str(earlier[1]))
    np.testing.assert_allclose(young_of(found), young_of(earlier[0]), rtol=1e-5)
    true = earlier[0].net_force()
    assert np.linalg.norm(found.net_force() - true) < 0.1 * np.linalg.norm(true)
    assert found.reasons == ("told by fit.prescribe.",) * 2


def test_material_alone_is_sought_where_the_force_is_that_of_an_earlier_result(prepared: Prepared, quick_settings: Settings, earlier: tuple[Recovery, Path], tmp_path: Path) -> None:
    soft = off(prepared, young=0.8 * YOUNG, log10_young_sd=np.full(2, 0.15), force=np.zeros_like(prepared.start.force))
    told = unfelt_at_the_clamp(earlier[1] / "recovery.npz", tmp_path / "told.npz")
    found = solved(soft, quick_settings, hold=MATERIAL_ALONE, prescribe=str(told), iterations=6)
    true = earlier[0].net_force()
    assert np.abs(found.net_force() - true).max() < 1e-3 * np.abs(true).max()
    np.testing.assert_allclose(young_of(found), YOUNG, rtol=0.08)


@pytest.mark.parametrize(
    ("fit", "said"),
    [
        ({"hold": ["stiffness"]}, "fit.hold holds 'stiffness', must be of young"),
        ({"hold": ["young", "damping", "force", "motion", "density", "poisson"]}, "fit.hold holds every unknown"),
        ({"prescribe": "/none/here.npz"}, "fit.prescribe /none/here.npz: no such file"),
    ],
)
def test_what_cannot_be_held_or_read_is_refused(prepared: Prepared, quick_settings: Settings, fit: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        solved(prepared, quick_settings, **fit)


def test_a_result_of_another_clip_or_without_a_part_is_refused(prepared: Prepared, quick_settings: Settings, earlier: tuple[Recovery, Path], tmp_path: Path) -> None:
    arrays = store.read_arrays(earlier[1] / "recovery.npz", "result")
    shorter = store.write_arrays(tmp_path / "short.npz", arrays | {"force": arrays["force"][:-1]})
    with pytest.raises(InputError, match="has 13 frames, the clip has 14; give a result of this clip"):
        solved(prepared, quick_settings, hold=MATERIAL_ALONE, prescribe=str(shorter))
    unknown = {name: values for name, values in arrays.items() if name != "young_solver"} | {"young": np.where(arrays["part"] == 2, np.nan, arrays["young"])}
    vague = store.write_arrays(tmp_path / "vague.npz", unknown)
    with pytest.raises(InputError, match=r"tells no young of part 2 of 2; take young out of fit\.hold"):
        solved(prepared, quick_settings, hold=FORCE_ALONE, prescribe=str(vague))


def told_of(prepared: Prepared, settings: Settings, path: Path, *hold: str) -> Prepared:
    asked = build(flat(settings) | {"fit.hold": list(hold), "fit.prescribe": str(path)})
    return prescribed(prepared, asked, told_by(asked))


def test_a_modulus_that_is_not_identified_is_the_one_that_the_result_moved_with_and_said_so(
    prepared: Prepared, quick_settings: Settings, earlier: tuple[Recovery, Path], tmp_path: Path
) -> None:
    arrays, apparent = store.read_arrays(earlier[1] / "recovery.npz", "result"), 0.8
    moved = arrays["young_solver"] * apparent
    of_none = arrays | {"young": np.where(arrays["part"] == 2, np.nan, moved), "apparent_stiffness": np.float64(apparent), "engine": np.array("mpm")}
    found = told_of(prepared, quick_settings, store.write_arrays(tmp_path / "none.npz", of_none), "young")
    np.testing.assert_allclose(found.start.young, [np.median(moved[arrays["part"] == part]) for part in (1, 2)], rtol=1e-5)
    assert found.start.identified.tolist() == [True, False]
    assert found.clip.notes[-1] == "Young's modulus of part 2: told by fit.prescribe, where it is not identified: it is the modulus that the simulation there moved with."
    assert len(found.clip.notes) == len(prepared.clip.notes) + 1
    of_modes = store.write_arrays(tmp_path / "modes.npz", of_none | {"engine": np.array("modes"), "young": np.full_like(moved, np.nan)})
    np.testing.assert_allclose(told_of(prepared, quick_settings, of_modes, "young").start.young, found.start.young / apparent, rtol=1e-5)  # no grid, no error of one


def test_a_result_of_fewer_frames_tells_stiffness_and_damping_all_the_same(prepared: Prepared, quick_settings: Settings, earlier: tuple[Recovery, Path], tmp_path: Path) -> None:
    arrays = store.read_arrays(earlier[1] / "recovery.npz", "result")
    shorter = store.write_arrays(tmp_path / "short.npz", arrays | {"force": arrays["force"][:-1]})
    found = told_of(off(prepared, young=2 * YOUNG), quick_settings, shorter, "young", "damping")
    np.testing.assert_allclose(found.start.young, young_of(earlier[0]), rtol=1e-5)
    assert found.start.damping.mass_per_s == pytest.approx(float(arrays["mass_damping"]))


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"fit.hold": ["stiffness"]}, "fit.hold holds 'stiffness', must be of young"),
        ({"fit.hold": ["young", "force"], "experiment.schedule": "paper"}, "with the schedule paper one of them must be sought"),
        ({"fit.prescribe": "/none/here"}, "fit.prescribe /none/here: no such file"),
    ],
)
def test_what_settings_alone_rule_out_is_refused_before_a_recording_is_read_or_gaussians_are_fitted(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch, told: dict, said: str
) -> None:
    monkeypatch.setattr(inverse, "fit_gaussians", None)
    for steps in (inverse.run("/no/recording.mcap", build(told)), inverse.solve_prepared(prepared, build(told))):
        with pytest.raises(InputError, match=said):
            next(steps)


def test_densities_that_are_sought_keep_near_what_was_assumed_and_are_told(prepared: Prepared, quick_settings: Settings) -> None:
    found = solved(off(prepared, force=0.6 * prepared.start.force), quick_settings, hold=["poisson"])
    assert found.metrics["refined"]
    density = [np.median(found.density[found.part == part]) for part in (1, 2)]
    assert np.ptp(density) > 0
    np.testing.assert_allclose(density, 600.0, rtol=0.1)
