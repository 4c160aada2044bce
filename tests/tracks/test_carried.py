"""An object that turns too far between two frames for its surface to be followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.depth import surface_depth
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.prepare import _by_points
from diffphys_ros.progress import finished
from diffphys_ros.tracks import LostError, carried, follow
from diffphys_ros.types import Clip
from tests.boxes import Box, bar_settings, box_clip, camera_at, turned

STEP_M, TURN = np.array([0.004, 0.0, -0.006]), np.deg2rad(40.0)
THROWN = {"scene__clamp_box_m": None, "scene__floor_z_m": -0.3, "scene__at_rest": False}


@pytest.fixture(scope="module")
def tumbling() -> Clip:
    """A block that flies and turns about the line of sight by 40 degrees a frame."""
    block = Box(np.array([-0.05, -0.025, -0.04]), np.array([0.05, 0.025, 0.04]))
    poses = [turned(TURN * k) for k in range(10)]
    for k, pose in enumerate(poses):
        pose[:3, 3] = k * STEP_M
    return box_clip(block, poses, camera_at((0.0, -0.6, 0.0), (0.0, 0, 0)))


def test_its_points_go_with_its_middle(tumbling: Clip) -> None:
    settings = bar_settings(**THROWN)
    depth0, _ = surface_depth(tumbling, settings)
    with pytest.raises(LostError, match="could be followed"):
        follow(tumbling, depth0, settings)
    tracks = carried(tumbling, depth0, spacing_px=6)
    moved = tracks.points - tracks.points[0]
    assert np.abs(moved - moved[:, :1]).max() < 1e-9
    assert np.abs(moved[:, 0] - STEP_M * np.arange(10)[:, None]).max() < 2e-3
    assert tracks.valid.all()
    assert tracks.noise_m == pytest.approx(np.sqrt((0.1**2 + 0.08**2) / 12 / 3), rel=0.2)


def test_what_is_not_seen_in_a_frame_does_not_hold_there(tumbling: Clip) -> None:
    assert tumbling.labels is not None
    labels = tumbling.labels.copy()
    labels[4] = 0
    tracks = carried(tumbling.with_labels(labels), surface_depth(tumbling, bar_settings(**THROWN))[0], spacing_px=6)
    assert not tracks.valid[4].any()
    assert tracks.sd_m is not None
    assert np.isinf(tracks.sd_m[4]).all()
    assert np.isfinite(tracks.sd_m[5]).all()


def test_a_thrown_object_is_carried_and_says_so(tumbling: Clip) -> None:
    held, _, _, body = finished(_by_points(tumbling, bar_settings(**THROWN)))
    assert "could not be followed" in held.clip.notes[-1]
    assert body.volume_m3 == pytest.approx(0.1 * 0.05 * 0.08, rel=0.05)


def test_what_is_held_is_refused_as_before(tumbling: Clip) -> None:
    told = bar_settings(**THROWN | {"scene__clamp_box_m": [-0.055, -0.03, -0.045, -0.045, 0.03, 0.045]})
    with pytest.raises(InputError, match="could be followed"):
        finished(_by_points(tumbling, told))
    with pytest.raises(InputError, match="could be followed"):
        finished(_by_points(replace(tumbling, depth=None), bar_settings(**THROWN)))
