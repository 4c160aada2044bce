"""The command line."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config, result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.inverse.checkpoint import Checkpoint, Stored
from diffphys_ros.inverse.descent import Descent
from tests.coarse import coarse_elements

QUICK = [
    *("--experiment.cells", "3", "--experiment.per_cell", "1", "--fit.iterations", "1"),
    *("--experiment.splat_iterations", "4", "--experiment.max_splats", "300", "--experiment.refine_frames", "3"),
]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["recover", "{tmp}/none.mcap", "--out", "{tmp}/out"], "no such file"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--scene.mas_kg", "1"], "did you mean --scene.mass_kg"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--scene.mass_kg", "-1"], "must be in 1e-06 .. 100000 kg"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--scene.mass_kg"], "has no value"),
        (["recover", "{clip}", "--out", "{tmp}/out", "stray"], "is not a flag"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--config", "{tmp}/none.yaml"], "none.yaml"),
        (["recover", "{clip}", "--out", "/proc/none"], "choose a folder that can be written"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--topics.depth", "/nowhere"], "/nowhere"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--resume"], "there is none to resume from"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--side_by_side", "0"], "--side_by_side is '0', must be a whole number above 0"),
        (["recover", "{clip}", "--out", "{tmp}/out", "--side_by_side", "two"], "--side_by_side is 'two', must be a whole number above 0"),
        (["score", "{tmp}", "--truth", "{tmp}/none.npz"], "no such file"),
        (["simulate", "{tmp}", "--out", "{tmp}/again.npz"], "recovery.npz: no such file"),
        (["simulate", "{tmp}", "--out", "{tmp}/again.npz", "--young_scale", "soft"], "--young_scale is 'soft', must be a number"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2_and_leaves_nothing_behind(words, said, tmp_path, capfd):
    places = {"tmp": str(tmp_path), "clip": str(sample_folder() / "clip.mcap")}
    assert main([w.format(**places) for w in words]) == 2
    error = capfd.readouterr().err.strip()
    assert said in error
    assert len(error.splitlines()) == 1
    out = tmp_path / "out"
    assert not out.exists() or not list(out.iterdir())


WITHOUT_TORCH = """
import sys
sys.modules["torch"] = None
from pathlib import Path
from diffphys_ros import config
from diffphys_ros.__main__ import main
from diffphys_ros.errors import InputError
clip, broken, out = sys.argv[1:]
assert main(["recover", clip, "--out", out, "--scene.mass_kg", "-1"]) == 2
from diffphys_ros.nodes.fit_job import recover
news = recover(Path(broken), None, config.Settings(), "", False, "run", "/fit_node")
print(next(news).stage)
try:
    next(news)
except InputError as error:
    print(error)
