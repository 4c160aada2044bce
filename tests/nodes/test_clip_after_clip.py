"""Claims about clip after clip through the five nodes as processes, and about nodes that are killed: slices of scripts/many_clips.py and kills.py."""

from __future__ import annotations

from pathlib import Path

from .processes import RUNS_SCRIPTS, of_scripts

pytestmark = RUNS_SCRIPTS


def test_every_clip_of_a_row_has_its_own_result(tmp_path: Path) -> None:
    done = of_scripts("many_clips.py", "--count", "3", "--whole", "0", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 of 3 clips have their own result" in done.stdout


def test_after_a_kill_the_next_clip_has_its_own_result(tmp_path: Path) -> None:
    done = of_scripts("kills.py", "--nodes", "segment_node+fit_node", "--moments", "fit", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("its own result") == 2
