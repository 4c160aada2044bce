"""Claims about a result folder."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diffphys_ros import config, result, store
from diffphys_ros.damping import Damping
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.types import Clip, Doubt, ModalProblem, MpmProblem, Recovery
from tests.prepared import make_prepared


def test_a_recovery_comes_back_as_it_was_saved(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    result.save(made_recovery, made_clip, config.Settings(), tmp_path)
    back = result.load(tmp_path)
    for f in dataclasses.fields(Recovery):
        if f.name not in ("grid", "metrics", "simulation"):
            np.testing.assert_array_equal(getattr(back, f.name), getattr(made_recovery, f.name), err_msg=f.name)
    assert (back.grid.dx, back.grid.size, back.grid.clamp_index) == (0.01, (16, 8, 8), 3)
    np.testing.assert_array_equal(back.grid.origin, made_recovery.grid.origin)
    assert back.force.dtype == np.float32


def test_what_is_said_of_the_force_comes_back(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    told = dataclasses.replace(made_recovery, force_identified=True, force_reason="it is seen well.")
    result.save(told, made_clip, config.Settings(), tmp_path)
    back = result.load(tmp_path)
    assert (back.force_identified, back.force_reason) == (True, "it is seen well.")


def made_modes(recovery: Recovery) -> ModalProblem:
    count, modes = len(recovery.points), 3
    shapes = {"rest": (count, 3), "young": (count,), "basis": (count, 3, modes), "load": (modes, 3), "force": (len(recovery.trajectory), 3)}
    vectors = dict.fromkeys(("initial_displacement", "initial_velocity"), (modes,))
    rng = np.random.default_rng(0)
    drawn = {f.name: rng.normal(size=(shapes | vectors).get(f.name, (modes, modes))) for f in dataclasses.fields(ModalProblem)}
    return ModalProblem(**drawn | {"young": recovery.young})


@pytest.mark.parametrize("kind", ["points", "points in a force field", "modes"])
def test_what_moved_the_body_comes_back_in_its_own_scalar_type(tmp_path: Path, made_recovery: Recovery, made_clip: Clip, kind: str) -> None:
    simulation: MpmProblem | ModalProblem = made_modes(made_recovery) if kind == "modes" else made_recovery.simulation
    if kind == "points in a force field":
        simulation = dataclasses.replace(simulation, field_force=np.ones(made_recovery.force[1:].shape, np.float32))
    result.save(dataclasses.replace(made_recovery, simulation=simulation), made_clip, config.Settings(), tmp_path)
    back = result.load(tmp_path).simulation
    assert type(back) is type(simulation)
    for name, value in vars(simulation).items():
        assert np.asarray(getattr(back, name)).dtype == np.asarray(value).dtype, name
        np.testing.assert_array_equal(getattr(back, name), value, err_msg=name)


def test_a_result_that_is_loaded_and_saved_again_has_the_same_bytes(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    first = result.save(dataclasses.replace(made_recovery, identified=np.array([True, False])), made_clip, config.Settings(), tmp_path / "a")
    second = result.save(result.load(tmp_path / "a"), made_clip, config.Settings(), tmp_path / "b")
    assert first.read_bytes() == second.read_bytes()


def test_young_solver_is_what_was_simulated_and_not_what_the_correction_makes_of_it(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    for recovery in (made_recovery, dataclasses.replace(made_recovery, young=2 * made_recovery.young, apparent_stiffness=0.5)):
        with np.load(result.save(recovery, made_clip, config.Settings(), tmp_path)) as z:
            np.testing.assert_array_equal(z["young_solver"], made_recovery.simulation.young)


@pytest.mark.parametrize("name", ["world_from_body", "engine", "mpm_ghost", "mpm_deformation_gradient", "mpm_damping_shapes"])
def test_a_result_of_an_older_layout_is_refused_by_the_name_of_what_it_misses(
    tmp_path: Path, made_recovery: Recovery, made_clip: Clip, name: str
) -> None:
    arrays = store.read_arrays(result.save(made_recovery, made_clip, config.Settings(), tmp_path), "recovery")
    store.write_arrays(tmp_path / result.RECOVERY, {key: value for key, value in arrays.items() if key != name})
    with pytest.raises(InputError, match=f"recovery .*: array '{name}' is missing; recover the clip again"):
        result.load(tmp_path)


def test_an_engine_of_a_later_version_is_refused(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    arrays = store.read_arrays(result.save(made_recovery, made_clip, config.Settings(), tmp_path), "recovery")
    store.write_arrays(tmp_path / result.RECOVERY, arrays | {"engine": np.array("fem")})
    with pytest.raises(InputError, match="engine 'fem' is unknown, must be one of mpm, modes; recover the clip again"):
        result.load(tmp_path)


def test_equal_recoveries_give_equal_bytes_wherever_the_mask_lay(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    first, second = (
        result.save(made_recovery, made_clip, config.build({"scene.first_mask": f"/{where}/mask0.png"}), tmp_path / where).read_bytes()
        for where in ("here", "there")
    )
    assert first == second


def test_timings_in_the_metrics_do_not_reach_recovery_npz(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    later = dataclasses.replace(made_recovery, metrics=made_recovery.metrics | {"seconds": 12.0}, notes=("other",))
    first, second = (
        result.save(r, made_clip, config.Settings(), tmp_path / name).read_bytes() for r, name in ((made_recovery, "a"), (later, "b"))
    )
    assert first == second


def test_young_is_nan_where_its_part_is_not_identified(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    unsure = dataclasses.replace(made_recovery, identified=np.array([True, False]))
    with np.load(result.save(unsure, made_clip, config.Settings(), tmp_path)) as z:
        np.testing.assert_array_equal(np.isnan(z["young"]), made_recovery.part == 2)
        assert np.isfinite(z["young_solver"]).all()


def test_the_npz_holds_time_frame_and_settings(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    settings = config.build({"scene.mass_kg": 0.8, "fit.iterations": 3})
    with np.load(result.save(made_recovery, made_clip, settings, tmp_path)) as z:
        assert config.build(json.loads(str(z["config"]))) == settings
        assert str(z["frame_id"]) == "world"
        assert z["stamps_ns"][1] - z["stamps_ns"][0] == 33_333_333
        assert z["stamps_ns"][0] == z["start_ns"] == made_clip.start_ns


def test_metrics_are_json_without_nan(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    result.save(made_recovery, made_clip, config.Settings(), tmp_path)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    sources = {"density_source": "mass_kg over the filled volume", "metric_scale_source": "depth topic"}
    assert metrics == {"psnr_masked": 31.0, "loss": [1.0, None], **sources, "scale": "absolute", "notes": ["density assumed"]}


def test_the_npz_says_whether_its_pascals_are_assumed(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    untold = dataclasses.replace(made_recovery, metrics={"density_source": "assumed: 1000 kg/m^3", "metric_scale_source": "depth topic"})
    for recovery, absolute, words in ((made_recovery, True, "absolute"), (untold, False, "relative: nobody told a mass or a density")):
        with np.load(result.save(recovery, made_clip, config.Settings(), tmp_path)) as z:
            assert z["absolute"].item() is absolute
            assert str(z["scale"]).startswith(words)
        assert result.load(tmp_path).scale == recovery.scale


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match=r"output folder .*taken.*--out"):
        result.check_writable(tmp_path / "taken")


def test_checking_a_folder_leaves_nothing_in_it(tmp_path: Path) -> None:
    assert list(result.check_writable(tmp_path / "a" / "b").iterdir()) == []


def test_loading_from_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        result.load(tmp_path)


def test_an_npz_that_misses_an_array_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "recovery.npz", points=np.zeros((1, 3)))
    with pytest.raises(InputError, match="is missing; recover the clip again"):
        result.load(tmp_path)


def test_every_file_of_the_folder_is_written(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    told: list[str] = []
    left_out = result.write_all(made_recovery, made_clip, config.Settings(), tmp_path, report=told.append)
    files = set(result.FILES)
    missing = {sentence.split()[0] for sentence in left_out}
    assert {path.name for path in tmp_path.iterdir()} == files - missing
    assert set(told) == files - {result.RECOVERY, result.METRICS, result.RECORDING_OUTLINE}


def test_a_rerun_that_cannot_be_used_is_left_out_and_why_is_said(tmp_path: Path, made_recovery: Recovery, made_clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that wants another numpy than the system's."""
    (tmp_path / "broken" / "rerun").mkdir(parents=True)
    (tmp_path / "broken" / "rerun" / "__init__.py").write_text("raise ImportError('wants NumPy 2.0 or newer')")
    for name in [name for name in sys.modules if name.split(".")[0] == "rerun" or name == "diffphys_ros.report.rerun_log"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path / "broken")
    left_out = result.write_all(made_recovery, made_clip, config.Settings(), tmp_path / "out")
    assert "recovery.rrd was left out because a package that it needs cannot be used here (wants NumPy 2.0 or newer)." in left_out
    assert (tmp_path / "out" / result.RECOVERY).exists()


