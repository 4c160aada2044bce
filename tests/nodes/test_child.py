"""Claims about a generator in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.errors import InputError, SimulationError
from diffphys_ros.nodes.child import ASK_S, steps

from .processes import PATIENCE_S, ROOT


def counts(until: int):
    """In the other process."""
    yield from range(until)
    return "end"


def echoes(array: np.ndarray):
    yield os.getpid()
    array += 1  # it is the other process's own
    return array


def fails(error: Exception):
    yield "begun"
    raise error


def cleans(mark: Path):
    try:
        yield "begun"
        while True:
            time.sleep(0.01)
    finally:
        mark.write_text("closed")


def deaf():
    """Hears no signal, as native code does not."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    yield os.getpid()
    while True:
        time.sleep(1.0)


def dies(number: int):
    yield "begun"
    os.kill(os.getpid(), number)
    while True:
        time.sleep(1.0)


def unportable():
    yield "begun"

    class HereError(Exception):
        pass

    raise HereError("of this process alone")


def run(generator):
    """What it yields but None, and what it returns."""
    news = []
    while True:
        try:
            said = next(generator)
        except StopIteration as stop:
            return news, stop.value
        if said is not None:
            news.append(said)


def first(generator):
    return next(said for said in generator if said is not None)


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except OSError:
        return True


def test_news_and_result_are_those_of_the_generator():
    assert run(steps(counts, 3)) == ([0, 1, 2], "end")


def test_arrays_travel_both_ways_and_the_work_is_done_elsewhere():
    array = np.arange(3_000_000, dtype=np.float32).reshape(3, -1)
    (pid,), back = run(steps(echoes, array))
    assert pid != os.getpid()
    np.testing.assert_array_equal(back, array + 1)
    assert gone(pid)


@pytest.mark.parametrize("error", [InputError("no clip"), SimulationError("left its grid")])
def test_what_it_raises_is_raised_here(error):
    with pytest.raises(type(error), match=str(error)):
        run(steps(fails, error))


@pytest.mark.parametrize(("function", "arguments", "words"), [(fails, (ZeroDivisionError("1 / 0"),), "1 / 0"), (unportable, (), "HereError: of this process alone")])
def test_an_error_of_the_program_brings_its_traceback_along(function, arguments, words):
    with pytest.raises(Exception, match=words) as caught:
        run(steps(function, *arguments))
    assert f"in {function.__name__}" in str(caught.value.__cause__)


def test_to_close_it_lets_it_clean_up(tmp_path):
    generator = steps(cleans, tmp_path / "mark")
    assert first(generator) == "begun"
    generator.close()
    assert (tmp_path / "mark").read_text() == "closed"


def test_one_that_does_not_listen_is_killed_in_time():
    generator = steps(deaf)
    pid = first(generator)
    began = time.monotonic()
    generator.close()
    assert ASK_S <= time.monotonic() - began < ASK_S + 0.6
    assert gone(pid)


def test_a_killed_process_is_a_sentence_with_a_cure_and_a_crash_is_an_error():
    with pytest.raises(SimulationError, match=r"was killed, as Linux does where memory ends; take fewer experiment\.cells"):
        run(steps(dies, signal.SIGKILL))
    with pytest.raises(RuntimeError, match="ended with status -11"):
        run(steps(dies, signal.SIGSEGV))


@pytest.mark.faults
def test_it_dies_with_its_parent():
    code = "import time; from tests.nodes.test_child import deaf, first, steps; g = steps(deaf); print(first(g), flush=True); time.sleep(100)"
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.kill()
    end = time.monotonic() + PATIENCE_S
    while not gone(pid):
        assert time.monotonic() < end
        time.sleep(0.05)
