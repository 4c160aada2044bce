"""Claims about the end of a process whose middleware does not end."""

from __future__ import annotations

import subprocess
import sys

import pytest

from .processes import PATIENCE_S, environment

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