def test_without_matplotlib_the_figure_is_left_out_and_said_so(
    tmp_path: Path, made_recovery: Recovery, made_clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "diffphys_ros.report.figure", raising=False)
    left_out = result.write_all(made_recovery, made_clip, config.Settings(), tmp_path)
    assert any(sentence.startswith("summary.png was left out because the package 'matplotlib") for sentence in left_out)
    assert (tmp_path / result.RECOVERY).exists()
    assert not (tmp_path / result.FIGURE).exists()


def test_the_recording_holds_the_net_force(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    result.write_all(made_recovery, made_clip, config.Settings(), tmp_path)
    played = reader.read_ros2_messages(str(tmp_path / result.RECORDING), topics=["/fit_node/net_force"])
    force = [[m.ros_msg.wrench.force.x, m.ros_msg.wrench.force.y, m.ros_msg.wrench.force.z] for m in played]
    np.testing.assert_allclose(force, made_recovery.net_force(), rtol=1e-5, atol=1e-9)


def test_the_recording_puts_the_camera_of_the_rendered_images_into_the_world(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    result.write_all(made_recovery, made_clip, config.Settings(), tmp_path, node="/robot1/finder")
    heard: dict[str, list[Any]] = {}
    for message in reader.read_ros2_messages(str(tmp_path / result.RECORDING)):
        heard.setdefault(message.channel.topic, []).append(message.ros_msg)
    (tree,) = heard.pop("/tf_static")
    assert all(topic.startswith("/robot1/finder/") for topic in heard)
    images, infos, (cloud,) = (heard[f"/robot1/finder/{name}"] for name in ("rendered", "camera_info", "material_field"))
    stamps = [[(m.header.stamp.sec, m.header.stamp.nanosec) for m in some] for some in (images, infos)]
    assert len(stamps[0]) == len(made_clip)
    assert stamps[0] == stamps[1]
    assert {i.header.frame_id for i in (*images, *infos)} == {tree.transforms[0].child_frame_id}
    assert cloud.header.frame_id == tree.transforms[0].header.frame_id
    place = tree.transforms[0].transform.translation
    assert [place.x, place.y, place.z] == pytest.approx(made_clip.camera.position)


def test_a_result_folder_that_is_a_persons_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [mine_0.mcap]}")
    with pytest.raises(InputError, match=r"holds a rosbag2 recording, whose metadata\.yaml would be lost"), result.owned(tmp_path):
        pass


@pytest.fixture
def made_prepared(made_clip: Clip) -> Prepared:
    return dataclasses.replace(make_prepared(made_clip), doubts=(Doubt("the camera moves", of_young=True),))


def test_a_prepared_clip_comes_back_as_it_was_saved(tmp_path: Path, made_prepared: Prepared) -> None:
    settings = config.build({"scene.at_rest": True, "scene.first_mask": "/somewhere/mask0.png"})
    path = result.save_prepared(tmp_path / "clip.npz", made_prepared, settings)
    back = result.load_prepared(path)
    assert store.save(tmp_path / "again.npz", back).read_bytes() == store.save(tmp_path / "first.npz", made_prepared).read_bytes()
    assert back.body.sources == {"density": "mass_kg"}
    np.testing.assert_array_equal(back.modal.frequencies(back.start.young), made_prepared.modal.frequencies(made_prepared.start.young))


def test_a_prepared_clip_brings_its_settings(tmp_path: Path, made_prepared: Prepared) -> None:
    path = result.save_prepared(tmp_path / "clip.npz", made_prepared, config.build({"scene.at_rest": True, "experiment.image_weight": 0.7}))
    settings = config.layered(flags={"experiment.image_weight": 0.5}, base=result.stored_settings(path))
    assert (settings.scene.at_rest, settings.experiment.image_weight) == (True, 0.5)


def test_a_prepared_clip_with_settings_of_another_version_is_refused(tmp_path: Path, made_prepared: Prepared) -> None:
    settings = config.flat(config.Settings())
    settings["fit.seed"] = settings.pop("experiment.seed")
    path = store.save(tmp_path / "clip.npz", {"prepared": made_prepared, "settings": settings})
    with pytest.raises(InputError, match=r"clip\.npz: holds settings of another version; write it again with 'diffphys ingest'"):
        result.stored_settings(path)


def test_a_recovery_is_no_prepared_clip(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    with pytest.raises(InputError, match="diffphys ingest"):
        result.load_prepared(result.save(made_recovery, made_clip, config.Settings(), tmp_path))


def changed(array: np.ndarray, value: float) -> np.ndarray:
    """A copy with its first number replaced."""
    copy = array.copy()
    copy.reshape(-1)[0] = value
    return copy


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("period_s", lambda a: np.ones(2), r"period_s is of shape \(2,\), must be \(\)"),
        ("mass_damping", lambda a: a * np.nan, "mass_damping must be finite"),
        ("stiffness_damping", lambda a: np.ones(2), r"stiffness_damping is of shape \(2,\)"),
        ("substeps", lambda a: np.array("many"), "substeps is of <U4, must be whole"),
        ("grid_size", lambda a: a[:2], r"grid_size is of shape \(2,\)"),
        ("grid_size", lambda a: a * 10**6, "the grid has more than 100000000 nodes"),
        ("points", lambda a: a.T, "points is of shape"),
        ("force", lambda a: a[:, :-1], r"force is of shape \(12, 39, 3\), must be \(T = 12, N = 40, 3 = 3\)|force is of shape"),
        ("trajectory", lambda a: a[:-1], "trajectory is of shape"),
        ("volume", lambda a: changed(a, np.nan), "volume must be finite"),
        ("volume", lambda a: changed(a, -1), "volume must be > 0 everywhere"),
        ("part", lambda a: changed(a, 3), "numbers of parts lie beyond 1 .. 2"),
        ("reasons", lambda a: a[:1], "there is not one reason per part"),
        ("mpm_ghost", lambda a: ~a, "particles of the simulation are not those of the result"),
        ("mpm_young", lambda a: a.astype(int), "young is of int64, must be positive"),
        ("mpm_poisson", lambda a: changed(a, 0.5), "Poisson's ratio lies beyond 0.5"),
    ],
)
def test_a_result_whose_arrays_do_not_fit_each_other_is_refused(tmp_path: Path, made_recovery: Recovery, made_clip: Clip, name: str, change, said: str) -> None:  # type: ignore[no-untyped-def]
    arrays = store.read_arrays(result.save(made_recovery, made_clip, config.Settings(), tmp_path), "recovery")
    store.write_arrays(tmp_path / result.RECOVERY, arrays | {name: change(arrays[name])})
    with pytest.raises(InputError, match=f"recovery {tmp_path}/recovery.npz: .*{said}") as caught:
        result.load(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["[1, 2]", "3", "{", "[" * 100_000, "\udcff"])
