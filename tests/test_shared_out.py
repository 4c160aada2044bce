"""Claims about which tests go to one worker."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("xdist")

from tests.shared_out import LONGEST, group_of, rank

GATES = "tests/gates/test_"


def test_gates_that_use_one_recovery_go_to_one_worker() -> None:
    strip = {group_of(f"{GATES}{name}") for name in ("strip.py::a", "evidence.py::b", "force.py::c[strip]", "spread.py::d[strip]", "doubts.py::e[strip]")}
    bar = {group_of(f"{GATES}{name}") for name in ("bar.py::a", "grid.py::b", "checkpoint.py::c", "force.py::d[bar]", "spread.py::e[bar]", "doubts.py::f")}
    flat = {group_of(f"{GATES}{name}") for name in ("damping.py::a", "in_motion.py::b", "doubts.py::c[flat]")}
    assert len(strip) == len(bar) == len(flat) == 1
    assert len(strip | bar | flat) == 3


def test_other_files_go_as_a_whole_and_the_longest_and_slow_ones_first() -> None:
    assert group_of("tests/modes/test_zones.py::a[strip]") == group_of("tests/modes/test_zones.py::b") == "tests/modes/test_zones.py"
    assert rank(f"{GATES}strip.py::a", True) < rank(f"{GATES}bar.py::a", True) < rank("tests/batch/test_job.py::a", True) < rank("tests/test_npz.py::a", False)


def test_what_is_named_as_the_longest_is_there() -> None:
    root = Path(__file__).parents[1]
    assert [group for group in LONGEST if group.endswith(".py") and not (root / group).is_file()] == []
