"""Claims about the benchmark that halves and doubles numbers: what it lists is there, a multiplied number reaches all who read it, and no one else."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.script import loaded

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture(scope="module")
def deciding() -> ModuleType:
    return loaded(BENCHMARKS / "deciding.py")


@pytest.fixture
def sensitivity(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return loaded(BENCHMARKS / "sensitivity.py")


def seen(number: str, factor: float, *looked_at: str) -> list[object]:
    """Expressions of numbers `module.path` as a process sees them in which a number is multiplied."""
    module, _, path = number.partition(":")
    code = f"""
import importlib, json, sys
sys.path.insert(0, {str(BENCHMARKS)!r})
from deciding import Number, multiply
multiply(Number.of({module!r}, {path!r}), {factor})
look = lambda at: eval(at.partition(":")[2], vars(importlib.import_module("diffphys_ros." + at.partition(":")[0])))
print(json.dumps([look(at) for at in {looked_at!r}]))
"""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return json.loads(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment).stdout)


def test_the_list_holds_at_most_60_numbers_each_once(deciding: ModuleType) -> None:
    names = [str(number) for number in deciding.numbers()]
    assert 0 < len(names) == len(set(names)) <= deciding.MOST == 60


def test_each_number_of_the_list_exists_is_explained_and_differs_from_its_half_or_its_double(deciding: ModuleType) -> None:
    for number in deciding.numbers():
        value = number.value()
        assert type(value) in (int, float, np.float64), number
        assert any(number.once(value, factor) != value for factor in (0.5, 2.0)), number
        assert number.comment(), f"{number}: say beside it what it is"
        assert number.source(), f"{number}: say beside it where it comes from"
    units = deciding.Number.of("start.free_tail", "MASS_DAMPING_SD")
    assert (units.comment(), units.source()) == ("weak priors [1/s], [s]: soft solids damp by their strain rate", "chosen")


@pytest.mark.slow
def test_a_multiplied_number_reaches_copies_values_made_of_it_and_default_arguments() -> None:
    of_frequency = ["start.free_tail:FREQUENCY_SD", "start.uncertainty:FREQUENCY_SD", "start.values:FREQUENCY_SD"]
    assert seen("start.free_tail:FREQUENCY_SD", 2.0, *of_frequency) == [0.012, 0.012, 0.012]
    assert seen("start.along:AXIAL_SHARE", 0.5, "start.along:DEARER") == [40.0]
    assert seen("start.zones:LEVELS[2]", 2.0, "start.zones:LEVELS", "start.zones:_ZoneFit.settled.__kwdefaults__") == [[0.4, 0.2, 0.2], {"levels": [0.2]}]


@pytest.mark.slow
def test_a_multiplied_number_leaves_others_of_its_line_and_of_its_name_alone() -> None:
    assert seen("start.values:ALARM_NOISE", 2.0, "start.values:ALARM_NOISE", "start.values:ALARM_SHARE") == [10.0, 0.12]
    assert seen("vibration.coordinates:LEAST_SHARE", 2.0, "vibration.coordinates:LEAST_SHARE", "start.zone_layout:LEAST_SHARE") == [0.05, 0.3]


@pytest.mark.slow
def test_a_number_within_a_class_can_be_multiplied() -> None:
    assert seen("inverse.prior:Prior.POISSON", 2.0, "inverse.prior:Prior.POISSON", "inverse.prior:Prior.DAMPING") == [4e-3, 2e-3]


@pytest.mark.slow
def test_nothing_leaks_into_a_process_that_has_read_the_number(deciding: ModuleType) -> None:
    number = deciding.Number.of("start.free_tail", "FREQUENCY_SD")
    before, finders = number.value(), list(sys.meta_path)
    with pytest.raises(RuntimeError, match="imported before"):
        deciding.multiply(number, 2.0)
    assert sys.meta_path == finders
    assert seen("start.free_tail:FREQUENCY_SD", 2.0, "start.free_tail:FREQUENCY_SD") == [2 * before]
    assert seen("start.free_tail:RATIO_SD", 2.0, "start.free_tail:FREQUENCY_SD") == [before]  # no bytecode of the other process is read
    assert number.value() == before


def test_whole_numbers_are_rounded_and_shares_end_at_their_bound(deciding: ModuleType) -> None:
    whole, share = deciding.Number("m", "N"), deciding.Number.of("m", "SHARE<=1")
    assert [whole.once(v, 0.5) for v in (1, 2, 7)] == [1, 1, 4]
    assert all(isinstance(whole.once(v, 0.5), int) for v in (1, 2, 7))
    assert [share.once(0.7, 2.0), share.once(0.7, 0.5)] == [1.0, 0.35]
    assert deciding.Number("m", "A[1]").times((1.0, 2.0), 2.0) == (1.0, 4.0)
    assert deciding.Number("m", "A[0]").times(np.array([1.0, 2.0]), 2.0).tolist() == [2.0, 2.0]


def answer(**changed: object) -> dict[str, object]:
    plain = {"log10_young": [5.0, 4.0], "sd": [0.1, 0.4], "identified": [True, False], "forced": 9, "net_force_n": [[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]], "doubts": []}
    return plain | changed


def test_a_change_counts_parts_that_are_identified_before_or_after(sensitivity: ModuleType) -> None:
    none = {"young": 0.0, "sd": 0.0, "flags": 0, "frames": 0, "doubts": 0, "force": 0.0}
    assert sensitivity.change(answer(), answer(log10_young=[5.0, 7.0]), None) == none
    moved = sensitivity.change(answer(), answer(log10_young=[5.1, 7.0], identified=[True, True], forced=7, doubts=["jump"]), np.array([5.0, 6.0]))
    assert moved == {"young": 3.0, "sd": 0.0, "flags": 1, "frames": -2, "doubts": 1, "force": 0.0, "error": [0.0, 1.0]}
    assert sensitivity.change(answer(), answer(net_force_n=[[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), None)["force"] == 0.5
    assert sensitivity.change(answer(), answer(sd=[0.05, 0.4]), None)["sd"] == 1.0  # half as wide is as far off as twice


@pytest.mark.slow
def test_a_process_that_fails_or_hangs_is_an_outcome(sensitivity: ModuleType, tmp_path: Path) -> None:
    told = tmp_path / "told.pickle"
    told.write_bytes(pickle.dumps({}))
    crashed, hung = sensitivity.answered(told, None, 1.0), sensitivity.answered(told, None, 1.0, timeout_s=0.01)
    assert crashed == {"failed": "KeyError: 'body'"}
    assert hung == {"failed": "no answer within 0.01 s"}
    assert sensitivity.change(answer(), hung, None) == hung


def test_the_strongest_number_stands_first_and_one_without_effect_decides_in_no_clip(sensitivity: ModuleType) -> None:
    def row(name: str, **changed: object) -> dict[str, object]:
        halved = {"young": 0.0, "flags": 0, "frames": 0, "doubts": 0, "force": 0.0} | changed
        return {"name": name, "value": 1.0, "what": "", "source": "", "halved": {"value": 0.5, "clips": {"clip": halved}}, "doubled": {"value": 1.0, "clips": {}}}

    rows = [row("m.calm"), row("m.moves", young=0.2), row("m.flips", flags=1), {**row("m.ends"), "halved": {"value": 0.5, "clips": {"clip": {"failed": "E"}}}}]
    _, *lines = sensitivity.effects(rows)
    assert [line[0] for line in lines] == ["`m.ends`", "`m.flips`", "`m.moves`", "`m.calm`"]
    assert [line[-1] for line in lines] == ["clip", "clip", "clip", "-"]
    assert lines[-1][4:6] == ["nothing", "stays as it is"]
