"""Holes of a depth image are filled by what the surface around them does."""

from __future__ import annotations

import numpy as np

from diffphys_ros.depth.topic import fill_holes

NEAR_M, FAR_M = 0.34, 0.42


def tilted() -> tuple[np.ndarray, np.ndarray]:
    """Depth (60, 200) [m] of a flat bar seen at a slant, and where the bar is."""
    mask = np.zeros((60, 200), bool)
    mask[20:45, 10:190] = True
    inverse = np.linspace(1 / NEAR_M, 1 / FAR_M, 200)
    return np.where(mask, 1 / np.broadcast_to(inverse, mask.shape), 0.0), mask


def test_an_end_that_is_too_near_for_the_camera_goes_on_in_the_direction_of_the_rest() -> None:
    depth, mask = tilted()
    seen = depth.copy()
    seen[:, :55] = 0
    filled = fill_holes(seen, mask)
    assert np.abs(filled[mask] / depth[mask] - 1).max() < 1e-6


def test_a_hole_in_a_bent_surface_is_filled_by_its_surroundings() -> None:
    depth, mask = tilted()
    bump = 0.01 * np.exp(-(((np.indices(mask.shape)[1] - 120) / 15.0) ** 2))
    depth = np.where(mask, depth - bump, 0.0)
    seen = depth.copy()
    seen[28:34, 117:123] = 0
    filled = fill_holes(seen, mask)
    assert np.abs(filled - depth)[mask].max() < 1e-3
    assert np.array_equal(filled[seen > 0], 1 / (1 / seen[seen > 0]))


def test_what_is_far_off_the_surface_does_not_turn_it() -> None:
    depth, mask = tilted()
    seen = depth.copy()
    seen[:, :55] = 0
    seen[20:24, 150:190] = np.where(seen[20:24, 150:190] > 0, 2.0, 0.0)  # the wall behind, read at the edge
    filled = fill_holes(seen, mask)
    assert np.abs(filled[mask & (seen == 0)] / depth[mask & (seen == 0)] - 1).max() < 5e-3
