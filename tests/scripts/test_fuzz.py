"""Claims about the runner of hostile cases, on toy doors: it notices whatever a case may do beside its answer, and goes on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "scripts" / "fuzz.py"
HEAD = "import ctypes, os, sys, time\nfrom pathlib import Path\n\nCOUNT = 200\nKEPT = []\n\n\ndef case(seed, folder):\n    (folder / 'mine').write_text('hostile')\n"
BAD = 2  # the seed that does what the door is named for
RUN = """
import gc, json, os, sys
from pathlib import Path
from fuzz import Limits, run
{before}
outcome = run("toy", Path(sys.argv[1]), range(5), limits=Limits(**json.loads(sys.argv[2])))
print(json.dumps([outcome.taken, outcome.refused, [[fault.seed, str(fault)] for fault in outcome.faults]]))
"""


@dataclass(frozen=True)
class Ran:
    """What came of five cases: answers by kind, and for every fault its seed and what it says."""

    taken: int
    refused: int
    faults: list[tuple[int, str]]


def door(folder: Path, does: str) -> Path:
    path = folder / "toy.py"
    path.write_text(f"{HEAD}    if seed == {BAD}:\n        {does}\n    return 'refused' if seed % 2 else 'taken'\n")
    return path


def ran(path: Path, before: str = "", **limits: float) -> Ran:
    """Five cases of a door, in workers of a process of their own: a worker is a copy of the process that starts it."""
    bounds = json.dumps({"growth": 100 << 20, "room_without_torch": 1 << 30, **limits})
    done = _python("-c", RUN.format(before=before), path, bounds)
    assert done.returncode == 0, done.stderr
    taken, refused, faults = json.loads(done.stdout.splitlines()[-1])
    return Ran(taken, refused, [(seed, told) for seed, told in faults])


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return _python(PROGRAM, *arguments)


def _python(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    search = f"{PROGRAM.parent}:{ROOT}"
    return subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": search})


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
def test_what_a_case_must_not_do_is_a_fault_with_its_seed_and_the_others_run(tmp_path, does, told):
    outcome = ran(door(tmp_path, does), case_s=1.0 if "hangs" in told else 30.0)
    Path("/tmp/diffphys_fuzz_far").unlink(missing_ok=True)
    assert [seed for seed, _ in outcome.faults] == [BAD], outcome.faults
    assert told in outcome.faults[0][1]
    assert (outcome.taken, outcome.refused) == (2, 2)


LEAKING = HEAD + "    KEPT.append(bytearray(os.urandom(1 << 20) * 64))\n    return 'taken'\n"  # more than malloc takes from what it was given back


def test_memory_that_many_cases_leave_behind_is_a_fault(tmp_path):
    (tmp_path / "toy.py").write_text(LEAKING)
    outcome = ran(tmp_path / "toy.py", growth=150 << 20)
    assert [0 < seed < 4 for seed, _ in outcome.faults] == [True], outcome.faults  # none of 64 MB is too much alone, all five are
    assert "over the cases so far" in outcome.faults[0][1]


def test_garbage_of_the_process_that_starts_the_workers_hides_no_leak(tmp_path):
    """Garbage that is freed during a case must not be counted as what the case gave back."""
    (tmp_path / "toy.py").write_text(LEAKING.replace("    return", "    import gc; gc.collect()\n    return"))
    garbage = "gc.disable(); ring = [bytearray(os.urandom(1 << 20) * 400)]; ring.append(ring); del ring"
    outcome = ran(tmp_path / "toy.py", before=garbage, growth=150 << 20)
    assert len(outcome.faults) == 1, outcome.faults


def test_a_worker_runs_no_finaliser_of_what_it_inherits(tmp_path):
    """Garbage of the parent may hold threads, sockets or libraries that a copy of the process has not got."""
    crash = "gc.disable(); Bomb = type('Bomb', (), {'__del__': lambda self: os._exit(7)}); ring = [Bomb()]; ring.append(ring); parent = os.getpid(); del ring"
    outcome = ran(door(tmp_path, "import gc; gc.collect()"), before=crash.replace("os._exit(7)", "os.getpid() == parent or os._exit(7)"))
    assert (outcome.faults, outcome.taken) == ([], 3)


def test_a_warning_of_the_library_is_a_fault_and_one_of_a_door_is_none(tmp_path):
    theirs = "import numpy; numpy.zeros(1) / 0"
    assert not ran(door(tmp_path, theirs)).faults
    ours = "import numpy; from diffphys_ros.types import transformed; transformed(numpy.full((4, 4), 1e308), numpy.full((1, 3), 1e308))"
    [(_, told)] = ran(door(tmp_path, ours)).faults
    assert "RuntimeWarning: overflow" in told
    assert "diffphys_ros/types/poses.py" in told


def test_seeds_that_failed_are_kept_once_and_run_first(tmp_path):
    path, kept = door(tmp_path, "raise KeyError('lost')"), tmp_path / "kept" / "toy.txt"
    first = command(path, "--cases", "5", "--jobs", "1", "--keep")
    assert first.returncode == 1
    assert "FAULT  toy seed 2: KeyError: 'lost'" in first.stdout
    once = kept.read_text()
    assert once.startswith(f"{BAD}  #")
    again = command(path, "--cases", "1", "--jobs", "1", "--keep")
    assert again.returncode == 1
    assert kept.read_text() == once
    assert "1 taken" in again.stdout


def test_a_run_without_faults_ends_with_status_0_in_any_number_of_processes(tmp_path):
    path = door(tmp_path, "pass")
    for jobs in ("1", "3"):
        done = command(path, "--share", "0.5", "--jobs", jobs)
        assert done.returncode == 0, done.stdout
        assert "50 taken      50 refused     0 faults" in done.stdout


def test_an_unknown_door_is_status_2():
    done = command("cellar")
    assert done.returncode == 2
    assert "there is no door 'cellar'" in done.stderr


def test_a_door_that_lacks_a_package_is_left_out_and_said(tmp_path):
    (tmp_path / "toy.py").write_text("import no_such_package\nCOUNT = 1\n")
    assert "there is no module no_such_package" in command(tmp_path / "toy.py").stdout
