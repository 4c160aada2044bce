"""What a large swing shows beyond one modulus and one drag: that the material gives way as it is strained, and that air resists with the square of
speed. Two numbers, read from the swing's own periods and decay by Gauss and Newton; for small motions they leave what the calm frames tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

ROUNDS = 2  # of both numbers in turn [numerical]
LEAST_GAIN = 0.1  # of the error, that a law must explain to be taken [chosen]
SETTLED = 0.98  # of the error before: more ends the search [numerical]
STEPS = np.array([0.2, 0.1])  # of the two numbers, for differences
MOST = np.array([3.0, 3.0])  # of the two numbers
EXPECTED = 0.03  # error over motion that no such law explains: with a spread of 1 of either number, a swing too small to tell them leaves both 0 [chosen]


@dataclass(frozen=True)
class Yielding:
    """How a material and the air depart from one modulus and one drag."""

    softens: float = 0.0  # share by which the modulus falls, over the strain
    drag_per_m: float = 0.0  # drag over mass and squared speed


@dataclass(frozen=True)
class CalmSwing:
    """The small swing that every such law must show."""

    hz: float
    drag_per_s: float  # over mass and speed
    speed_m_s: float  # at which drag of the square of speed brakes a calm swing as it does
    softening: tuple[float, float]  # its frequency over that of a smaller one still: of a modulus that does not give way, and how it changes with `softens`

    def small_hz(self, law: Yielding) -> float:
        """Frequency of the smallest swing."""
        return self.hz / (self.softening[0] + self.softening[1] * law.softens)

    def drag(self, law: Yielding) -> float:
        """Drag over mass and speed [1/s] beside that of the square of speed."""
        return max(self.drag_per_s - law.drag_per_m * self.speed_m_s, 0.0)


@dataclass(frozen=True)
class Swung:
    """A swing let go: its law, where its free end is (T, 2) [px], and where it would be under a constant modulus and drag."""

    law: Yielding
    tip: np.ndarray
    constant: np.ndarray


def fitted(let_go: Callable[[Yielding], np.ndarray | None], told: np.ndarray) -> Swung | None:
    """The law under which the free end (T, 2) [px] goes where it was told to go; None where the motion cannot be simulated."""
    constant = let_go(Yielding())
    if constant is None:
        return None
    unit, least = EXPECTED * _missed(told.mean(0), told), _missed(constant, told)
    most = (1 - LEAST_GAIN) * least
    at, tip, best = np.zeros(2), constant, Swung(Yielding(), constant, constant)
    for _ in range(ROUNDS):
        nearby = [let_go(Yielding(*(at + step))) for step in np.diag(STEPS)]
        if any(each is None for each in nearby):
            break
        slope = np.stack([(each - tip).ravel() / step for each, step in zip(nearby, STEPS, strict=True) if each is not None], 1) / unit
        off = (tip - told).ravel() / unit
        at = at + lsq_linear(np.vstack([slope, np.eye(2)]), -np.concatenate([off, at]), (-at, MOST - at), method="bvls").x  # one at its bound, the other fits with it there
        found = let_go(Yielding(*at))
        if found is None:
            break
        tip = found
        before, missed = least, _missed(tip, told)
        if missed < before:
            best, least = Swung(Yielding(*map(float, at)), tip, constant), missed
        if missed > SETTLED * before:
            break
    return best if least <= most else Swung(Yielding(), constant, constant)


def _missed(tip: np.ndarray, told: np.ndarray) -> float:
    return float(np.sqrt(((tip - told) ** 2).sum()))
