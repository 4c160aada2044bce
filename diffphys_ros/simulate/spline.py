"""Quadratic B-spline weights along one axis, as Warp functions."""

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

from typing import Any

import warp as wp


def build(real: type) -> tuple[Any, Any]:
    """(weights, slopes): both take the distance of a point from the first of its three nodes, in cells [0.5, 1.5)."""
    vec3 = wp.types.vector(3, real)

    @wp.func
    def weights(f: real):
        a = real(1.5) - f
        b = f - real(1.0)
        c = f - real(0.5)
        return vec3(real(0.5) * a * a, real(0.75) - b * b, real(0.5) * c * c)

    @wp.func
    def slopes(f: real):
        return vec3(f - real(1.5), real(2.0) - real(2.0) * f, f - real(0.5))

    return weights, slopes
