"""Claims about examples/: each runs as its first lines say, and what it prints is right."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config, result
from diffphys_ros.types import Clip, Recovery
from tests.coarse import coarse_elements
from tests.nodes.processes import Domain
from tests.script import loaded

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
LATCHED = Path(__file__).with_name("latched.py")
LONGEST = 65  # lines of an example


def run(name: str, *words: object) -> str:
    """What an example prints; fails with what it said where it fails."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run([sys.executable, EXAMPLES / name, *map(str, words)], env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def domain(tmp_path: Path) -> Iterator[Domain]:
    with Domain(tmp_path) as one:
        yield one


def test_examples_are_short_and_say_how_they_are_called() -> None:
    for path in EXAMPLES.glob("*.py"):
        text = path.read_text()
        assert len(text.splitlines()) <= LONGEST, path.name
        assert f"python examples/{path.name}" in text.split('"""')[1]


def test_the_answer_of_a_folder_is_read_with_its_spread(made_recovery: Recovery, made_clip: Clip, tmp_path: Path) -> None:
    result.save(made_recovery, made_clip, config.Settings(), tmp_path)
    lines = list(loaded(EXAMPLES / "read_the_answer.py").answer(tmp_path))
    assert lines[0].startswith("part 1: E = 8e+04 Pa, with 68 % between 7.64e+04 and 8.38e+04;")
    assert lines[1].startswith("part 2: E = 2e+04 Pa")
    assert lines[2:] == ["force not identified; nobody has judged the force.", "assumed: density assumed"]


def test_a_block_that_is_let_go_sags_twice_as_far_as_beam_theory_and_returns() -> None:
    example = loaded(EXAMPLES / "simulate_a_block.py")
    _, drop, energy = zip(*example.swing(16), strict=True)
    beam = 1.5 * example.DENSITY * example.GRAVITY * example.LENGTH**4 / (example.YOUNG * example.SIDE**2)
    assert max(drop) == pytest.approx(2 * beam, rel=0.1)
    assert drop[14] < 0.1 * max(drop)
    gained = np.array([each["motion"] + each["strain"] for each in energy])
    lost = np.array([each["weight"] for each in energy])
    assert np.abs(gained - lost).max() < 0.08 * lost.max()


@pytest.mark.slow
def test_a_robot_that_comes_late_hears_stiffness_and_force(domain: Domain, made_recovery: Recovery) -> None:
    pytest.importorskip("rclpy")
    domain.start("latched", str(LATCHED))
    domain.await_words("latched", "published")
    domain.start("robot", str(EXAMPLES / "subscribe_from_a_robot.py"))
    assert domain.ended("robot") == 0, domain.said("robot")
    said = domain.said("robot")
    assert "part 1: E = 8e+04 Pa" in said
    assert "part 2: E = 2e+04 Pa" in said
    (newtons,) = re.findall(r"largest net force: (\S+) N in frame world", said)
    assert float(newtons) == pytest.approx(np.linalg.norm(made_recovery.net_force(), axis=1).max(), rel=1e-3)


@pytest.mark.slow
def test_a_recording_becomes_a_folder_whose_answer_is_read(half_sample: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The one in this process, which has the libraries, the other in one of its own."""
    (tmp_path / "quick.yaml").write_text("scene: {density_kg_m3: [690.0, 690.0]}\nexperiment: {schedule: linear, splat_iterations: 5, refine_frames: 2, max_splats: 300}\n")
    words = (half_sample / "clip.mcap", tmp_path / "out", half_sample / "given.yaml", tmp_path / "quick.yaml")
    monkeypatch.setattr(sys, "argv", ["recover_a_bag.py", *map(str, words)])
    with coarse_elements():
        runpy.run_path(str(EXAMPLES / "recover_a_bag.py"), run_name="__main__")
    assert f"read_the_answer.py {tmp_path / 'out'}" in capsys.readouterr().out
    read = run("read_the_answer.py", tmp_path / "out")
    young = [float(value) for value in re.findall(r"^part \d: E = (\S+) Pa", read, re.M)]
    assert young == pytest.approx([251e3, 167.5e3], rel=0.15)
    (newtons,) = re.findall(r"largest net force: (\S+) N", read)
    assert float(newtons) == pytest.approx(7.2, rel=0.05)
