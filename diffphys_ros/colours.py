"""Colours shared by the figure, the markers and the rerun recording, so that a stiffness has one colour everywhere."""

from __future__ import annotations

import numpy as np

COMPONENTS = ("#d1495b", "#3a9d6e", "#2f6db5")  # x, y, z
NET = "#222222"
_RAMP = np.array([[38, 40, 112], [40, 98, 158], [42, 157, 162], [126, 204, 138], [246, 224, 94]])  # dark = soft, light = stiff
_LEAST_SPAN = 0.5  # of log10 E: a uniform body is not painted with its rounding errors


def ramp(share: np.ndarray) -> np.ndarray:
    """RGB 0..255 uint8 (..., 3) of shares 0..1 (...) along the ramp from dark blue to yellow; grey where not finite."""
    share = np.asarray(share, float)
    place = np.linspace(0, 1, len(_RAMP))
    rgb = np.stack([np.interp(np.nan_to_num(share), place, _RAMP[:, i]) for i in range(3)], -1)
    return np.where(np.isfinite(share)[..., None], rgb, 150).astype(np.uint8)


def stiffness_range(young: np.ndarray) -> tuple[float, float]:
    """Ends of the colour ramp in log10 Pa for Young's moduli [Pa]."""
    log_young = np.log10(young[np.isfinite(young)])
    if not len(log_young):
        return 0.0, 1.0
    low, high = float(log_young.min()), float(log_young.max())
    margin = max(0.1 * (high - low), (_LEAST_SPAN - (high - low)) / 2)
    return low - margin, high + margin


def stiffness_colours(young: np.ndarray) -> np.ndarray:
    """RGB uint8 (N, 3) of Young's moduli [Pa] (N,); grey where NaN."""
    low, high = stiffness_range(young)
    return ramp((np.log10(young) - low) / (high - low))


def in_words(value: float, unit: str) -> str:
    """A stiffness for people, in pascals or another unit."""
    if unit == "Pa" or not np.isfinite(value):
        return pascals(value)
    return f"{value:.3g} {unit}".rstrip()


def pascals(value: float) -> str:
    """A stiffness for people: 83.2 kPa."""
    if not np.isfinite(value):
        return "not identified"
    for unit, size in (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} Pa"
