"""Claims about scripts/setup_venv.sh: what it refuses, in one sentence, and that it works once."""

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


@pytest.mark.skipif(not without_gpu(), reason="the CPU set-up is for x86-64 machines without an NVIDIA GPU")
def test_cuda_wheels_on_a_machine_without_a_gpu_stop_the_set_up(tmp_path: Path) -> None:
    program(tmp_path / "venv" / "bin" / "python", 'case "$*" in *list*) echo nvidia-cublas-cu12==12.1;; esac')
    done = set_up(tmp_path / "venv")
    assert done.returncode == 2
    assert "no NVIDIA GPU, yet nvidia-cublas-cu12==12.1 came along" in done.stderr
    assert not (tmp_path / "venv" / ".set-up").exists()


@pytest.mark.skipif(not without_gpu(), reason="the CPU set-up is for x86-64 machines without an NVIDIA GPU")
def test_the_set_up_installs_pinned_cpu_torch_and_does_so_once(tmp_path: Path) -> None:
    calls = tmp_path / "calls"
    program(tmp_path / "venv" / "bin" / "python", f'echo "$*" >> {calls}')
    assert set_up(tmp_path / "venv").returncode == 0
    first = calls.read_text()
    assert "+cpu --extra-index-url https://download.pytorch.org/whl/cpu" in first
    assert all("--constraint constraints.txt" in line for line in first.splitlines() if " install " in line)
    assert set_up(tmp_path / "venv").returncode == 0
    assert calls.read_text() == first
