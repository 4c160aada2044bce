"""The force sought frame by frame (paper appendix D), each from the exact state that the forces before it lead to."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from ..errors import SimulationError
from ..fields import NodeForce
from .adam import Best, lowered, plain_descent
from .descent import Descent, Space
from .model import Model
from .unknowns import Unknowns


def transitions(model: Model, space: Space, begun: Descent | None) -> Iterator[Descent]:
    """A state for each frame whose force is found; those that `begun` counts are kept. The force of a frame is judged by the pictures of the
    next experiment.transition_window ones, whose forces are sought along with it and again afterwards: by the next picture alone, a force that
    comes late would be answered by one of the other sign for ever."""
    walk = Walk(model)
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

    def __init__(self, model: Model) -> None:
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
        """Give the features of a frame, and for the time being of those after it, the values that show the next pictures best; their loss."""
        features, window = self.field.features, slice(frame, min(frame + self.experiment.transition_window, self.frames))
        with torch.no_grad():
            for k in range(max(window.start, 1) if frame == 0 else max(window.stop - 1, 1), window.stop):
                features[k] = features[k - 1]  # force goes on as it was until pictures say otherwise
        sought = features[window].detach().clone().requires_grad_(True)
        best = Best([sought])
        for _ in lowered([([sought], self.experiment.force_rate)], self.experiment.transition_iterations, self.experiment.last_rate, lambda: self._loss(sought, window), best):
            pass
        with torch.no_grad():
            features[window] = best.values[0]
        return best.loss

    def go_on(self, frame: int) -> None:
        """One frame further, as the whole clip will be simulated."""
        with torch.no_grad():
            force = self.family[frame] + self.field.decoded(self.field.features[frame : frame + 1])[0] * self.model.allowed[frame]
            self.here = self.forward.advance(self.here, self.start, self.unknowns, self.material.young, self.material.poisson, force[None], frame)[0]

    def _loss(self, sought: Tensor, window: slice) -> Tensor:
        """Of the pictures after a window's forces (paper A.12), infinite where the simulation leaves its bounds."""
        force = self.field.decoded(sought) * self.model.allowed[window]
        try:
            states = self.forward.advance(self.here, self.start, self.unknowns, self.material.young, self.material.poisson, self.family[window] + force, window.start)
        except SimulationError as error:
            return self.model.problem.objective.failed(str(error)).total
        x, F = (torch.stack([getattr(state, name) for state in states]) for name in ("x", "F"))
        picture = self.term.of_frames(np.arange(window.start, window.stop) + 1, x, self.start.x, F @ self.upright)
        before = self.field.decoded(self.field.features[window.start - 1 : window.start].detach()) if window.start else force[:0]
        return self.experiment.image_weight * picture + self.experiment.force_smoothness * self.model.smoothness(torch.cat([before, force]) / self.unit)


