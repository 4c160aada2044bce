"""Claims about the calibration: seeds that nobody chooses, and what its table counts."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml

from diffphys_ros.errors import InputError
from tests.script import loaded

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
COMMIT = "8e3fe4a9299a7321a1e65ee59d94973bc8ad6e21"


@pytest.fixture
def calibration(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return loaded(BENCHMARKS / "calibration.py")


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return loaded(BENCHMARKS / "calibration_table.py")


def row(errors: list[float | None], sd: list[float | None], *, lower: list[float | None] | None = None, **more: object) -> dict[str, object]:
    return {"kind": "mass", "materials": len(errors), "state": "done", "push": "gust", "young_log10_error": errors, "young_log10_sd": sd, "young_lower_log10": lower} | more


def cell(tables: ModuleType, rows: list[dict[str, object]], name: str) -> str:
    return next(line[1] for line in tables.table(rows, ["mass"]) if line[0] == name)


def test_the_confirmation_seeds_follow_from_the_commit_alone(calibration) -> None:
    seeds = calibration.confirmation_seeds(COMMIT, 60)
    assert seeds == calibration.confirmation_seeds(COMMIT, 60)
    assert len(set(seeds)) == 60
    assert not set(seeds) & set(range(1000))
    assert not set(seeds) & set(calibration.confirmation_seeds(COMMIT[::-1], 60))


def test_right_deviations_hold_as_many_truths_as_they_say(tables) -> None:
    rng = np.random.default_rng(0)
    parts = tables.parts_of([row([float(e)], [0.1]) for e in 0.1 * rng.standard_normal(4000)])
    assert [tables.coverage(parts, share) for share in tables.INTERVALS] == pytest.approx(tables.INTERVALS, abs=0.025)


def test_a_part_without_a_modulus_is_counted_and_not_scored(tables) -> None:
    rows = [row([0.01, None], [0.02, None], lower=[None, -0.5]), row([0.5, 0.3], [0.1, 0.2]), row([None, None], [None, None], lower=[0.1, -2.0])]
    assert cell(tables, rows, "inside 2 sd") == "2 of 3"
    assert cell(tables, rows, "beyond 3 sd") == "1 of 3"
    assert cell(tables, rows, "parts at the clamp that are not identified") == "1 of 3"
    assert cell(tables, rows, "outer parts that are not identified") == "2 of 3"
    assert cell(tables, rows, "least moduli that are true") == "2 of 3"
    assert cell(tables, rows, "and within a factor of 10") == "1 of 3"


def test_a_part_with_a_least_modulus_is_not_published_whatever_points_of_its_neighbour_carry(tables) -> None:
    rows = [row([0.01, 0.3], [0.02, 0.02], lower=[None, -0.5])]
    assert cell(tables, rows, "inside 2 sd") == "1 of 1"
    assert cell(tables, rows, "outer parts that are not identified") == "1 of 1"


def test_the_force_s_deviations_are_counted_by_clip_and_its_peaks_one_by_one(tables) -> None:
    clips = [(0.5, 0.9, 1.1, 0.2), (0.7, 1.0, 2.0, 0.4), (0.9, 0.8, 0.9, 0.01)]  # inside one and two deviations; peak and its deviation, of a true one of 1
    names = ("net_force_inside_1sd", "net_force_inside_2sd", "force_peak_stated_n", "force_peak_sd_n")
    rows = [row([0.0], [0.1]) | dict(zip(names, clip, strict=True)) | {"force_peak_true_n": 1.0, "push": "gust"} for clip in clips]
    assert cell(tables, rows, "its components inside 1 sd, 2 sd, median over clips: gusts") == "70%, 90%"
    assert cell(tables, rows, "the same, pokes") == "-"
    assert cell(tables, rows, "peaks inside 1 sd") == "1 of 3"
    assert cell(tables, rows, "peaks inside 2 sd") == "1 of 3"
    assert cell(tables, rows, "stated peak of the net force over the true one: median") == "1.10"


def test_a_run_that_ended_without_a_result_is_counted(tables) -> None:
    rows = [row([0.0], [0.1]), row([None], [None], state="failed")]
    assert cell(tables, rows, "runs that end without a result") == "1"
    assert cell(tables, rows, "published parts inside 1 sd") == "1 of 1"


@pytest.mark.parametrize("name", ["confirmation", "first"])
def test_seeds_that_were_chosen_are_no_confirmation(calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(calibration, "_full", lambda name: name)
    (tmp_path / "run.json").write_text(json.dumps({"set": name, "commit": COMMIT, "seeds": [1, 2, 3]}))
    with pytest.raises(InputError, match="not those of commit 8e3fe4a"):
        calibration.rows_of(tmp_path, "any")


def test_rows_of_other_sources_are_refused(calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"set": "choice", "commit": COMMIT, "seeds": [1]}))
    (tmp_path / "results" / "g1-told-0123abcd").mkdir(parents=True)
    monkeypatch.setattr(calibration, "read_status", lambda folder: SimpleNamespace(state="done", scored="x", version="other"))
    with pytest.raises(InputError, match="other sources"):
        calibration.rows_of(tmp_path, "these")


def test_the_page_shows_the_tables_of_the_stored_rows(calibration) -> None:
    assert calibration.main(["--check"]) == 0, "run: python benchmarks/calibration.py --tables"


def test_every_set_of_rows_has_its_table_in_one_page(calibration) -> None:
    pages = "".join(page.read_text() for page in (calibration.PAGE, calibration.IN_SHORT))
    assert [pages.count(f"<!-- calibration {name} -->") for name in calibration.SETS] == [1] * len(calibration.SETS)


def test_rows_without_a_place_for_their_table_are_refused(calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    page = tmp_path / "page.md"
    page.write_text(calibration.PAGE.read_text().replace("<!-- calibration kinds -->", ""))
    monkeypatch.setattr(calibration, "PAGE", page)
    assert calibration.main(["--check"]) == 2
    assert "have no place <!-- calibration kinds --> ... <!-- end calibration kinds -->" in capsys.readouterr().err


def test_a_short_table_has_a_line_for_each_kind_with_figures_of_the_long_one(tables) -> None:
    rows = [row([0.004], [0.01], kind="told"), row([0.04], [0.01])]
    head, _, *lines = tables.in_short(rows, ["told", "mass"])
    assert [line[0] for line in lines] == ["densities told", "mass told"]
    assert [line[head.index("beyond 3 sd")] for line in lines] == ["0 of 1", "1 of 1"]


@pytest.mark.parametrize("words", [["OUT"], ["OUT", "--seeds", "1-2", "--confirm", "3"], ["OUT", "--seeds", "few"], ["OUT", "--seeds", "1-2", "--first"]])
def test_a_run_without_one_set_of_seeds_is_refused(calibration, words: list[str], tmp_path: Path, capsys) -> None:
    assert calibration.main([str(tmp_path), *words[1:]]) == 2
    assert "--seeds" in capsys.readouterr().err


def test_kinds_that_look_at_the_same_scene_have_it_made_once_and_those_of_one_seed_side_by_side(calibration, tmp_path: Path) -> None:
    clips, asked, together = calibration.clips_of.__globals__, [], threading.Barrier(2, timeout=30)

    class Scenes(clips["Maker"]):
        def make(self, seed: int, flags: tuple[str, ...], out: Path) -> None:
            asked.append((seed, flags))
            together.wait()  # both scenes of the seed are being made
            out.mkdir(parents=True)
            for name in ("clip.mcap", "mask0.png", "stats.json"):
                (out / name).touch()
            np.savez(out / "truth.npz", part_rho=[600.0])
            (out / "given.yaml").write_text("scene: {mass_kg: 1.0}\n")

    kinds = [clips["KINDS"][name] for name in ("told", "mass", "hook")]
    made = calibration.clips_of([7], kinds, tmp_path, Scenes(tmp_path), 2)
    assert sorted(asked) == [(7, ()), (7, ("--family", "hook"))]
    assert [path.name for path in made] == ["g7-told", "g7-mass", "g7-hook"]
    assert "density_kg_m3" in (made[0] / "given.yaml").read_text()
    assert "mass_kg" in (made[1] / "given.yaml").read_text()


def test_a_scene_that_cannot_be_made_takes_no_other_with_it(calibration, tmp_path: Path, capsys) -> None:
    clips = calibration.clips_of.__globals__

    class Scenes(clips["Maker"]):
        def _call(self, words: list[str], out: Path) -> None:
            if "7" in words or ("8" in words and "--moving-start" in words):
                raise InputError(f"make_scene.py {out.name}: a step does not converge")
            out.mkdir(parents=True)
            for name in ("clip.mcap", "mask0.png", "stats.json"):
                (out / name).touch()
            np.savez(out / "truth.npz", part_rho=[600.0])
            (out / "given.yaml").write_text("scene: {mass_kg: 1.0}\n")

    kinds = [clips["KINDS"][name] for name in ("told", "moving")]
    assert [path.name for path in calibration.clips_of([7, 8, 9], kinds, tmp_path, Scenes(tmp_path), 1)] == ["g8-told", "g9-told", "g9-moving"]
    assert "g8-moving-start: a step does not converge" in capsys.readouterr().err
    with pytest.raises(InputError, match="g7: a step does not converge"):
        calibration.clips_of([7], kinds, tmp_path, Scenes(tmp_path), 1)


def test_a_clip_of_colour_alone_has_no_depth_topic_and_a_plain_one_is_made_by_our_own_maker(calibration, tmp_path: Path) -> None:
    clips, made = calibration.clips_of.__globals__, []

    class Scenes(clips["Maker"]):
        def _call(self, words: list[str], out: Path) -> None:
            made.append((Path(words[0]).name, "--plain" in words))
            out.mkdir(parents=True)
            for name in ("clip.mcap", "mask0.png", "stats.json"):
                (out / name).touch()
            np.savez(out / "truth.npz", part_rho=[600.0])
            (out / "given.yaml").write_text("scene: {mass_kg: 1.0}\ntopics: {color: a}\n")

    folders = calibration.clips_of([7], [clips["KINDS"][name] for name in ("told", "colour", "plain")], tmp_path, Scenes(tmp_path), 1)
    assert made == [("make_scene.py", False), ("other_scenes.py", True)]
    assert [yaml.safe_load((folder / "given.yaml").read_text())["topics"] for folder in folders] == [{"color": "a"}, {"color": "a", "depth": "none"}, {"color": "a", "depth": "none"}]


def test_rows_of_outlines_stand_beside_those_of_points_on_the_same_seeds(calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "RESULTS", tmp_path)
    about = {"device": "d", "versions": "v", "commit": "c"}
    stored = {"evidence": [row([0.01], [0.02], kind="plain", seed=5, **about)], "choice": [row([0.01], [0.02], kind="told", seed=n, **about) for n in (5, 6)]}
    for name, rows in stored.items():
        (tmp_path / f"calibration-{name}.json").write_text(json.dumps(rows))
    shown = calibration._shown("evidence")
    assert sorted((each["kind"], each["seed"]) for each in shown) == [("plain", 5), ("told", 5)]
    assert "| densities told | outline, colour alone |" in calibration._tables(shown)
    assert [calibration._set_of(kind) for kind in ("told", "plain", "hook")] == ["choice", "evidence", "kinds"]


def test_scenes_of_the_second_truth_are_made_by_its_own_script(calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import calibration_clips as clips

    asked: list[list[str]] = []
    monkeypatch.setattr(clips.Maker, "_call", lambda self, words, out: asked.append(list(words)))
    clips.Maker(tmp_path).make(7, clips.KINDS["second"].scene, tmp_path / "s")
    clips.Maker(tmp_path).make(7, clips.KINDS["hook"].scene, tmp_path / "h")
    clips.Maker(tmp_path).make(7, (), tmp_path / "o")
    assert [Path(words[0]).name for words in asked] == ["second_truth.py", "other_scenes.py", "make_scene.py"]
    assert clips.SECOND not in asked[0]


def test_what_is_relative_is_judged_as_relative(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    known = loaded(BENCHMARKS / "calibration_known.py")
    specific = {"specific_log10_error": [0.01, 0.5], "specific_log10_sd": [0.02, 0.1]}
    absolute, weightless, sizeless = (
        row([0.3, 1.5], [0.1, 0.3], scale=scale, **specific) for scale in ("absolute", "relative: nobody told a mass or a density, so ...", "relative: nobody told a length, so ...")
    )
    assert [tuple(one) for one in known.told_by(absolute)] == [(0.3, 0.1), (1.5, 0.3)]
    assert [tuple(one) for one in known.told_by(weightless)] == [(0.01, 0.02), (0.5, 0.1)]
    assert [tuple(one) for one in known.told_by(sizeless)] == [pytest.approx((1.2, np.hypot(0.1, 0.3)))]
    assert known.told_by(row([0.3], [0.1], scale="relative: nobody told a length")) == []  # of one part there is no ratio
    assert known.told_by(row([None], [None], scale="absolute")) == []


def test_the_table_of_what_is_known_counts_what_is_confident_and_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    known = loaded(BENCHMARKS / "calibration_known.py")
    rows = [
        row([0.01, 0.5], [0.02, 0.1], kind="mass", scale="absolute", observed_hz=2.02, hz=2.0, force_identified=True, net_force_cosine=0.9),
        row([None, None], [None, None], kind="mass", scale="absolute", observed_hz=1.98, hz=2.0, force_identified=False, net_force_cosine=0.1),
    ]
    cells = {line[0]: line[1] for line in known.table(rows, ["mass"])}
    assert cells["confident and wrong: beyond 3 sd"] == "1 of 2"
    assert cells["parts that are identified"] == "2 of 4"
    assert cells["stiffness is told as"] == "E"
    assert cells["leading frequency, error over it: median"] == "1.0%"
    assert (cells["forces that are identified"], cells["their cosine, median"]) == ("1 of 2", "0.900")


def test_a_kind_that_is_told_less_is_given_less(calibration) -> None:
    clips = calibration.clips_of.__globals__
    scene = {"mass_kg": 1.0, "thickness_m": 0.04, "thickness_axis": [0, 1, 0], "gravity_m_s2": [0, 0, -9.81], "clamp_box_m": [0] * 6, "at_rest": True, "first_mask": "mask0.png"}

    def told(name: str) -> dict[str, object]:
        return clips["_clip"].__globals__["_told"]({"scene": dict(scene)}, clips["KINDS"][name], {"part_rho": [600.0]})

    assert told("nothing_depth") == {"scene": {}}
    assert told("nothing_colour_mask") == {"scene": {"first_mask": "mask0.png"}, "topics": {"depth": "none"}}
    assert set(told("clamp")["scene"]) == {"first_mask", "clamp_box_m", "gravity_m_s2", "at_rest"}
    assert set(scene) - set(told("thickness")["scene"]) == {"mass_kg"}
    assert [calibration._set_of(name) for name in ("nothing_depth", "thickness", "mass")] == ["known", "known", "choice"]