def test_metrics_that_are_no_object_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / result.METRICS).write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match=r"metrics .*; recover the clip again"):
        result.read_metrics(tmp_path)


def with_outline(path: Path, change) -> Path:  # type: ignore[no-untyped-def]
    arrays = store.read_arrays(path, "clip")
    return store.write_arrays(path, arrays | {"outline": np.array(change(str(arrays["outline"])))})


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text[:-5],
        lambda text: "[" * 100_000,
        lambda text: '{"dict":{"a":' * 60 + "1" + "}}" * 60,
        lambda text: text.replace('"class": "Clip"', '"class": "ModalModel"'),
        lambda text: text.replace('"class": "Clip"', '"class": "Path"'),
        lambda text: text.replace('"class": "Clip"', '"class": ["Clip"]'),
        lambda text: text.replace('"frames": {"array": "array_000"}', '"frames": "array_000"'),
        lambda text: text.replace('"noise_m": 0.0001', '"noise_m": "small"'),
        lambda text: text.replace('"mass_damping": 0.1', '"mass_damping": "small"'),
        lambda text: text.replace('"mass_damping": 0.1, ', ""),
        lambda text: text.replace('"has_free_tail": true', '"has_free_tail": 1'),
        lambda text: text.replace('"start_ns": 17', '"start_ns": 9' + "9" * 30 + "17"),
        lambda text: text.replace("array_000", "array_999"),
        lambda text: '{"dict": []}',
        lambda text: "null",
    ],
)
def test_a_prepared_clip_whose_outline_is_not_ours_is_refused(tmp_path: Path, made_prepared: Prepared, change) -> None:  # type: ignore[no-untyped-def]
    path = result.save_prepared(tmp_path / "clip.npz", made_prepared, config.Settings())
    assert result.load_prepared(path).tracks.noise_m == 1e-4
    with_outline(path, change)
    with pytest.raises(InputError, match="diffphys ingest") as caught:
        result.load_prepared(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("where", "change", "said"),
    [
        ("tracks", {"valid": np.ones((3, 7), bool)}, r"valid is of shape \(3, 7\)"),
        ("body", {"part": np.full((4, 3), 3, np.uint8)}, "numbers of parts lie beyond 1 .. 2"),
        ("body", {"pitch_m": float("nan")}, "pitch_m must be finite"),
        ("start", {"young": np.ones(3)}, r"young is of shape \(3,\)"),
        ("start", {"damping": Damping(np.inf, 1e-3)}, "mass_damping must be finite"),
        ("start", {"reasons": ()}, "one reason per part"),
        ("modal", {"tets": np.full((1, 10), 99)}, "elements name nodes that there are none of"),
        ("clip", {"labels": None}, "clip is without labels"),
        ("clip", {"period_s": 0.0}, "period_s must be > 0"),
    ],
)
def test_a_prepared_clip_whose_arrays_do_not_fit_each_other_is_refused(tmp_path: Path, made_prepared: Prepared, where: str, change: dict, said: str) -> None:
    odd = dataclasses.replace(made_prepared, **{where: dataclasses.replace(getattr(made_prepared, where), **change)})
    with pytest.raises(InputError, match=f"clip .*{said}.*; write it again with 'diffphys ingest'"):
        result.load_prepared(result.save_prepared(tmp_path / "clip.npz", odd, config.Settings()))
