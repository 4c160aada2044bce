"""A recovery simulated again: from the result alone, with the engine that made its trajectory. Needs no clip and no fit."""

from .again import simulate_again

__all__ = ["simulate_again"]
