"""Processes that the demonstrations start: node executables and modules of the installed package, as a user would run them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, NoReturn

from diffphys_ros.errors import InputError

PROGRAMS = Path(sys.executable).parent
PATIENCE_S = 20.0  # for a process that was asked to end


def node(name: str, parameters: Mapping[str, Any]) -> list[str]:
    """Command line of a node with parameters."""
    return [str(PROGRAMS / name), "--ros-args", *(word for key, value in parameters.items() for word in ("-p", f"{key}:={value}"))]


def module(name: str, *arguments: str) -> list[str]:
    """Command line of a module."""
    return [sys.executable, "-m", name, *arguments]


def start(command: list[str], output: IO[str] | None = None) -> subprocess.Popen:
    """Starts a command; its output goes to a file where one is given."""
    return subprocess.Popen(command, stdout=output, stderr=None if output is None else subprocess.STDOUT, env=environment())


def stop(process: subprocess.Popen) -> int:
    """Asks a process to end as Ctrl-C does; its exit status."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def run(main: Callable[[], int]) -> NoReturn:
    """Runs a demonstration from the top of the checkout; Ctrl-C and SIGTERM let it stop what it started."""
    os.chdir(Path(__file__).resolve().parent.parent)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"{Path(sys.argv[0]).stem}: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


def environment() -> dict[str, str]:
    """A ROS domain of its own on this machine, unless the user chose one."""
    own = {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "PYTHONUNBUFFERED": "1"}
    return own | os.environ


def shown(command: list[str]) -> str:
    """A command line with paths as a person would type them."""
    return " ".join(word.replace(f"{Path.cwd()}/", "") for word in command)


def last_lines(path: Path, count: int = 20) -> str:
    """The end of a log."""
    return "\n  ".join([f"the last lines of {path}:", *path.read_text(errors="replace").splitlines()[-count:]])
