"""One stage of a fit: what is free, and how the descent goes."""

from __future__ import annotations

from dataclasses import dataclass

from ..descent import Rules
from ..evidence import EVIDENCE


@dataclass(frozen=True)
class Stage:
    """Stages of one name share their count of iterations, their losses and their line of news."""

    name: str  # of its news
    free: tuple[str, ...]  # blocks and fields (unknowns.py) that the loss is lowered over
    states: int  # at most, the one that it begins with included
    rules: Rules
    engine: str = "mpm"  # a name of Problem.engines
    evidence: tuple[str, ...] = tuple(EVIDENCE)  # kinds that count
    fields: bool = False  # whether fields go on from where constants per part and vectors per frame ended
    way: str = "lbfgs"  # how the loss is lowered: a name of fit.py's WAYS
    spare: float = 1.0  # times that an iteration took must be left of the time for the next
