"""Claims about nodes that work for long: a slice of scripts/soak.py. A file of its own, so that another process may run it beside its neighbours."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from .processes import of_scripts

LONGEST_S = 1200.0
pytestmark = [pytest.mark.faults, pytest.mark.timeout(LONGEST_S + 60), pytest.mark.skipif(not find_spec("rerun"), reason="rerun-sdk is not installed")]


def test_a_minute_of_the_soak_loses_no_clip_and_no_frame(tmp_path: Path) -> None:
    done = of_scripts("soak.py", "--minutes", "1", "--kill-every", "30", "--out", str(tmp_path), longest_s=LONGEST_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "without one and without a kill: none" in done.stdout
    assert (tmp_path / "memory.png").exists()
