"""Claims about folders that one process owns and whose files are replaced together; with real processes, kills and full discs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from diffphys_ros import folder as folders
from diffphys_ros import store
from diffphys_ros.errors import InputError

FILES = ("a.txt", "b.txt", "c.txt")
OLD, NEW = {"a.txt": "old", "b.txt": "old"}, {"b.txt": "new", "c.txt": "new"}
STEPS = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "open")  # audited events that touch a folder


def held(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if not path.name.startswith(".")}


def seen(folder: Path) -> dict[str, str]:
    """What a reader that asks for each file by name finds."""
    gone = folder / folders.READY / folders.GONE
    names = set(FILES) - set(gone.read_text().split() if gone.exists() else ())
    return {name: path.read_text() for name in names if (path := folders.current(folder, name)).exists()}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    for name, text in OLD.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def replace(folder: Path) -> None:
    with folders.owned(folder), folders.replaced(folder, FILES) as staging:
        for name, text in NEW.items():
            (staging / name).write_text(text)


def test_a_new_set_takes_the_place_of_the_old_one_and_nothing_else_is_left(place: Path) -> None:
    (place / "mine.txt").write_text("stays")
    replace(place)
    assert {path.name: path.read_text() for path in place.iterdir()} == NEW | {"mine.txt": "stays"}


def test_a_set_that_failed_changes_nothing(place: Path) -> None:
    with pytest.raises(TypeError), folders.owned(place), folders.replaced(place, FILES) as staging:
        (staging / "b.txt").write_text("half") and (staging / "c.txt").write_text(3)  # type: ignore[arg-type]
    assert {path.name: path.read_text() for path in place.iterdir()} == OLD


def killed_at(place: Path, step: int) -> bool:
    """Replaces the set in a process that is killed before its n-th touch of the folder; whether it lived to its end."""
    child = os.fork()
    if child == 0:
        left = [step]

        def count(event: str, arguments: tuple) -> None:
            if event in STEPS:
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        try:
            sys.addaudithook(count)
            replace(place)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.slow
def test_a_kill_at_any_step_leaves_the_old_set_or_the_new_one_and_the_next_owner_mends_the_folder(tmp_path: Path) -> None:
    found, step = [], 0
    while not found or not found[-1][1]:
        place = tmp_path / str(step)
        place.mkdir()
        for name, text in OLD.items():
            (place / name).write_text(text)
        lived = killed_at(place, step)
        between = seen(place)
        with folders.owned(place):
            assert held(place) == between, f"killed before step {step}"
        assert sorted(path.name for path in place.iterdir()) == sorted(between), f"killed before step {step}"
        found.append((between, lived))
        step += 1
    sets = [between for between, _ in found]
    assert all(between in (OLD, NEW) for between in sets)
    assert sets[0] == OLD
    assert sets[-1] == NEW
    assert step > 12


@pytest.fixture
def owner(tmp_path: Path) -> Iterator[subprocess.Popen]:
    """A process that owns `tmp_path` until its input ends."""
    program = "import sys; from diffphys_ros.folder import owned\nwith owned(sys.argv[1]): print('mine', flush=True); sys.stdin.read()"
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "mine\n"
    yield process
    process.kill()
    process.wait()


def test_a_folder_that_another_process_owns_is_refused_by_its_name_and_untouched(owner: subprocess.Popen, tmp_path: Path) -> None:
    (tmp_path / ".part-live-12345678.npz").write_text("the other's")
    with pytest.raises(InputError, match=f"output folder {tmp_path}: another run owns it; wait until") as caught, folders.owned(tmp_path):
        pass
    assert "\n" not in str(caught.value)
    assert (tmp_path / ".part-live-12345678.npz").exists()
    assert (tmp_path / folders.LOCK).exists()


def test_a_folder_is_free_again_once_its_owner_has_ended_and_no_lock_stays(owner: subprocess.Popen, tmp_path: Path) -> None:
    owner.communicate()
    assert list(tmp_path.iterdir()) == []
    replace(tmp_path)


def test_a_folder_is_free_again_once_its_owner_was_killed(owner: subprocess.Popen, tmp_path: Path) -> None:
    owner.kill()
    owner.wait()
    replace(tmp_path)
    assert held(tmp_path) == NEW
    assert not (tmp_path / folders.LOCK).exists()


def test_two_owners_in_one_process_are_two(tmp_path: Path) -> None:
    with folders.owned(tmp_path), pytest.raises(InputError, match="another run owns it"), folders.owned(tmp_path):
        pass


def test_of_many_processes_at_once_one_at_a_time_owns_a_folder(tmp_path: Path) -> None:
    """Each adds one to a number that it reads and writes: an owner too many would lose one."""
    (tmp_path / "count").write_text("0")
    children = []
    for _ in range(8):
        child = os.fork()
        if child == 0:
            for _ in range(20):
                while not counted(tmp_path):
                    pass
            os._exit(0)
        children.append(child)
    assert [os.waitpid(child, 0)[1] for child in children] == [0] * 8
    assert (tmp_path / "count").read_text() == "160"


def counted(folder: Path) -> bool:
    try:
        with folders.owned(folder):
            (folder / "count").write_text(str(int((folder / "count").read_text()) + 1))
            return True
    except InputError:
        return False


def test_files_that_killed_runs_left_half_written_are_removed_and_others_stay(tmp_path: Path) -> None:
    stale = (".part-recovery-abcd1234.npz", ".recovery-abcd1234.npz", ".checkpoint-ab_d1234.npz", ".staging")
    for name in (*stale, ".hidden", "recovery-abcd1234.npz", ".settings-personal.yaml"):
        (tmp_path / name).write_text("x")
    (tmp_path / ".recovery-zzzz1234").mkdir()
    with folders.owned(tmp_path):
        pass
    assert {path.name for path in tmp_path.iterdir()} == {".hidden", "recovery-abcd1234.npz", ".settings-personal.yaml"}


def test_a_file_that_somebody_else_is_writing_in_the_folder_stays(tmp_path: Path) -> None:
    def write(temporary: Path) -> None:
        temporary.write_text("whole")
        with folders.owned(tmp_path):
            pass

    assert store.write_whole(tmp_path / "status.json", write).read_text() == "whole"
    assert [path.name for path in tmp_path.iterdir()] == ["status.json"]


@pytest.mark.parametrize("name", [folders.LOCK, "a.txt"])
def test_a_folder_where_a_file_belongs_is_refused_before_any_work(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=str(tmp_path)), folders.owned(tmp_path, files=FILES):
        pytest.fail("it must not begin")
