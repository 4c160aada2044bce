"""make paper: what the appearance allows."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.types import Camera, Clip
from tools.paper import oracle
from tools.paper.oracle import moved_freely
from tools.paper.pictures import frozen, moving, scores


@pytest.mark.slow
def test_gaussians_that_flow_moves_follow_a_square_and_keep_their_colours() -> None:
    texture = np.random.default_rng(0).integers(60, 250, (6, 6, 3)).repeat(5, 0).repeat(5, 1).astype(np.uint8)
    frames, labels = np.full((4, 64, 80, 3), 40, np.uint8), np.zeros((4, 64, 80), np.uint8)
    for k in range(4):
        frames[k, 15:45, 20 + 2 * k : 50 + 2 * k], labels[k, 15:45, 20 + 2 * k : 50 + 2 * k] = texture, 1
    camera = Camera(np.array([[100.0, 0, 40], [0, 100, 32], [0, 0, 1]]), np.eye(4), 80, 64, "camera", "world")
    shown = moved_freely(Clip(frames, 0, 0.04, camera, labels=labels), build({"fit.device": "cpu", "experiment.max_splats": 900}))
    mask = moving(frames)
    assert scores(shown, frames, mask)[0] > scores(frozen(frames), frames, mask)[0] + 8


def test_flow_is_read_bilinearly_at_the_pixels_of_forty_thousand_gaussians() -> None:
    v, u = np.mgrid[0:20, 0:30].astype(np.float32)
    flow = np.stack([2 * u + v, u - 3 * v], -1)
    pixels = np.random.default_rng(0).uniform(0, [29, 19], (40_000, 2))
    expected = np.stack([2 * pixels[:, 0] + pixels[:, 1], pixels[:, 0] - 3 * pixels[:, 1]], -1)
    assert np.abs(oracle.values_at(flow, pixels) - expected).max() < 1e-3


def test_flow_beyond_the_picture_is_that_of_its_border() -> None:
    flow = np.arange(6, dtype=np.float32).reshape(1, 3, 2)
    assert oracle.values_at(flow, np.array([[-5.0, 0.0], [9.0, 4.0]])).tolist() == [[0, 1], [4, 5]]
