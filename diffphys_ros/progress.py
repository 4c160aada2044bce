"""What long work says while it runs."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class ForceSoFar:
    """The net force that a fit has come to."""

    start_ns: int  # stamp of frame 0 [ns]
    period_s: float  # between frames [s]
    frame_id: str  # of the world
    centre: tuple[float, ...]  # of the object at rest [m], (3,)
    volume_m3: float  # of the object
    net: tuple[tuple[float, ...], ...]  # world frame [N], (T, 3)
    mass_kg: float  # of the object
    density_told: bool  # whether the mass is known, and lengths; without, newtons are assumed
    length_told: bool


@dataclass(frozen=True)
class Progress:
    """One line of news. The command line prints it, a node publishes it; to stop iterating is to cancel."""

    stage: str  # reading, segment, depth, tracks, body, modes, splats, plan, fit, fields, result
    iteration: int = 0
    iterations: int = 0
    loss: float | None = None
    seconds_left: float | None = None
    text: str = ""  # one line for people
    force: ForceSoFar | None = None


def finished(steps: Generator[Any, None, T]) -> T:
    """What a generator returns at its end."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value


def waiting(stage: str, steps: Generator[None, None, T]) -> Generator[Progress, None, T]:
    """What steps return that may have to wait; a news without words for each of theirs, so that they can be cancelled meanwhile."""
    with closing(steps):
        while True:
            try:
                next(steps)
            except StopIteration as stop:
                return stop.value
            yield Progress(stage)


def told(stage: str, steps: Generator[tuple[int, int, float], None, T]) -> Generator[Progress, None, T]:
    """Forward a generator's (iteration, iterations, loss) as Progress of a stage and return its result."""
    while True:
        try:
            iteration, iterations, loss = next(steps)
        except StopIteration as stop:
            return stop.value
        yield Progress(stage, iteration, iterations, loss)
