"""Lame's constants of an isotropic elastic solid, of numbers, arrays or tensors."""

from __future__ import annotations

from typing import Any


def lame(young: Any, poisson: Any) -> tuple[Any, Any]:
    """lambda and mu [Pa] of Young's modulus [Pa] and Poisson's ratio."""
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def lame_by_poisson(poisson: Any) -> tuple[Any, Any]:
    """Derivatives of `lame` by Poisson's ratio, over Young's modulus."""
    return (1 + 2 * poisson**2) / ((1 + poisson) * (1 - 2 * poisson)) ** 2, -1 / (2 * (1 + poisson) ** 2)
