"""Claims about the process of one clip: real ones, that are killed, stopped, held up and refused."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from diffphys_ros.batch import job as room
from diffphys_ros.batch.job import Job, Running
from diffphys_ros.batch.machine import shared_by
from diffphys_ros.batch.process import Process
from diffphys_ros.batch.status import Status, read_status, write_status
from tests.quick_batch import QUICK_WORDS, broken, child_of, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.faults]


def made(clip: Path, folder: Path, *, timeout_s: float = 120.0, configs: tuple[str, ...] = (), resume: bool = False) -> Job:
    return Job(
        name="clip", clip=str(clip), folder=str(folder), configs=configs, flags=QUICK_WORDS, truth="", truth_key="", hash="h", version="v",
        device="cpu", timeout_s=timeout_s, resume=resume, batch="b", cwd=str(folder.parent),
    )  # fmt: skip


def ended(running: Running) -> Status:
    status = wait_for(running.poll)
    assert read_status(running.folder) == status
    return status


def begun(half_sample: Path, folder: Path, **options) -> Running:
    """A recovery that has said its first words."""
    running = Running(made(half_sample / "clip.mcap", folder, configs=(str(half_sample / "given.yaml"),), **options))
    wait_for(lambda: running.poll() or running.log.stat().st_size)
    return running


def test_clips_that_share_a_machine_tell_each_run_how_many_they_are(tmp_path: Path) -> None:
    alone = made(tmp_path / "clip.mcap", tmp_path)
    words = replace(alone, side_by_side=3).recover_words(resume=False)
    assert words[words.index("--side_by_side") + 1] == "3"
    assert "--side_by_side" not in alone.recover_words(resume=False)
    assert [shared_by(workers, 2) for workers in (1, 2, 3, 15)] == [1, 1, 2, 8]
    assert shared_by(2 * len(os.sched_getaffinity(0)), 0) == 2


def test_a_clip_that_is_refused_says_why(tmp_path: Path) -> None:
    status = ended(Running(made(broken(tmp_path / "spoiled"), tmp_path / "out")))
    assert (status.state, status.exit) == ("failed", 2)
    assert "not a complete ROS 2 recording" in status.reason
    assert status.device
    assert "torch" in status.versions


def test_a_process_that_is_killed_fails_alone(half_sample: Path, tmp_path: Path) -> None:
    running = begun(half_sample, tmp_path / "out")
    os.kill(child_of(tmp_path / "out"), signal.SIGKILL)
    status = ended(running)
    assert (status.state, status.exit) == ("failed", -9)
    assert "SIGKILL, as the system does when memory runs out" in status.reason


def test_a_segmentation_fault_fails_alone(half_sample: Path, tmp_path: Path) -> None:
    running = begun(half_sample, tmp_path / "out")
    os.kill(child_of(tmp_path / "out"), signal.SIGSEGV)
    assert "SIGSEGV" in ended(running).reason
    assert "Segmentation fault" in running.log.read_text()


def test_a_clip_ends_at_its_time_limit_even_where_it_does_not_listen(half_sample: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "GRACE_S", 0.5)
    running = begun(half_sample, tmp_path / "out", timeout_s=60.0)
    child = child_of(tmp_path / "out")
    os.kill(child, signal.SIGSTOP)
    running._deadline = time.monotonic()
    status = ended(running)
    assert (status.state, status.exit) == ("timed_out", -9)
    assert "not done after 60 s" in status.reason
    assert not Path(f"/proc/{child}").exists()


def test_an_interrupted_clip_goes_on_from_its_checkpoint(half_sample: Path, tmp_path: Path) -> None:
    running = begun(half_sample, tmp_path / "out")
    wait_for(lambda: running.poll() or (tmp_path / "out" / "checkpoint.npz").exists())
    running.interrupt()
    assert ended(running).state == "interrupted"
    again = begun(half_sample, tmp_path / "out", resume=True)
    assert again._resumed
    assert ended(again).state == "done"
    assert again.log.read_text().count("reading  ") == 2, "the words of both runs, in one log"


def test_a_checkpoint_of_other_settings_and_old_results_are_not_taken(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("checkpoint.npz", "recovery.npz", "metrics.json"):
        (folder / name).write_bytes(b"old")
    write_status(folder, Status(state="interrupted", hash="of other settings"))
    assert ended(Running(made(broken(tmp_path / "spoiled"), folder, resume=True))).state == "failed"
    assert {p.name for p in folder.iterdir()} == {"status.json", "log.txt"}


def test_a_clip_whose_worker_dies_again_and_again_is_given_up(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    write_status(folder, Status(state="running", batch="b", attempts=room.MAX_ATTEMPTS))
    assert "its worker died 3 times" in ended(Running(made(tmp_path / "none.mcap", folder))).reason


def test_what_a_process_said_of_itself_can_be_asked_again(tmp_path: Path) -> None:
    """Ctrl-C may fall between what was read and what is made of it."""
    process = Process(["recover", "nowhere.mcap"], tmp_path / "log.txt", cwd=str(tmp_path), device="cpu", environment={})
    wait_for(lambda: process.poll() is not None)
    assert process.report() == process.report()
