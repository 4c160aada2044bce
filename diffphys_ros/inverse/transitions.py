"""The force sought frame by frame (paper appendix D), each from the exact state that the forces before it lead to."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from ..errors import SimulationError
from ..fields import NodeForce
from .clock import Clock
from .descent import Descent, Rules, Space, begin, descend
from .model import Model
from .unknowns import Unknowns

RULES = Rules(memory=20, patience=None)  # of the search for a frame's force: steps that are remembered [numerical]
COARSE_SHARE = 1 / 3  # of its iterations, in which pictures are compared in blocks [chosen]
FIRST = 6.0  # time for the first frame over that for another: its force begins from none, the others from their neighbour's [chosen]


def transitions(model: Model, space: Space, begun: Descent | None, clock: Clock) -> Iterator[Descent]:
    """A state for each frame whose force is found; those that `begun` counts are kept. Each frame has an equal share of the clock's time, the first FIRST of them. The force of a frame is judged by the next picture:
    the velocity that it leaves must be answered by the next force, which experiment.frame_drag lets fade from frame to frame."""
    walk = Walk(model, clock)
    first, values = (0, 0.0) if begun is None else (begun.iteration, begun.value * begun.iteration)
    for frame in range(walk.frames):
        if frame >= first:
            values += walk.seek(frame)
            if not math.isfinite(values):  # nothing that was tried could be simulated
                yield plain_descent(space.vector(), values, frame)
                return
        walk.go_on(frame)
        if frame >= first:
            yield plain_descent(space.vector(), values / (frame + 1), frame + 1)


class Walk:
    """Material points on their way through the clip, and what pushes them there."""

    def __init__(self, model: Model, clock: Clock) -> None:
        self.clock = clock
        problem, forward = model.problem, model.problem.forward
        assert isinstance(model.force, NodeForce)
        assert model.material is not None
        self.model, self.forward, self.field = model, forward, model.force
        self.experiment, self.unit = problem.settings.experiment, problem.field_unit
        self.term = problem.objective.evidence["pixels"].term  # type: ignore[attr-defined]
        with torch.no_grad():
            z = model.z.to(forward.device, forward.dtype)
            self.unknowns: Unknowns = problem.layout.unpack(z, modes=forward.basis.shape[2])
            self.material = model.material(model.x)
            self.family = forward.node_force(self.unknowns, None)
            self.start = forward.start_of(self.unknowns, self.material.young, self.material.poisson)
        self.here, self.frames = self.start, len(model.frames)
        self.upright = torch.linalg.inv(self.start.F)

    def seek(self, frame: int) -> float:
        """Give the features of a frame the values that show the next picture best; their loss."""
        features = self.field.features
        end_s = self.clock.slice_end_s(self.frames - frame if frame else 1 + (self.frames - 1) / FIRST)
        sought = self._guess(frame).requires_grad_(True)
        coarse = round(COARSE_SHARE * self.experiment.transition_iterations) if self.experiment.coarse_px > 1 else 0
        if coarse:
            self._lower(sought, frame, self.experiment.coarse_px, coarse, COARSE_SHARE * end_s + (1 - COARSE_SHARE) * self.clock.spent_s)
        value = self._lower(sought, frame, 1, self.experiment.transition_iterations - coarse, end_s)
        with torch.no_grad():
            features[frame] = sought[0]
        return value

    def _lower(self, sought: Tensor, frame: int, block_px: int, iterations: int, end_s: float) -> float:
        """Give features (1, voxels, channels) the values that show the next picture best in blocks of so many pixels, as far as the search comes
        until `end_s` of the clock; their loss."""
        space, loss = Space([sought]), partial(self._loss, sought, frame, block_px)
        state = begin(space, loss())
        for here in islice(descend(space, loss, state, RULES), iterations):
            state = here
            if self.clock.spent_s > end_s:
                break
        space.assign(state.at)
        return state.value

    @torch.no_grad()
    def _guess(self, frame: int) -> Tensor:
        """Features (1, voxels, channels) to begin with: shares of those of the frame before, that which shows the next picture best."""
        before = self.field.features[max(frame - 1, 0)].detach()[None]
        if not frame:
            return before.clone()
        held = held_share(self.experiment.frame_drag)
        return min((share * before for share in (1.0, 1 - held, 0.0, -held)), key=lambda features: float(self._loss(features, frame)))

    def go_on(self, frame: int) -> None:
        """One frame further, as the whole clip will be simulated."""
        with torch.no_grad():
            force = self.family[frame] + self.field.decoded(self.field.features[frame : frame + 1])[0] * self.model.allowed[frame]
            self.here = self.forward.advance(self.here, self.start, self.unknowns, self.material.young, self.material.poisson, force[None], frame)[0]

    def _loss(self, sought: Tensor, frame: int, block_px: int = 1) -> Tensor:
        """Of the picture after a frame's force (paper A.12) in blocks of so many pixels, infinite where the simulation leaves its bounds."""
        force = self.field.decoded(sought) * self.model.allowed[frame]
        try:
            state = self.forward.advance(self.here, self.start, self.unknowns, self.material.young, self.material.poisson, self.family[frame] + force, frame)[0]
        except SimulationError as error:
            return self.model.problem.objective.failed(str(error)).total
        picture = self.term.of_frames(np.array([frame + 1]), state.x[None], self.start.x, (state.F @ self.upright)[None], block_px=block_px)
        before = self.field.decoded(self.field.features[frame - 1 : frame].detach()) if frame else force[:0]
        return self.experiment.image_weight * picture + self.experiment.force_smoothness * self.model.smoothness(torch.cat([before, force]) / self.unit)


def plain_descent(at: np.ndarray, value: float, iteration: int) -> Descent:
    """A state that remembers no steps."""
    at = at.astype(np.float32)
    none = np.zeros((0, len(at)), np.float32)
    return Descent(at, value, np.zeros_like(at), none, none, iteration)


def held_share(drag: float) -> float:
    """By how many times the force under which a free body came from rest in one frame it must be pulled back to stay there in the next, where a
    velocity fades by exp(-drag) in a frame: 2 without drag, 0 where it fades at once."""
    if drag < 1e-3:  # where the quotient is rounding
        return 2.0
    return (1 - math.exp(-drag)) ** 2 / (drag - 1 + math.exp(-drag))
