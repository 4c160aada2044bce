"""A fit that was interrupted and goes on ends with the fields of one that was not, to the bit: whatever a checkpoint forgets shows.

The search begins with half of E, so that every part of its state matters: how far it has come, the slope there, the curvature that it has
learnt, the substeps that E has outgrown, how often it has stood still and how many iterations it has made.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.__main__ import main

pytestmark = pytest.mark.faults
FLAGS = (
    *("--experiment.cells", "2", "--experiment.per_cell", "1.5", "--experiment.refine_frames", "0"),
    *("--start_scale", "0.5", "--experiment.checkpoint_every_s", "0.1"),
    *("--experiment.splat_iterations", "3", "--experiment.max_splats", "100"),
)
CHECKPOINT = "checkpoint.npz"
LIMIT_S = 240.0
LEARNT = 3  # states after which a fit has learnt some curvature
FIELDS = ("young", "force", "trajectory", "log10_young_sd", "mass_damping", "stiffness_damping", "initial_velocity", "substeps")


@pytest.fixture(scope="module")
def clip(half_sample: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of few pixels: what a checkpoint holds is the same."""
    prepared = tmp_path_factory.mktemp("half") / "clip.npz"
    assert main(["ingest", str(half_sample / "clip.mcap"), "--config", str(half_sample / "given.yaml"), "--out", str(prepared)]) == 0
    return prepared


@pytest.fixture(scope="module")
def whole(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """The result of a fit that ran through, and its checkpoints in their order."""
    out, kept = tmp_path_factory.mktemp("whole"), tmp_path_factory.mktemp("checkpoints")
    process = begin(clip, out)
    checkpoints = [shutil.copy(path, kept / f"{number}.npz") for number, path in enumerate(news_of(process, out / CHECKPOINT))]
    assert process.wait(LIMIT_S) == 0
    return out, checkpoints


def begin(clip: Path, out: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "diffphys_ros", "recover", str(clip), "--out", str(out), *FLAGS]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def news_of(process: subprocess.Popen, path: Path) -> Iterator[Path]:
    """`path`, each time that the process has written it anew."""
    last, until = 0, time.monotonic() + LIMIT_S
    while process.poll() is None and time.monotonic() < until:
        here = path.stat().st_ino if path.exists() else 0
        if here not in (0, last):
            last = here
            yield path
        time.sleep(0.005)


def differing(folder: Path, other: Path) -> list[str]:
    """Names of recovered fields that are not equal to the bit."""
    one, two = (np.load(f / result.RECOVERY) for f in (folder, other))
    return [name for name in FIELDS if not np.array_equal(one[name], two[name])]


def test_a_fit_that_was_killed_goes_on_to_the_same_fields(clip: Path, whole: tuple[Path, list[Path]], tmp_path: Path) -> None:
    process = begin(clip, tmp_path)
    news = news_of(process, tmp_path / CHECKPOINT)
    for _ in range(LEARNT):
        next(news)
    process.send_signal(signal.SIGKILL)
    process.wait(LIMIT_S)
    assert not (tmp_path / result.RECOVERY).exists()
    assert main(["recover", str(clip), "--out", str(tmp_path), *FLAGS, "--resume"]) == 0
    assert differing(tmp_path, whole[0]) == []


def test_a_fit_that_goes_on_from_its_end_stops_where_it_did(clip: Path, whole: tuple[Path, list[Path]], tmp_path: Path) -> None:
    out, checkpoints = whole
    shutil.copy(checkpoints[-2], tmp_path / CHECKPOINT)
    assert main(["recover", str(clip), "--out", str(tmp_path), *FLAGS, "--resume"]) == 0
    assert differing(tmp_path, out) == []


def test_a_fit_that_goes_on_does_not_count_its_iterations_anew(clip: Path, whole: tuple[Path, list[Path]], tmp_path: Path) -> None:
    """All iterations that it may make were made: it must not reach what more of them find."""
    out, checkpoints = whole
    shutil.copy(checkpoints[-3], tmp_path / CHECKPOINT)
    made = str(result.read_metrics(out)["iterations"] - 2)
    assert main(["recover", str(clip), "--out", str(tmp_path), *FLAGS, "--resume", "--fit.iterations", made]) == 0
    assert {"young", "force", "trajectory"} <= set(differing(tmp_path, out))
