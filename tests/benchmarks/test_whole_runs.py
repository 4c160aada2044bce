"""Claims about whole recoveries with a number of the first engine multiplied."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.script import loaded

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "benchmarks" / "whole_runs.py"
LOOK = "import sys; sys.argv[1:] = ['x']; import whole_runs, diffphys_ros.__main__ as cli; cli.main = lambda words: print(words, __import__('importlib').import_module('diffphys_ros.start.free_tail').DETUNED) or 0; sys.exit(whole_runs.child({what!r}, ['CLIP']))"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(SCRIPT.parent)
    return loaded(SCRIPT)


@pytest.mark.slow
@pytest.mark.parametrize(("what", "value"), [('["start.free_tail", "DETUNED", 2.0]', 8), ("[]", 4)])
def test_a_recovery_sees_the_multiplied_number(what: str, value: int) -> None:
    done = subprocess.run([sys.executable, "-c", LOOK.format(what=what)], cwd=SCRIPT.parent, env={"PYTHONPATH": f"{ROOT}:{SCRIPT.parent}"}, capture_output=True, text=True, check=False)
    assert done.stdout.split("]")[1].split() == [str(value)], done.stderr


def test_the_numbers_tried_are_the_first_of_the_table_of_the_first_engine(module) -> None:
    table = (ROOT / "docs" / "measurements" / "sensitivity.md").read_text()
    first = [line.split("`")[1] for line in table.splitlines() if line.startswith("| `")][:3]
    assert [str(number) for number in module.strongest(3)] == first


def test_rows_of_another_kind_of_file_are_asked_for(module, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(module, "RESULTS", tmp_path)
    assert module.main([str(tmp_path)]) == 2
    assert "run benchmarks/sensitivity.py --record first" in capsys.readouterr().err


def test_a_recovery_that_fails_is_a_sentence_in_its_row(module, tmp_path) -> None:
    (tmp_path / "given.yaml").write_text("scene: {mass_kg: -1}\n")
    found = module.recovered(tmp_path, None, 1.0, [])
    assert isinstance(found, str)
    assert found.startswith("diffphys: config ")
