"""A made-up first frame: an upright stem (part 1) that carries a flower (part 2)."""

from __future__ import annotations

import json

import numpy as np
import pytest

from diffphys_ros.types import Camera, Clip

HEIGHT, WIDTH = 60, 80
STEM = {"name": "stem", "box": [0.4, 0.5, 0.6, 1.0], "material": "green stem", "E": 2e8, "nu": 0.35, "rho": 900}
FLOWER = {"name": "flower", "box": [0.2, 0.1, 0.8, 0.5], "material": "petal", "E": 2e6, "nu": 0.4, "rho": 600}
GOOD = json.dumps([STEM, FLOWER])


@pytest.fixture
def labels() -> np.ndarray:
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    image[30:60, 36:44] = 1
    image[6:30, 20:60] = 2
    image[0:6, 20:60] = 255
    return image


@pytest.fixture
def frame(labels) -> np.ndarray:
    colours = np.array([[250, 250, 250], [40, 140, 50], [220, 60, 120]], np.uint8)
    return colours[np.where(labels == 255, 0, labels)]


@pytest.fixture
def clip(frame, labels) -> Clip:
    camera = Camera(np.array([[80.0, 0, 39.5], [0, 80.0, 29.5], [0, 0, 1]]), np.eye(4), WIDTH, HEIGHT)
    return Clip(frame[None], 0, 1 / 30, camera, labels=labels[None], source="made up")
