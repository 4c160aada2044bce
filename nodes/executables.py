"""The console scripts: one per node, and one of all. They answer signals before anything heavy is imported."""

from __future__ import annotations

import faulthandler
import importlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, NoReturn

from . import middleware

BAD_INPUT = 2
CLEAN_UP_S = 8.0  # launch sends SIGTERM after 5 s and SIGKILL after 10
LOCKED_S = 1.0  # on top of it, for a clean-up that does not let go of the interpreter
ENDING = (signal.SIGINT, signal.SIGTERM)
SPIN_S = 0.1  # longest wait between two looks at the signal


class Stop:
    """SIGINT and SIGTERM: the first one ends the process with status 0, later ones must not disturb the clean-up.

    Where the main thread hangs in the middleware it never learns of the signal; a thread that does ends the process in time.
    """

    wanted = False
    spinning = False

    def __init__(self) -> None:
        told, self._tell = socket.socketpair()
        self._tell.setblocking(False)
        signal.set_wakeup_fd(self._tell.fileno(), warn_on_full_buffer=False)
        threading.Thread(target=self._guard, args=(told,), daemon=True).start()
        for number in ENDING:
            signal.signal(number, self)

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.deafen()
        self.wanted = True
        if not self.spinning:  # imports take seconds; there is nothing to clean up yet
            leave(0)

    @staticmethod
    def deafen() -> None:
        """Ignore signals from here on."""
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)

    @staticmethod
    def _guard(told: socket.socket) -> None:
        while told.recv(1)[0] not in ENDING:  # of other signals nothing follows
            pass
        end_in_time(0)


def leave(status: int) -> NoReturn:
    """End the process without the interpreter's finalisation: a solver thread may be inside native code."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def run(module: str, name: str) -> NoReturn:
    """Imports the node class `name` late, spins it until a signal comes or the node has a status to end with, and ends the process.

    Status 0 after a signal, 2 for bad input (one sentence on stderr), 1 for an error of the program.
    """
    stop, status = Stop(), 0
    middleware.prepare()
    import rclpy

    from diffphys_ros.errors import InputError

    node = None
    try:
        _init(rclpy)
        node = getattr(importlib.import_module(module), name)()
        _spin(node, stop)
        status = 0 if stop.wanted or node.exit_status is None else node.exit_status
    except InputError as error:
        status = BAD_INPUT
        print(f"{module.rsplit('.', 1)[-1]}: {error}", file=sys.stderr)
    except Exception:
        status = 1
        sys.excepthook(*sys.exc_info())
    finally:
        stop.deafen()
        clean_up(status, *((node.close, node.destroy_node) if node is not None else ()), rclpy.try_shutdown)


def clean_up(status: int, *steps: Callable[[], Any]) -> NoReturn:
    """Take these steps and end the process with `status`, whatever the middleware waits for."""
    end_in_time(status)
    for step in steps:
        step()
    leave(status)


def end_in_time(status: int) -> None:
    """From here on a middleware that waits for a dead peer keeps the process for `CLEAN_UP_S` at most; it ends with what it had reached."""

    def end() -> None:
        faulthandler.dump_traceback()
        leave(status)

    guard = threading.Timer(CLEAN_UP_S, end)
    guard.daemon = True
    guard.start()
    faulthandler.dump_traceback_later(CLEAN_UP_S + LOCKED_S, exit=True)  # status 1: no thread of Python can run any more


def _init(rclpy: Any) -> None:
    """Without rclpy's own signal handlers. Raises InputError where the ROS arguments cannot be parsed."""
    from rclpy.signals import SignalHandlerOptions

    from diffphys_ros.errors import InputError

    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise InputError(f"ROS arguments: {error}; numbers of a list need one type, such as [0.0, 0.0, -9.81]") from error


def _spin(node: Any, stop: Stop) -> None:
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    for each in getattr(node, "nodes", (node,)):
        executor.add_node(each)
    stop.spinning = True
    while not stop.wanted and node.exit_status is None:
        executor.spin_once(timeout_sec=SPIN_S)


def _script(module: str, name: str) -> Callable[[], NoReturn]:
    return lambda: run(f"diffphys_ros.nodes.{module}", name)


ingest_node = _script("ingest_node", "IngestNode")
segment_node = _script("segment_node", "SegmentNode")
splat_node = _script("splat_node", "SplatNode")
fit_node = _script("fit_node", "FitNode")
inspect_node = _script("inspect_node", "InspectNode")
graph = _script("composed", "Graph")
