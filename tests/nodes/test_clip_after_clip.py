"""Claims about clip after clip through the five nodes as processes, and about nodes that are killed: slices of scripts/many_clips.py, kills.py
and soak.py, with the same five nodes, whose start takes longer than a slice."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from .domains import claimed
from .processes import ROOT, environment

LONGEST_S = 500.0
SENT = 36  # frames of a clip
pytestmark = [pytest.mark.faults, pytest.mark.skipif(not find_spec("rerun"), reason="rerun-sdk is not installed")]
SLICES = {
    "many_clips": "--count 2 --whole 0",
    "kills": "--nodes segment_node+fit_node --moments fit",
    "soak": "--minutes 0 --clips 2 --kill-every 3",  # a clip takes longer: a node is killed during the second, if not before
}
PROGRAM = f"""
import importlib, sys
from pathlib import Path
from clip_rig import rigged

out = Path(sys.argv[1])

def work(graph):
    for name, words in {SLICES}.items():
        script = importlib.import_module(name)
        good = script.work(graph, script.read([*words.split(), "--out", str(out)]))
        print("frames", [told.frames for told in graph.told.values()])
        print("well" if good else "badly", flush=True)
        print("END", flush=True)
    return True

sys.exit(rigged(out, work))
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("clips")


@pytest.fixture(scope="module")
def said(out: Path) -> dict[str, str]:
    """By every script of its slice; the last word is how that ended."""
    with claimed() as domain:
        done = subprocess.run([sys.executable, "-c", PROGRAM, str(out)], cwd=ROOT / "scripts", env=environment(domain), capture_output=True, text=True, timeout=LONGEST_S)
    assert done.returncode == 0, done.stdout + done.stderr
    return dict(zip(SLICES, done.stdout.split("END\n"), strict=False))


def test_every_clip_of_a_row_has_its_own_result(said: dict[str, str]) -> None:
    assert said["many_clips"].endswith("well\n")
    assert "2 of 2 clips have their own result" in said["many_clips"]
    assert f"frames {[SENT] * 2}" in said["many_clips"]


def test_after_a_kill_the_next_clip_has_its_own_result(said: dict[str, str]) -> None:
    assert said["kills"].endswith("well\n")
    assert said["kills"].count("its own result") == 2


def test_a_slice_of_the_soak_loses_no_clip_and_no_frame(said: dict[str, str], out: Path) -> None:
    assert said["soak"].endswith("well\n")
    assert "2 clips, " in said["soak"]
    assert "0 kills" not in said["soak"]
    assert "without one and without a kill: none" in said["soak"]
    assert (out / "memory.png").exists()
