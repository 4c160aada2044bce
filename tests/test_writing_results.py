"""Claims about the end of a run, when its five files are written: signals, kills and a full disc, in real processes on a small recovery."""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from diffphys_ros import config, folder, result, store
from diffphys_ros.types import Clip, Recovery
from tests.conftest import make_clip, make_recovery

pytestmark = [pytest.mark.slow, pytest.mark.faults]
EXPORTS = (result.RECORDING, result.RERUN, result.FIGURE) if find_spec("rerun") else (result.RECORDING, result.FIGURE)
PAGE = 4096  # bytes that a file's length is rounded up to
PROGRAM = """
import os, signal, sys, threading
from diffphys_ros import config, result, store
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera, Clip

source, out, when = sys.argv[1:]
signal.signal(signal.SIGTERM, signal.default_int_handler)
clip, recovery = store.load(source + "/clip.npz", (Clip, Camera)), result.load(source)

def strike(frame, event, argument):
    if frame.f_code.co_qualname == when:
        threading.settrace(None), sys.settrace(None)
        os.kill(os.getpid(), signal.SIGTERM)

def told(name):
    print("begins", name, file=sys.stderr)
    if when == "kill " + name:
        os.kill(os.getpid(), signal.SIGKILL)

if "." in when and " " not in when:
    threading.settrace(strike), sys.settrace(strike)
try:
    with result.owned(out):
        result.write_all(recovery, clip, config.Settings(), out, report=told)
except InputError as error:
    print(error)
    sys.exit(2)
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.fixture(scope="module")
def write(tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    """Runs PROGRAM on a recovery: write(recovery, clip, out, when) -> the process that has ended."""

    def run(recovery: Recovery, clip: Clip, out: Path, when: str = "") -> subprocess.CompletedProcess:
        source = tmp_path_factory.mktemp("source")
        result.save(recovery, clip, config.Settings(), source)
        store.save(source / "clip.npz", clip)
        return subprocess.run([sys.executable, "-c", PROGRAM, str(source), str(out), when], capture_output=True, text=True, timeout=120)

    return run


@pytest.fixture(scope="module")
def older(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an earlier run."""
    clip, out = make_clip(), tmp_path_factory.mktemp("older")
    write_here(make_recovery(clip), clip, out)
    return out


def write_here(recovery: Recovery, clip: Clip, out: Path) -> None:
    """By this process."""
    with result.owned(out):
        result.write_all(recovery, clip, config.Settings(), out)


@pytest.fixture
def heavier(made_recovery: Recovery) -> Recovery:
    """The result of another run."""
    return dataclasses.replace(made_recovery, density=2 * made_recovery.density, metrics={"mass": 5.0})


def files(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir()}


@pytest.mark.parametrize("name", [result.RECORDING, result.FIGURE])
def test_a_run_that_is_killed_while_it_writes_leaves_the_old_files_alone_and_the_next_one_leaves_the_new(write, older, made_recovery, heavier, made_clip, tmp_path, name) -> None:
    shutil.copytree(older, tmp_path, dirs_exist_ok=True)
    old = files(tmp_path)
    assert write(heavier, made_clip, tmp_path, f"kill {name}").returncode == -signal.SIGKILL
    left = files_shown(tmp_path)
    assert left == old
    write_here(heavier, made_clip, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(old)
    assert result.load(tmp_path).density[0] == 2 * made_recovery.density[0]
    assert result.read_metrics(tmp_path)["mass"] == 5.0


def files_shown(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir() if not path.name.startswith(".")}


@pytest.mark.skipif(find_spec("rerun") is None, reason="rerun-sdk is not installed")
@pytest.mark.parametrize("where", ["RecordingStream.__init__", "Stream.log_image", "Stream.close"])
def test_a_signal_while_rerun_writes_ends_the_run_without_a_traceback(write, made_recovery, made_clip, tmp_path, where) -> None:
    ended = write(made_recovery, made_clip, tmp_path, where)
    assert (ended.returncode, ended.stderr.splitlines()[-1]) == (130, f"begins {result.RERUN}")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def small_disc(tmp_path: Path) -> Iterator[Path]:
    """A disc of 4 MiB."""
    place = tmp_path / "disc"
    place.mkdir()
    if os.geteuid() != 0 or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)], capture_output=True).returncode:
        pytest.skip("this user cannot mount a small disc")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("fits", range(len(EXPORTS) + 1))
def test_a_full_disc_keeps_the_old_files_and_the_checkpoint_and_says_so(write, older, heavier, made_clip, small_disc, fits) -> None:
    """Whichever of the files it is that has no room: the first ones fit."""
    shutil.copytree(older, small_disc, dirs_exist_ok=True)
    (small_disc / result.CHECKPOINT).write_bytes(b"of the fit")
    old = files(small_disc)
    disc, written = os.statvfs(small_disc), (result.RECOVERY, result.METRICS, *EXPORTS)
    room = sum(-(-len(old[name]) // PAGE) * PAGE for name in written[: fits + 1]) if fits else 0
    (small_disc / "filler").write_bytes(bytes(disc.f_bavail * disc.f_frsize - room - 3 * PAGE))  # a recording is written beside its metadata
    ended = write(heavier, made_clip, small_disc)
    assert ended.returncode == 2, ended.stderr
    assert ended.stdout.startswith(f"output folder {small_disc}: No space left on device; what it held before is untouched")
    assert "--resume" in ended.stdout
    assert len(ended.stdout.splitlines()) == 1
    assert ended.stderr.split("begins ")[1:] == [f"{name}\n" for name in EXPORTS[:fits]]
    (small_disc / "filler").unlink()
    assert files(small_disc) == old
    assert not (small_disc / folder.STAGING).exists()
