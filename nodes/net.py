"""One net under every callback of a node: bad input costs a sentence, an error of the program its traceback, and the node lives on."""

from __future__ import annotations

import functools
import time
import traceback
from collections.abc import Callable
from typing import Any

from diffphys_ros.errors import InputError, SimulationError

SAID_AGAIN_S = 5.0  # a flood of bad messages must not become a flood of words
RECENT_S = 5.0  # how long /diagnostics warns of bad input
MAX_WORDS = 600  # characters of a sentence that is logged


class Net:
    """Catches what callbacks raise, logs it at most every SAID_AGAIN_S per place, and counts it for /diagnostics.

    `logger` gives an rclpy logger; it is asked late, because a node makes services of its own before it has one.
    """

    def __init__(self, logger: Callable[[], Any]) -> None:
        self.refused, self.faults = 0, 0  # bad inputs and errors of the program
        self.last, self.last_fault = "", ""  # what the latest error said, and the latest one of the program
        self._logger = logger
        self._said: dict[str, tuple[float, int]] = {}  # place: when it was last heard of, and how much was left unsaid since
        self._refused_at = -float("inf")

    @property
    def bad_input_lately(self) -> bool:
        """Whether input was refused within RECENT_S."""
        return time.monotonic() - self._refused_at < RECENT_S

    def around(self, callback: Callable[..., Any], place: str) -> Callable[..., Any]:
        """The callback, of a subscription or a timer, under the net; rclpy sees its signature."""

        @functools.wraps(callback)
        def caught(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except Exception as error:
                self.catch(error, place)
                return None

        return caught

    def answering(self, callback: Callable[[Any, Any], Any], place: str) -> Callable[[Any, Any], Any]:
        """The callback of a service under the net: whoever calls gets an answer."""

        @functools.wraps(callback)
        def caught(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                sentence = self.catch(error, place)
                if hasattr(response, "success") and hasattr(response, "message"):
                    response.success, response.message = False, sentence
                return response

        return caught

    def catch(self, error: Exception, place: str) -> str:
        """Count and log an error; returns its sentence."""
        sentence = sentence_of(error)
        self.last = sentence if place in sentence else f"{place}: {sentence}"
        if foreseen(error):
            self.refused, self._refused_at = self.refused + 1, time.monotonic()
            self._log(place, self.last)
        else:
            self.faults, self.last_fault = self.faults + 1, self.last
            self._log(place, f"{self.last}\n{''.join(traceback.format_exception(error))}")
        return sentence

    def _log(self, place: str, words: str) -> None:
        now, (then, unsaid) = time.monotonic(), self._said.get(place, (-float("inf"), 0))
        if now - then < SAID_AGAIN_S:
            self._said[place] = then, unsaid + 1
            return
        self._said[place] = now, 0
        self._logger().error(words + (f" ({unsaid} more before)" if unsaid else ""))


def foreseen(error: Exception) -> bool:
    """Whether an error is about the input rather than of the program."""
    return isinstance(error, (InputError, SimulationError))


def sentence_of(error: Exception) -> str:
    """One printable line for people, of at most MAX_WORDS characters."""
    text = str(error) if foreseen(error) else f"error of the program: {type(error).__name__}: {error}"
    text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return text if len(text) <= MAX_WORDS else text[: MAX_WORDS - 3] + "..."
