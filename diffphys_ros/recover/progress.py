"""What long work says while it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Progress:
    """One line of news. The command line prints it, a node publishes it; to stop iterating is to cancel."""

    stage: str  # reading, segment, depth, tracks, body, modes, splats, plan, fit, fields, result
    iteration: int = 0
    iterations: int = 0
    loss: float | None = None
    seconds_left: float | None = None
    text: str = ""  # one line for people
    artefact: Any = None  # what the stage made: StartValues, Splats, Recovery; None while under way
