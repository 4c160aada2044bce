"""The solid of a slab from its silhouette alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from diffphys_ros.body import build_body
from diffphys_ros.columns import solid_columns
from diffphys_ros.depth import surface_depth
from diffphys_ros.types import Clip
from tests.boxes import Box, bar, bar_settings, camera_at, limbs_clip

BRANCH = Box(np.array([0.12, -0.025, 0.03]), np.array([0.17, 0.025, 0.13]))
ASLANT = {"from the clamp's side": (-0.05, -0.42, 0.3), "from the free end": (0.4, -0.38, 0.3), "from below": (0.35, -0.4, -0.28)}


@pytest.fixture(scope="module", params=ASLANT)
def branched(request: pytest.FixtureRequest) -> Clip:
    """A bar with a branch as thick as wide, seen aslant."""
    return limbs_clip([bar(), BRANCH], camera_at(ASLANT[request.param], (0.13, 0, 0.03), width=320, height=240, focal=380.0))


def test_a_branch_seen_aslant_has_no_web_in_its_corners(branched: Clip) -> None:
    """All that the silhouette allows is 2 to 4 % more than there is, what falls onto the object in front and behind alone 4 % and more."""
    settings = bar_settings(scene__density_kg_m3=[500.0], scene__mass_kg=None)
    clip = replace(branched, depth=None)
    body = build_body(clip, surface_depth(clip, settings)[0], settings)
    assert body.volume_m3 == pytest.approx(bar().volume + BRANCH.volume, rel=0.02)


def test_the_side_of_one_limb_beside_the_front_of_another_lies_where_it_is(branched: Clip) -> None:
    clip = replace(branched, depth=None)
    found, _ = surface_depth(clip, bar_settings())
    inner = cv2.erode((branched.labels[0] > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    off = np.abs(found - branched.depth[0])[inner]
    assert np.quantile(off, 0.95) < 0.004
    assert np.mean(off > 0.015) < 0.01


def fallen(camera_shift: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Pixels of both ends of columns over a raster that is seen in parallel, and what falls onto the silhouette of those in `shape`."""
    front = np.stack(np.meshgrid(np.arange(shape.shape[1]), np.arange(shape.shape[0])), -1).astype(float)
    silhouette = np.zeros(shape.shape, bool)
    for share in np.linspace(0, 1, 200):
        dx, dy = np.rint(share * camera_shift).astype(int)
        silhouette |= np.roll(shape, (dy, dx), (0, 1))

    def on_object(pixels: np.ndarray) -> np.ndarray:
        u, v = np.moveaxis(np.rint(pixels).astype(int), -1, 0)
        within = (u >= 0) & (v >= 0) & (u < shape.shape[1]) & (v < shape.shape[0])
        return within & silhouette[np.clip(v, 0, shape.shape[0] - 1), np.clip(u, 0, shape.shape[1] - 1)]

    return front, front + camera_shift, on_object


@pytest.mark.parametrize("shift", [(40.0, 24.0), (-30.0, 18.0), (12.0, -50.0)])
def test_a_body_without_corners_between_limbs_is_all_that_its_silhouette_allows(shift: tuple[float, float]) -> None:
    v, u = np.indices((300, 300))
    leaf = ((u - 150) / 40.0) ** 2 + ((v - 150) / 75.0) ** 2 < 1
    solid = solid_columns(*fallen(np.array(shift), leaf), 1.0)
    assert np.mean(solid != leaf) < 0.003


def test_nothing_of_an_object_is_taken_where_it_is_seen_straight_on() -> None:
    cross = np.zeros((200, 200), bool)
    cross[90:110, 20:180] = cross[20:180, 90:110] = True
    assert (solid_columns(*fallen(np.zeros(2), cross), 1.0) == cross).all()


def test_the_four_corners_of_a_cross_are_those_of_its_limbs() -> None:
    cross = np.zeros((300, 300), bool)
    cross[130:170, 60:240] = cross[60:240, 130:170] = True
    solid = solid_columns(*fallen(np.array([24.0, 20.0]), cross), 1.0)
    assert np.mean(solid != cross) < 0.002
