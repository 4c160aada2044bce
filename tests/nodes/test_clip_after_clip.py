"""Claims about clip after clip through the five nodes as processes, and about nodes that are killed: slices of scripts/many_clips.py, kills.py and soak.py."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from .domains import claimed
from .processes import ROOT, environment

LONGEST_S = 1200.0
pytestmark = [pytest.mark.faults, pytest.mark.timeout(LONGEST_S + 60), pytest.mark.skipif(not find_spec("rerun"), reason="rerun-sdk is not installed")]


def script(name: str, *arguments: str) -> subprocess.CompletedProcess:
    with claimed() as domain:
        command = [sys.executable, str(ROOT / "scripts" / name), *arguments]
        return subprocess.run(command, env=environment(domain), capture_output=True, text=True, timeout=LONGEST_S)


def test_every_clip_of_a_row_has_its_own_result(tmp_path: Path) -> None:
    done = script("many_clips.py", "--count", "3", "--whole", "0", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 of 3 clips have their own result" in done.stdout


def test_after_a_kill_the_next_clip_has_its_own_result(tmp_path: Path) -> None:
    done = script("kills.py", "--nodes", "segment_node+fit_node", "--moments", "fit", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("its own result") == 2


def test_a_minute_of_the_soak_loses_no_clip_and_no_frame(tmp_path: Path) -> None:
    done = script("soak.py", "--minutes", "1", "--kill-every", "30", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "without one and without a kill: none" in done.stdout
    assert (tmp_path / "memory.png").exists()
