"""Claims about the end of a process whose middleware hangs."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from .processes import PATIENCE_S, Domain, environment

WAITS = {
    "for a dead peer": "time.sleep(600)",
    "inside native code that keeps the interpreter": "ctypes.PyDLL(None).sleep(600)",
}
SCRIPT = """
import ctypes, time
from diffphys_ros.nodes import executables
executables.CLEAN_UP_S = executables.LOCKED_S = 0.2
executables.end_in_time(0)
{}
"""


@pytest.mark.parametrize(("waiting", "status"), zip(WAITS, (0, 1), strict=True))
def test_a_clean_up_that_hangs_ends_in_time_and_says_where_with_the_nodes_own_status_where_python_still_runs(waiting, status):
    ended = subprocess.run([sys.executable, "-c", SCRIPT.format(WAITS[waiting])], env=environment(0), capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == status
    assert 'File "<string>", line 6' in ended.stderr


DEAF = """
import ctypes
from diffphys_ros.nodes import executables
executables.CLEAN_UP_S = 0.2
executables.Stop().spinning = True
lock, libc = ctypes.create_string_buffer(64), ctypes.CDLL(None)
libc.pthread_mutex_lock(lock)
print("locked", flush=True)
libc.pthread_mutex_lock(lock)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_process_whose_main_thread_waits_for_a_lock_for_ever_and_says_where(tmp_path: Path, number: signal.Signals) -> None:
    """Python tells the main thread of a signal, which must come back from the middleware to hear of it."""
    with Domain(tmp_path) as domain:
        domain.start("deaf", "-c", DEAF)
        domain.await_words("deaf", "locked")
        assert domain.end("deaf", number) == 0
        assert 'File "<string>", line 9' in domain.said("deaf")


HEARS = """
import signal, time
from diffphys_ros.nodes import executables
executables.CLEAN_UP_S = 0.2
executables.Stop()
signal.signal(signal.SIGUSR1, lambda number, frame: print("heard", flush=True))
print("ready", flush=True)
time.sleep(600)
"""


def test_a_signal_of_another_kind_ends_nothing(tmp_path: Path) -> None:
    with Domain(tmp_path) as domain:
        process = domain.start("hears", "-c", HEARS)
        domain.await_words("hears", "ready")
        process.send_signal(signal.SIGUSR1)
        domain.await_words("hears", "heard")
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1.0)
