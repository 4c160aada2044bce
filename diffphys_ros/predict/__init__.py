"""How well an answer predicts the frames of a recording that were kept back from its fit."""

from .figures import Figures, figures
from .held_out import HeldOut, held_out
from .let_free import predicted

__all__ = ["Figures", "HeldOut", "figures", "held_out", "predicted"]
