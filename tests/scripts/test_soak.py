"""Claims about what the soak makes of what it saw; `make soak` is the soak itself."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from diffphys_ros.nodes.memory import children
from tests.script import loaded

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture
def soak(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    pytest.importorskip("rclpy")
    monkeypatch.syspath_prepend(SCRIPTS)
    return loaded(SCRIPTS / "soak.py")


def seen(soak: ModuleType, *, whole: bool = True, hit: bool = False, frames: int = 36, memory: list[float] | None = None):
    clip = SimpleNamespace(number=0, whole=whole, frames=frames, sent_s=1.0, done_s=3.0)
    return soak.Soak([clip], {0} if hit else set(), [(1.0, "fit_node")] if hit else [], {("fit_node", 1): memory or [100.0] * 9})


@pytest.mark.parametrize(
    ("case", "good"),
    [
        ({}, True),
        ({"whole": False}, False),
        ({"whole": False, "hit": True, "frames": 0}, True),
        ({"frames": 35}, False),
        ({"memory": [100.0 + 10 * k for k in range(9)]}, False),
        ({"memory": [100.0, 300.0, 500.0, *[600.0] * 6]}, True),
    ],
)
def test_a_lost_clip_a_lost_frame_and_memory_that_grows_are_failures(soak, capsys, case, good) -> None:
    assert soak.summary(seen(soak, **case), 36) is good
    assert "1 clips" in capsys.readouterr().out


def test_the_memory_of_children_counts(soak) -> None:
    with subprocess.Popen([sys.executable, "-c", "held = bytearray(b'x') * (60 << 20); input()"], stdin=subprocess.PIPE, text=True) as child:
        until = 200
        while soak.held_mib(child.pid) < 60 and (until := until - 1):
            time.sleep(0.05)
        assert child.pid in [int(pid) for pid in children(os.getpid())]
        assert soak.held_mib(child.pid) > 60
        child.communicate("")


def test_memory_is_looked_at_while_the_work_goes_on_and_drawn(soak, tmp_path) -> None:
    figure = loaded(SCRIPTS / "memory_figure.py")
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, text=True) as child:
        with figure.watched({"one": child, "other": child}, every_s=0.05) as samples:
            until = 200
            while len(samples) < 4 and (until := until - 1):
                time.sleep(0.05)
        child.communicate("")
    times, mib = figure.together(samples[:4])
    assert len(times) == 2
    assert mib == pytest.approx([samples[0].mib + samples[1].mib, samples[2].mib + samples[3].mib])
    assert mib.min() > 1
    figure.write(samples, tmp_path / "memory.csv")
    assert len((tmp_path / "memory.csv").read_text().splitlines()) == len(samples)
    figure.draw(samples, [(0.1, "one")], tmp_path / "memory.png")
    assert (tmp_path / "memory.png").stat().st_size > 10_000
