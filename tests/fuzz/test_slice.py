"""A hundredth of every door's hostile cases, and every seed that ever failed: none may be a fault."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
ROOT = Path(__file__).resolve().parents[2]
NOT_DOORS = ("_", "test_", "conftest")
DOORS = sorted(path.stem for path in Path(__file__).parent.glob("*.py") if not path.stem.startswith(NOT_DOORS))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What came of the doors, one process for all so that libraries are imported once."""
    path = tmp_path_factory.mktemp("fuzz") / "found.json"
    done = subprocess.run([sys.executable, str(ROOT / "scripts" / "fuzz.py"), "--share", "0.01", "--jobs", "1", "--json", str(path)], capture_output=True, text=True)
    assert path.exists(), done.stderr[-2000:]
    return json.loads(path.read_text())


@pytest.mark.parametrize("door", DOORS)
def test_hostile_input_is_taken_or_refused_in_a_sentence(found: dict[str, Any], door: str) -> None:
    if found[door]["left_out"]:
        pytest.skip(found[door]["left_out"])
    assert not found[door]["faults"], "\n".join(found[door]["faults"])
    assert found[door]["refused"], "no case was hostile enough to be refused"
    assert found[door]["taken"], "no case came as far as a valid result"
