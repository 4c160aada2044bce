"""Claims about `diffphys batch` as a user sees it."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder
from tests.quick_batch import QUICK_WORDS, broken, child_of, wait_for

pytestmark = pytest.mark.slow


@pytest.fixture
def clips(half_sample: Path, tmp_path: Path) -> Path:
    """A folder of a clip with its truth, one that breaks off and one whose settings are wrong, which needs no process to be refused."""
    folder = tmp_path / "clips"
    shutil.copytree(half_sample, folder / "half")
    shutil.copy(sample_folder() / "truth.npz", folder / "half")
    for name in ("spoiled", "torn"):
        broken(folder / name)
    (folder / "spoiled" / "given.yaml").write_text("scene: {mass_kg: -1}\n")
    return folder


def rows(out: Path, stem: str = "summary") -> dict[str, dict[str, str]]:
    """Lines of a summary by what the clip's folder begins with."""
    table = list(csv.DictReader((out / f"{stem}.csv").open()))
    found = {row["clip"].split("-")[0]: row for row in table}
    assert len(found) == len(table)
    return found


@pytest.mark.faults
def test_shards_do_the_clips_once_and_resume_merges_them(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = tmp_path / "out"
    words = ["batch", str(clips), "--out", str(out), *QUICK_WORDS]
    assert [main([*words, "--shard", f"{k}/2"]) for k in (1, 2)] == [1, 1]
    first, second = rows(out, "summary-1-of-2"), rows(out, "summary-2-of-2")
    assert sorted([*first, *second]) == ["half", "spoiled", "torn"]
    done = (first | second)["half"]
    assert done["state"] == "done"
    assert abs(float(done["young_log10_error_1"])) < 0.06
    assert float(done["net_force_cosine"]) > 0.95
    folder = out / done["clip"]
    before = (folder / "status.json").read_bytes(), (folder / "recovery.npz").stat().st_mtime_ns

    assert main(words) == 2
    assert "are done in it; keep them with --resume" in capsys.readouterr().err
    assert main([*words, "--resume"]) == 1
    assert ((folder / "status.json").read_bytes(), (folder / "recovery.npz").stat().st_mtime_ns) == before
    assert {name: row["state"] for name, row in rows(out).items()} == {"half": "done", "spoiled": "failed", "torn": "failed"}
    assert "not a complete ROS 2 recording" in rows(out)["torn"]["reason"]

    # a truth that is another is scored; the fit stays
    with np.load(clips / "half" / "truth.npz") as archive:
        truth = {name: archive[name] for name in archive.files}
    np.savez(clips / "half" / "truth.npz", **(truth | {"part_E": truth["part_E"] * 10, "vertex_E": truth["vertex_E"] * 10}))
    (clips / "torn" / "clip.mcap").unlink()
    assert main([*words, "--resume"]) == 1
    assert set(rows(out)) == {"half", "spoiled"}
    assert float(rows(out)["half"]["young_log10_error_1"]) == pytest.approx(float(done["young_log10_error_1"]) - 1, abs=1e-3)
    assert (folder / "recovery.npz").stat().st_mtime_ns == before[1]


LONG_WORDS = tuple("400" if before == "--fit.iterations" else word for before, word in zip(("", *QUICK_WORDS), QUICK_WORDS, strict=False))


@pytest.mark.faults
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
def test_a_batch_that_is_ended_leaves_no_process_and_its_folder_free(clips: Path, tmp_path: Path, number: int) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "diffphys_ros", "batch", str(clips), "--out", str(out), "--workers", "1", *LONG_WORDS]
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell starts its background jobs, these tests among them, deaf to it
    batch = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heard)
    folder = wait_for(lambda: next(iter(out.glob("half-*")), None))
    wait_for(lambda: (folder / "log.txt").exists() and (folder / "log.txt").stat().st_size)
    child = child_of(folder)
    assert main(["batch", str(clips), "--out", str(out)]) == 2
    os.kill(batch.pid, number)
    said, told = batch.communicate(timeout=60)
    wait_for(lambda: not Path(f"/proc/{child}").exists(), limit_s=20)
    if number == signal.SIGKILL:
        return
    assert batch.returncode == 130
    assert "0 of 3 clips are done; the same command with --resume goes on" in said
    assert "Traceback" not in told
    assert {name: row["state"] for name, row in rows(out).items()} == {"half": "interrupted", "spoiled": "failed", "torn": "waiting"}
    assert json.loads((folder / "status.json").read_text())["state"] == "interrupted"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{tmp}/none.mcap"], "no such file or folder"),
        (["{clip}", "--shard", "3/2"], "--shard is '3/2'"),
        (["{clip}", "--workers", "0"], "--workers is '0'"),
        (["{clip}", "--timeout_s", "soon"], "--timeout_s is 'soon'"),
        (["{clip}", "--scene.mas_kg", "1"], "did you mean --scene.mass_kg"),
        (["{clip}", "--config", "{tmp}/none.yaml"], "none.yaml"),
    ],
)
def test_a_wrong_request_is_one_sentence_before_any_work(words: list[str], said: str, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    places = {"tmp": str(tmp_path), "clip": str(broken(tmp_path / "spoiled"))}
    assert main(["batch", *(word.format(**places) for word in words), "--out", str(tmp_path / "out")]) == 2
    error = capfd.readouterr().err.strip()
    assert said in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_settings_that_are_wrong_beside_one_clip_fail_that_clip_alone(tmp_path: Path) -> None:
    path = broken(tmp_path / "clips" / "spoiled")
    (path.parent / "given.yaml").write_text("scene: {mass_kg: -1}\n")
    assert main(["batch", str(tmp_path / "clips"), "--out", str(tmp_path / "out")]) == 1
    assert "scene.mass_kg is -1" in rows(tmp_path / "out")["spoiled"]["reason"]

