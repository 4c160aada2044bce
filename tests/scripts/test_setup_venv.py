"""Claims about scripts/setup_venv.sh: where torch comes from, what it refuses, in one sentence, and that it works once."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "setup_venv.sh"


def program(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def set_up(venv: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(SCRIPT)], env=os.environ | {"VENV": str(venv)} | environment, capture_output=True, text=True, timeout=60)


def without_gpu() -> bool:
    return not Path("/proc/driver/nvidia/version").exists() and os.uname().machine == "x86_64"


def test_a_missing_python_is_said_in_a_sentence(tmp_path: Path) -> None:
    done = set_up(tmp_path / "venv", PYTHON="/nonexistent/python3")
    assert done.returncode == 2
    assert "no Python 3.11 or 3.12 found" in done.stderr
    assert not (tmp_path / "venv").exists()


def test_a_missing_venv_module_is_said_with_its_cure(tmp_path: Path) -> None:
    python = program(tmp_path / "python3", 'case "$*" in *ensurepip*) exit 1;; *print*) echo python3.11-venv;; esac')
    done = set_up(tmp_path / "venv", PYTHON=str(python))
    assert done.returncode == 2
    assert "sudo apt install python3.11-venv" in done.stderr
    assert done.stderr.count("\n") == 1


class Pip:
    """A venv whose Python keeps the calls and answers as told: `refuses` are parts of command lines that pip fails on."""

    def __init__(self, folder: Path, *, refuses: tuple[str, ...] = (), torch: str = "", listed: str = "") -> None:
        self.venv, self.calls = folder / "venv", folder / "calls"
        refused = "".join(f"*'{words}'*) echo 'ERROR: no {words}'; exit 1;; " for words in refuses)
        program(
            self.venv / "bin" / "python",
            f'echo "$*" >> {self.calls}; case "$*" in *importlib.metadata*) echo "{torch}"; exit 0;; *" list "*) echo "{listed}"; exit 0;; esac\n'
            f'echo "WARNING: Location is ignored" >&2; case "$*" in {refused}esac',
        )

    def set_up(self, **environment: str) -> subprocess.CompletedProcess[str]:
        return set_up(self.venv, **environment)

    def installs(self, word: str = "") -> list[str]:
        """Command lines of pip install so far, with that word."""
        return [line for line in self.calls.read_text().splitlines() if " install " in line and word in line]


CPU_INDEX = "--index-url https://download.pytorch.org/whl/cpu"
on_a_cpu = pytest.mark.skipif(not without_gpu(), reason="the CPU set-up is for x86-64 machines without an NVIDIA GPU")


@on_a_cpu
def test_a_cpu_torch_that_pip_finds_is_installed_without_asking_another_index(tmp_path: Path) -> None:
    pip = Pip(tmp_path)
    assert pip.set_up().returncode == 0
    (torch,), (package,) = pip.installs("torch=="), pip.installs("--editable")
    assert torch.endswith("+cpu")
    assert CPU_INDEX not in torch
    assert package.endswith("--editable .[ros,rerun,models,capture,ray,dev]")
    assert pip.installs()[-1] == package


@on_a_cpu
def test_a_cpu_torch_that_pip_does_not_find_comes_from_the_index_of_cpu_builds(tmp_path: Path) -> None:
    pip = Pip(tmp_path, refuses=("--retries 1 torch==",))
    assert pip.set_up().returncode == 0
    assert [CPU_INDEX in line for line in pip.installs("torch==")] == [False, True]
    assert pip.installs("--editable")


@on_a_cpu
def test_without_any_cpu_torch_the_plain_one_comes_and_its_size_is_said(tmp_path: Path) -> None:
    pip = Pip(tmp_path, refuses=("+cpu",))
    done = pip.set_up()
    assert done.returncode == 0
    assert ["+cpu" in line for line in pip.installs("torch==")] == [True, True, False]
    assert pip.installs()[-1] in pip.installs("--editable")
    assert [line for line in done.stdout.splitlines() if "6.6 GB" in line and "no CPU build" in line]
    assert done.stderr == ""


@pytest.mark.parametrize("version", ["{}", "{}+cpu"])
def test_a_torch_of_the_pinned_version_is_not_asked_for_again(tmp_path: Path, version: str) -> None:
    pins = (SCRIPT.parents[1] / "constraints.txt").read_text().splitlines()
    pinned = next(line for line in pins if line.startswith("torch==")).removeprefix("torch==")
    pip = Pip(tmp_path, torch=version.format(pinned))
    assert pip.set_up().returncode == 0
    assert not [line for line in pip.installs() if "torch==" in line]


def test_every_installation_keeps_to_the_pins_and_the_second_set_up_does_nothing(tmp_path: Path) -> None:
    pip = Pip(tmp_path)
    assert pip.set_up().returncode == 0
    first = pip.calls.read_text()
    assert all("--constraint constraints.txt" in line for line in pip.installs())
    assert pip.set_up().returncode == 0
    assert pip.calls.read_text() == first


def test_every_pin_but_torch_is_asked_for_once_by_itself_and_what_fails_there_ends_nothing(tmp_path: Path) -> None:
    """Some may not be had for this Python: the package itself says what it needs."""
    pins = {line.split(";")[0].strip() for line in (SCRIPT.parents[1] / "constraints.txt").read_text().splitlines() if "==" in line and not line.startswith("#")}
    pip = Pip(tmp_path, refuses=("--no-deps a", "+cpu"))
    assert pip.set_up().returncode == 0
    shares = [line.split("--no-deps ")[1].split() for line in pip.installs("--no-deps") if "torch==" not in line]
    asked = [pin for share in shares for pin in share]
    assert set(asked) == {pin for pin in pins if not pin.startswith("torch==")}
    assert len(asked) == len(set(asked))
    assert all("--no-deps" in line for line in pip.installs() if "--editable" not in line)  # of two at a time neither may bring what the other does
    assert len(pip.installs("--editable")) == 1


def test_warnings_of_pip_go_to_the_log_alone(tmp_path: Path) -> None:
    pip = Pip(tmp_path)
    done = pip.set_up()
    assert "WARNING" in (pip.venv / "setup.log").read_text()
    assert done.stderr == ""
    assert all(line.startswith("setup: ") for line in done.stdout.splitlines())


def test_an_error_of_pip_is_shown_without_its_warnings_and_names_the_log(tmp_path: Path) -> None:
    pip = Pip(tmp_path, refuses=("--editable",))
    done = pip.set_up()
    assert done.returncode == 2
    assert "ERROR: no --editable" in done.stderr
    assert str(pip.venv / "setup.log") in done.stderr
    assert "WARNING" not in done.stderr
    assert not (pip.venv / ".set-up").exists()


def test_cuda_wheels_beside_a_cpu_torch_stop_the_set_up(tmp_path: Path) -> None:
    pip = Pip(tmp_path, torch="0.0.0+cpu", listed="nvidia-cublas-cu12==12.1")
    done = pip.set_up()
    assert done.returncode == 2
    assert "torch is a CPU build, yet nvidia-cublas-cu12==12.1 came along" in done.stderr
    assert not (pip.venv / ".set-up").exists()
