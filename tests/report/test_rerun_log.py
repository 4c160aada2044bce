"""Claims about the rerun recording."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.types import Clip, Recovery, Splats

pytest.importorskip("rerun", reason="rerun-sdk is not installed")
from diffphys_ros.report import rerun_log


def rerun(*arguments: str) -> str:
    command = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if command is None:
        pytest.skip("the rerun command is not on the path")
    done = subprocess.run([command, *arguments], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def some_splats() -> Splats:
    return Splats(
        *(a.astype(np.float32) for a in (np.zeros((5, 3)), np.eye(4)[[0] * 5], np.full((5, 3), 0.01), np.ones(5), np.ones((5, 3))))
    )


def test_the_file_passes_reruns_own_check(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    path = rerun_log.write_rrd(tmp_path / "a.rrd", made_recovery, made_clip, splats=some_splats())
    rerun("rrd", "verify", str(path))


def test_the_file_holds_every_view(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    path = rerun_log.write_rrd(tmp_path / "a.rrd", made_recovery, made_clip, splats=some_splats())
    listing = rerun("rrd", "print", str(path))
    for entity in ("world/camera/image/input", "rendered", "world/object", "world/force", "world/splats", "net_force/z", "summary"):
        assert f"/{entity}" in listing, entity


def test_arrows_start_at_free_points_and_fit_the_object(made_recovery: Recovery) -> None:
    index, arrows = rerun_log.force_arrows(made_recovery.points, made_recovery.force, made_recovery.clamped)
    assert not made_recovery.clamped[index].any()
    extent = np.ptp(made_recovery.points, axis=0).max()
    assert np.linalg.norm(arrows, axis=2).max() == pytest.approx(rerun_log.ARROW_SHARE * extent)
    assert not arrows[6:].any()


def test_arrows_of_no_force_are_no_arrows(made_recovery: Recovery) -> None:
    _, arrows = rerun_log.force_arrows(made_recovery.points, 0 * made_recovery.force, made_recovery.clamped)
    assert not arrows.any()


def test_a_stream_needs_exactly_one_place_to_go(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a file or a viewer"):
        rerun_log.Stream()
    with pytest.raises(ValueError, match="a file or a viewer"):
        rerun_log.Stream(file=tmp_path / "a.rrd", viewer="spawn")


def test_a_recording_grows_with_the_number_of_losses_not_with_its_square(tmp_path: Path) -> None:
    def size(count: int) -> int:
        path = tmp_path / f"{count}.rrd"
        with rerun_log.Stream(file=path) as stream:
            for loss in np.random.default_rng(0).random(count):
                stream.log_loss(float(loss))
        return path.stat().st_size

    small, middle, large = size(10), size(1000), size(4000)
    assert (large - small) / (middle - small) < 6


def test_the_last_loss_is_in_the_recording(tmp_path: Path) -> None:
    with rerun_log.Stream(file=tmp_path / "a.rrd") as stream:
        for loss in range(1, 101):
            stream.log_loss(float(loss))
        assert stream._shown < 100
    assert stream._shown == 100


def test_recordings_that_were_closed_leave_nothing_behind_and_those_of_others_stay(tmp_path: Path) -> None:
    import rerun as rr

    own = rr.RecordingStream("own", make_default=True)
    try:
        threads = []
        for number in range(5):
            with rerun_log.Stream(file=tmp_path / f"{number}.rrd") as stream:
                stream.log_text("news")
            threads.append(len(list(Path("/proc/self/task").iterdir())))
        assert threads[-1] == threads[1]
        assert rr.get_global_data_recording() is not None
        assert rr.get_global_data_recording().get_recording_id() == own.get_recording_id()
    finally:
        rr.set_global_data_recording(None)
