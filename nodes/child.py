"""A generator that runs in a process of its own: it can be ended at any moment, and takes its memory along.

`steps(function, *arguments)` yields and returns what `function(*arguments)` does there. News and results are pickled; large arrays are
not copied on the way, and those of arguments that are `shared` are there once for both. To close the generator ends the process: it is asked first, so that it can keep a checkpoint, and killed after
ASK_S. It dies with its parent, however that dies.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import pickle
import select
import signal
import socket
import struct
import subprocess
import sys
import traceback
from collections.abc import Callable, Generator, Sequence
from typing import Any

from diffphys_ros.errors import SimulationError

from .memory import give_back_always
from .shared import Place, mapped, place_of

ASK_S = 1.2
LOOK_S = 0.05  # how often the parent looks whether it shall end
NEWS, DONE, FAILED = "news", "done", "failed"
_COUNT, _PART = struct.Struct("<I"), struct.Struct("<QiQ")  # parts; of each its size, and the file where it lies already, and where in that
_HERE = Place(-1, 0)  # it follows
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl
_CODE = "from diffphys_ros.nodes.child import main; main()"


class _ThereError(Exception):
    """The traceback of an error of the other process, as cause of the error here."""

    def __str__(self) -> str:
        return f"in the process that works:\n{self.args[0]}"


class _Asked(BaseException):
    """The parent wants this process to end."""


def steps(function: Callable[..., Generator[Any, None, Any]], *arguments: Any) -> Generator[Any, None, Any]:
    """Yields the news of the other process, and None every LOOK_S in between. Raises what it raised, SimulationError where it was killed."""
    ours, theirs = socket.socketpair()
    parts = _parts((function, arguments))
    files = {place.file for _, place in parts if place != _HERE}
    del arguments
    command = [sys.executable, "-P", "-c", _CODE, str(theirs.fileno()), str(os.getpid())]
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    with ours:
        with theirs:
            # a session of its own: Ctrl-C is for the node, which ends this process in its own way
            process = subprocess.Popen(command, pass_fds=[theirs.fileno(), *files], env=os.environ | {"PYTHONPATH": path}, start_new_session=True)
        try:
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # its end says why
                _send(ours, parts)
            del parts
            while True:
                while not select.select([ours], [], [], LOOK_S)[0]:
                    yield None
                kind, value, there = _receive(ours)
                if kind == DONE:
                    return value
                if kind == FAILED:
                    raise value from (_ThereError(there) if there else None)
                yield value
        except (EOFError, ConnectionResetError):
            raise _ended(process.wait()) from None
        finally:
            _end(process, ours)


def main() -> None:
    """The other process."""
    handle, parent = map(int, sys.argv[1:])
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:  # it died meanwhile
        os._exit(1)
    give_back_always()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _asked)
    status = 0
    with socket.socket(fileno=handle) as link:
        try:
            function, arguments = _receive(link)
            _run(link, function(*arguments))
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        except (_Asked, BrokenPipeError, ConnectionResetError, EOFError):
            status = 1
    sys.stdout.flush()
    os._exit(status)  # nothing of the interpreter's end is of use, and it takes a second


def _run(link: socket.socket, generator: Generator[Any, None, Any]) -> None:
    with contextlib.closing(generator):
        try:
            while True:
                _send(link, _parts((NEWS, next(generator), "")))
        except StopIteration as stop:
            _send(link, _parts((DONE, stop.value, "")))
        except (BrokenPipeError, ConnectionResetError):
            raise
        except Exception as error:
            _send(link, _parts((FAILED, _portable(error), "".join(traceback.format_exception(error)))))


def _asked(number: int, frame: Any) -> None:
    signal.signal(number, signal.SIG_IGN)
    raise _Asked


def _portable(error: Exception) -> Exception:
    """The error, or one with its words where it cannot travel."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _end(process: subprocess.Popen[bytes], link: socket.socket) -> None:
    process.terminate()
    link.close()
    try:
        process.wait(ASK_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _ended(status: int) -> Exception:
    if status == -signal.SIGKILL:
        return SimulationError("the process that works was killed, as Linux does where memory ends; take fewer experiment.cells, experiment.max_splats or a shorter clip")
    return RuntimeError(f"the process that works ended with status {status}")


def _parts(value: Any) -> list[tuple[Any, Place]]:
    """The pickled value and the arrays in it, and where each lies."""
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    return [(pickled, _HERE), *((raw, place_of(raw) or _HERE) for raw in (buffer.raw() for buffer in buffers))]


def _send(link: socket.socket, parts: Sequence[tuple[Any, Place]]) -> None:
    link.sendall(_COUNT.pack(len(parts)))
    for content, place in parts:
        link.sendall(_PART.pack(len(content), *place))
        if place == _HERE:
            link.sendall(content)


def _receive(link: socket.socket) -> Any:
    """Raises EOFError where the other end is gone."""
    parts = [_part(link, *_PART.unpack(_exactly(link, _PART.size))) for _ in range(_COUNT.unpack(_exactly(link, _COUNT.size))[0])]
    return pickle.loads(parts[0], buffers=parts[1:])


def _part(link: socket.socket, size: int, file: int, offset: int) -> bytearray | memoryview:
    place = Place(file, offset)
    return _exactly(link, size) if place == _HERE else mapped(place, size)


def _exactly(link: socket.socket, size: int) -> bytearray:
    content = bytearray(size)
    view = memoryview(content)
    while view:
        count = link.recv_into(view)
        if not count:
            raise EOFError
        view = view[count:]
    return content
