"""Procedural textures of the sample as PNG bytes."""

from __future__ import annotations

import cv2
import numpy as np

from tools.sample_maker.bar import Bar


def assets(bar: Bar, seed: int) -> dict[str, bytes]:
    """PNG files by name: the skins of the parts, of opposite hue, a smooth wall and a floor."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:256, :256][..., None] / 256.0
    blend = 0.6 * y + 0.4 * x
    wall, floor = rng.uniform(185, 210, 3), rng.uniform(105, 140, 3)
    tiles = ((np.floor(8 * y) + np.floor(8 * x)) % 2) * 10
    files = {f"part{i}.png": _png(_skin(bar.hue + i / 2, rng)) for i in range(bar.shape.parts)}
    return files | {"wall.png": _png(wall - 40 * blend), "floor.png": _png(floor - tiles - 12 * blend)}


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", np.clip(image, 0, 255).astype(np.uint8)[..., ::-1])[1].tobytes()


def _skin(hue: float, rng: np.random.Generator, size: int = 1024) -> np.ndarray:
    """Noise between a light and a dark shade of a hue, with dots: something to track at every scale, (size, size, 3)."""
    light = np.clip(200 * (0.5 + 0.5 * np.cos(2 * np.pi * (hue + np.array([0, 1 / 3, 2 / 3])))) + 40, 0, 255)
    dark = light * rng.uniform(0.25, 0.4)
    noise = np.zeros((size, size))
    for level in range(2, 8):
        noise += cv2.resize(rng.random((2**level, 2**level)), (size, size), interpolation=cv2.INTER_CUBIC)
    noise = ((noise - noise.min()) / np.ptp(noise))[..., None]
    image = np.ascontiguousarray(light * (0.5 + 0.5 * noise) + dark * 0.5 * (1 - noise))
    for _ in range(420):
        centre, shade = rng.integers(0, size, 2).tolist(), (dark if rng.random() < 0.6 else np.minimum(light * 1.3 + 25, 255))
        cv2.circle(image, centre, int(rng.integers(5, 20)), (shade * rng.uniform(0.8, 1.2)).tolist(), -1, lineType=cv2.LINE_AA)
    return image
