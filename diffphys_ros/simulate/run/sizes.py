"""What a simulator keeps in memory between the forward and the backward pass of a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

NODE_VALUES = 4  # scalars per node of a velocity grid
WORTH = 0.2  # share of a rollout's frames from which tapes of whole frames are kept: fewer save less time than they take memory


@dataclass(frozen=True)
class TapePlan:
    """Sizes of the tapes. A tape holds the states of `chunk` + 1 consecutive substeps.

    Three levels, by what fits the budget: states and nodal velocities of `kept` frames, which stay from the forward to the
    backward pass and are not replayed (other frames take one of these tapes over; only one where those that fit are less than
    WORTH of them); the states of one frame, which is replayed whole (chunk = substeps); else a frame is replayed from `marks`
    a chunk of ceil(sqrt(substeps)) at a time.
    """

    substeps: int
    chunk: int
    keep_velocity: bool
    kept: int

    @classmethod
    def within(cls, budget: float, *, substeps: int, state: int, velocity: int, frames: int = 0) -> TapePlan:
        """The plan for a budget and the sizes of one state and one velocity grid, all in bytes; `frames` of a rollout, where that is known."""
        states = (substeps + 1) * state
        whole = states + substeps * velocity
        if whole <= budget:
            kept = int(budget // whole)
            return cls(substeps, substeps, True, kept if kept >= WORTH * frames else 1)
        if states <= budget:
            return cls(substeps, substeps, False, 0)
        return cls(substeps, math.ceil(math.sqrt(substeps)), False, 0)

    @property
    def marks(self) -> int:
        """Chunk starts kept during a replay; none where one chunk is the whole frame."""
        chunks = math.ceil(self.substeps / self.chunk)
        return chunks if chunks > 1 else 0

    @property
    def states(self) -> int:
        """States kept during a replay: about 2 sqrt(substeps) where the budget is small."""
        return self.chunk + 1 + self.marks
