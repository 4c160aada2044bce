"""The constants of a law as the substeps read them: four numbers a particle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from ...errors import InputError
from ...hooke import lame
from .law import CONSTANTS, Law

Given = Mapping[str, float | np.ndarray | Tensor]


def checked(name: str, law: Law, given: Given) -> Given:
    """The parameters given for the law of that name, if it has them and they are in bounds. Raises InputError."""
    known = {p.name: p for p in law.parameters}
    for key, value in given.items():
        if key not in known:
            raise InputError(f"law_parameters: {name} has no {key!r}; " + (f"choose from {', '.join(known)}" if known else "leave it out"))
        low, high = (float(bound) for bound in torch.as_tensor(value).detach().aminmax())
        if not (known[key].low <= low and high <= known[key].high):
            bounds = f"{known[key].low:g} .. {known[key].high:g}"
            raise InputError(f"law_parameters: {key} reaches from {low:g} to {high:g}, must be in {bounds}; it is the {known[key].doc}")
    return given


def stacked(law: Law, young: Tensor, poisson: Tensor, given: Given, like: Tensor) -> Tensor:
    """Lame's mu and lam [Pa], then the law's own, (P, 4) for `like` (P,); differentiable in all of them."""
    lam, mu = lame(young, poisson)
    own = [given.get(p.name, p.default) for p in law.parameters]
    known = torch.stack([_number(v, like).expand_as(like) for v in (mu, lam, *own)], -1)
    return torch.nn.functional.pad(known, (0, CONSTANTS - known.shape[-1]))


def _number(value: float | np.ndarray | Tensor, like: Tensor) -> Tensor:
    """A tensor of `like`'s type; a plain number without a copy between devices."""
    return like.new_full((), value) if isinstance(value, float) else torch.as_tensor(value).to(like)
