"""Claims about nodes that work for long: a slice of scripts/soak.py. A file of its own, so that another process may run it beside its neighbours."""

from __future__ import annotations

from pathlib import Path

from .processes import RUNS_SCRIPTS, of_scripts

pytestmark = RUNS_SCRIPTS


def test_a_minute_of_the_soak_loses_no_clip_and_no_frame(tmp_path: Path) -> None:
    done = of_scripts("soak.py", "--minutes", "1", "--kill-every", "30", "--out", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "without one and without a kill: none" in done.stdout
    assert (tmp_path / "memory.png").exists()
