"""Tracks and body follow the depth source that was asked for, and the answer says what fixed its scale."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.inverse import prepare
from diffphys_ros.progress import Progress
from diffphys_ros.types import Clip
from tests.boxes import bar, bar_settings, box_clip, camera_at, turned


@pytest.fixture(scope="module")
def swinging() -> Clip:
    poses = [turned(0.06 * np.sin(0.7 * k)) for k in range(12)]
    return box_clip(bar(), poses, camera_at((0.12, -0.6, 0.0), (0.12, 0, 0)))


@pytest.mark.parametrize("source", ["topic", "inflate", "plane"])
def test_every_depth_source_leads_to_a_body_and_tracks_on_it(swinging: Clip, source: str) -> None:
    news: list[Progress] = []
    for step in prepare(swinging, bar_settings(depth__source=source)):
        news.append(step)
        if "cm^3" in step.text:
            break
    counts = [int(step.text.split()[0]) for step in news if "tracks, noise" in step.text]
    assert counts
    assert counts[0] > 50
    assert any("cm^3" in step.text for step in news)