"""


def test_a_bad_setting_and_a_recording_that_a_node_cannot_read_are_said_before_torch_is_imported(tmp_path):
    """Which takes seconds."""
    clip, broken = sample_folder() / "clip.mcap", tmp_path / "broken.mcap"
    broken.write_bytes(clip.read_bytes()[:20_000])
    done = subprocess.run([sys.executable, "-c", WITHOUT_TORCH, clip, broken, tmp_path / "out"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "scene.mass_kg" in done.stderr
    stage, sentence = done.stdout.splitlines()
    assert stage == "reading"
    assert "broken.mcap: not a complete" in sentence


def test_a_folder_in_which_another_run_works_is_refused_and_its_checkpoint_stays(tmp_path, capfd):
    with result.owned(tmp_path):
        (tmp_path / result.CHECKPOINT).write_bytes(b"of the other run")
        before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
        assert main(["recover", str(sample_folder() / "clip.mcap"), "--out", str(tmp_path)]) == 2
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert f"output folder {tmp_path}: another run owns it" in capfd.readouterr().err


def test_a_checkpoint_of_another_clip_is_refused_before_the_clip_is_worked_on(tmp_path, capfd, made_clip):
    checkpoint = Checkpoint(tmp_path / result.CHECKPOINT, every_s=0.0)
    checkpoint.bind(made_clip, config.Settings())
    three, none = np.zeros(3), np.zeros((0, 3))
    checkpoint.offer(Stored(0, three, Descent(three, 0.1, three, none, none), np.ones(1), {"fit": [0.1]}))
    assert main(["recover", str(sample_folder() / "clip.mcap"), "--out", str(tmp_path), "--resume"]) == 2
    said = capfd.readouterr()
    assert "belongs to another clip or other settings" in said.err
    assert "segment" not in said.out
    assert (tmp_path / result.CHECKPOINT).exists()


def test_an_error_of_the_program_is_one_sentence_and_its_traceback_is_kept(monkeypatch, capfd):
    monkeypatch.setattr(config, "leaves", lambda: 1 / 0)
    assert main(["settings"]) == 70
    said = capfd.readouterr().err
    assert len(said.splitlines()) == 1
    kept = Path(re.search(r"report it with (\S+) and the input", said)[1])
    assert "ZeroDivisionError" in kept.read_text()
    kept.unlink()


def test_an_object_mask_without_an_object_is_refused(tmp_path, capfd):
    import cv2

    cv2.imwrite(str(tmp_path / "empty.png"), np.zeros((240, 320), np.uint8))
    words = ["recover", str(sample_folder() / "clip.mcap"), "--out", str(tmp_path / "out"), "--scene.first_mask", str(tmp_path / "empty.png")]
    assert main(words) == 2
    assert "empty.png" in capfd.readouterr().err


@pytest.fixture
def coarse():
    with coarse_elements():
        yield


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_recover_writes_everything_and_the_solver_goes_on_from_a_prepared_clip(half_sample, tmp_path, capfd):
    """Both ways give the same fields, to the byte, though a truth lies beside the clip in one of them only."""
    clip, given = str(half_sample / "clip.mcap"), ["--config", str(half_sample / "given.yaml"), *QUICK]
    assert not (half_sample / "truth.npz").exists()
    shutil.copytree(half_sample, tmp_path / "beside")
    shutil.copy(sample_folder() / "truth.npz", tmp_path / "beside")
    assert main(["recover", str(tmp_path / "beside" / "clip.mcap"), "--out", str(tmp_path / "whole"), *given]) == 0
    names = {p.name for p in (tmp_path / "whole").iterdir()}
    rerun = {"recovery.rrd"} if find_spec("rerun") else set()
    assert names == {"recovery.npz", "metrics.json", "recovery.mcap", "metadata.yaml", "summary.png"} | rerun
    assert bool(rerun) != ("recovery.rrd was left out because the package 'rerun' is not installed" in capfd.readouterr().out)
    assert main(["ingest", clip, "--out", str(tmp_path / "clip.npz"), *given]) == 0
    assert main(["recover", str(tmp_path / "clip.npz"), "--out", str(tmp_path / "solver")]) == 0
    whole, solver = ((tmp_path / name / "recovery.npz").read_bytes() for name in ("whole", "solver"))
    assert whole == solver
    simulate_both_ways(tmp_path, capfd)
    assert main(["score", str(tmp_path / "whole"), "--truth", str(sample_folder() / "truth.npz")]) == 0
    metrics = json.loads((tmp_path / "whole" / "metrics.json").read_text())
    assert max(abs(e) for e in metrics["young_log10_error"]) < 0.07  # of elements so coarse
    assert metrics["net_force_cosine"] > 0.95
    assert {"psnr_masked", "psnr_masked_frozen_frame", "ssim_masked"} <= set(metrics)


def simulate_both_ways(folder, capfd):
    """The stored trajectory comes back from recovery.npz alone, and another force gives another."""
    alone = folder / "alone"
    alone.mkdir()
    shutil.copy(folder / "whole" / "recovery.npz", alone)
    capfd.readouterr()
    assert main(["simulate", str(alone), "--out", str(folder / "again.npz")]) == 0
    assert ": 0 m from the recovered trajectory at most" in capfd.readouterr().out
    assert main(["simulate", str(alone), "--out", str(folder / "pushed.npz"), "--force_scale", "2"]) == 0
    assert main(["simulate", str(alone), "--out", str(folder / "none.npz"), "--young_scale", "0"]) == 2
    assert capfd.readouterr().err.strip().endswith("young_scale is 0, must be > 0; 1 simulates what was recovered")
    assert not (folder / "none.npz").exists()
    recovered, again, pushed = (np.load(path)["trajectory"] for path in (alone / "recovery.npz", folder / "again.npz", folder / "pushed.npz"))
    np.testing.assert_array_equal(again, recovered)
    assert np.ptp(pushed, axis=0).max() > 1.5 * np.ptp(recovered, axis=0).max()


def test_every_setting_is_listed(capsys):
    assert main(["settings"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in config.leaves())
