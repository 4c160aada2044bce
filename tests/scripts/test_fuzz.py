"""Claims about the runner of hostile cases, on toy doors: it notices whatever a case may do beside its answer, and goes on."""

from __future__ import annotations

import gc
import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAD = "import ctypes, os, sys, time\nfrom pathlib import Path\n\nCOUNT = 200\nKEPT = []\n\n\ndef case(seed, folder):\n    (folder / 'mine').write_text('hostile')\n"
BAD = 2  # the seed that does what the door is named for


@pytest.fixture(scope="module")
def runner() -> Iterator[ModuleType]:
    sys.path.insert(0, str(ROOT / "scripts"))
    spec = importlib.util.spec_from_file_location("fuzz_runner", ROOT / "scripts" / "fuzz.py")
    assert spec is not None
    assert spec.loader is not None
    sys.modules["fuzz_runner"] = module = importlib.util.module_from_spec(spec)  # "fuzz" is what pytest calls tests/fuzz
    spec.loader.exec_module(module)
    yield module
    sys.path.remove(str(ROOT / "scripts"))


def door(folder: Path, does: str) -> Path:
    path = folder / "toy.py"
    path.write_text(f"{HEAD}    if seed == {BAD}:\n        {does}\n    return 'refused' if seed % 2 else 'taken'\n")
    return path


def ran(runner: ModuleType, path: Path, **limits: float):
    return runner.run("toy", path, range(5), limits=runner.Limits(**{"growth": 100 << 20, "room_without_torch": 1 << 30, **limits}))


@pytest.mark.parametrize(
    ("does", "told"),
    [
        ("time.sleep(60)", "hangs: no end after 1 s"),
        ("sum(0 for _ in iter(int, 1))", "hangs"),
        ("os._exit(0)", "ended the process by status 0"),
        ("ctypes.string_at(0)", "ended the process by SIGSEGV"),
        ("raise KeyError('lost')", "KeyError: 'lost'"),
        ("raise SystemExit(2)", "SystemExit: 2"),
        ("return None", "answered None, neither taken nor refused"),
        ("bytearray(os.urandom(1 << 20) * 200)", "memory grew by"),
        ("bytearray(1 << 31)", "emory"),
        ("Path('left').write_text('')", "made cwd/left outside its folder"),
        ("(Path.home() / '.cache').mkdir()", "made home/.cache outside its folder"),
        ("(folder.parent / 'beside').mkdir()", "made beside outside its folder"),
        ("open('/tmp/diffphys_fuzz_far', 'w').close()", "open of '/tmp/diffphys_fuzz_far' outside the scratch folder"),
    ],
)
def test_what_a_case_must_not_do_is_a_fault_with_its_seed_and_the_others_run(runner, tmp_path, does, told):
    outcome = ran(runner, door(tmp_path, does), case_s=1.0 if "hangs" in told else 30.0)
    Path("/tmp/diffphys_fuzz_far").unlink(missing_ok=True)
    assert [fault.seed for fault in outcome.faults] == [BAD]
    assert told in str(outcome.faults[0])
    assert (outcome.taken, outcome.refused) == (2, 2)


LEAKING = HEAD + "    KEPT.append(bytearray(os.urandom(1 << 20) * 64))\n    return 'taken'\n"  # more than malloc takes from what it was given back


def test_memory_that_many_cases_leave_behind_is_a_fault(runner, tmp_path):
    (tmp_path / "toy.py").write_text(LEAKING)
    outcome = ran(runner, tmp_path / "toy.py", growth=150 << 20)
    assert [0 < fault.seed < 4 for fault in outcome.faults] == [True]  # none of 64 MB is too much alone, all five are
    assert "over the cases so far" in str(outcome.faults[0])


def test_garbage_of_the_process_that_starts_the_workers_hides_no_leak(runner, tmp_path):
    """A worker is a copy of it; garbage that is freed during a case must not be counted as what the case gave back."""
    (tmp_path / "toy.py").write_text(LEAKING.replace("    return", "    import gc; gc.collect()\n    return"))
    ring: list[object] = [bytearray(os.urandom(1 << 20) * 400)]
    ring.append(ring)
    gc.disable()
    try:
        del ring
        outcome = ran(runner, tmp_path / "toy.py", growth=150 << 20)
    finally:
        gc.enable()
    assert len(outcome.faults) == 1


def test_a_warning_of_the_library_is_a_fault_and_one_of_a_door_is_none(runner, tmp_path):
    theirs = "import numpy; numpy.zeros(1) / 0"
    assert not ran(runner, door(tmp_path, theirs)).faults
    ours = "import numpy; from diffphys_ros.types import transformed; transformed(numpy.full((4, 4), 1e308), numpy.full((1, 3), 1e308))"
    outcome = ran(runner, door(tmp_path, ours))
    assert "RuntimeWarning: overflow" in str(outcome.faults[0])
    assert "diffphys_ros/types.py" in str(outcome.faults[0])


def test_seeds_that_failed_are_kept_once_and_run_first(runner, tmp_path, capsys):
    path = door(tmp_path, "raise KeyError('lost')")
    assert runner.main([str(path), "--cases", "5", "--jobs", "1", "--keep"]) == 1
    assert "FAULT  toy seed 2: KeyError: 'lost'" in capsys.readouterr().out
    assert runner.kept(path) == [BAD]
    assert runner.main([str(path), "--cases", "1", "--jobs", "1", "--keep"]) == 1
    assert runner.kept(path) == [BAD]
    assert "1 taken" in capsys.readouterr().out


def test_a_run_without_faults_ends_with_status_0_in_any_number_of_processes(runner, tmp_path, capsys):
    path = door(tmp_path, "pass")
    for jobs in ("1", "3"):
        assert runner.main([str(path), "--share", "0.5", "--jobs", jobs]) == 0
        assert "50 taken      50 refused     0 faults" in capsys.readouterr().out


def test_an_unknown_door_is_status_2(runner, capsys):
    assert runner.main(["cellar"]) == 2
    assert "there is no door 'cellar'" in capsys.readouterr().err


def test_a_door_that_lacks_a_package_is_left_out_and_said(runner, tmp_path):
    path = tmp_path / "toy.py"
    path.write_text("import no_such_package\nCOUNT = 1\n")
    assert runner.run("toy", path, range(1)).left_out == "there is no module no_such_package"
