"""Surface points that were followed through the clip."""

from __future__ import annotations

import torch

from .told import Evidence, Moved, Told


def track_evidence(told: Told) -> Evidence:
    """Misfit of the tracks."""

    def misfit(moved: Moved) -> dict[str, torch.Tensor]:
        return {"track": told.weights.track_weight * told.target.loss(told.binding.apply(moved.x - moved.x[:1])).double()}

    return misfit
