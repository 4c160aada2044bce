"""An object without texture, seen by its outline: when it is calm (reference), where its edge is (edges), how that moves (follow). Needs OpenCV."""

from .follow import end_of, follow_outline, normal_of
from .reference import Calm, calm_part
from .texture import has_texture

__all__ = ["Calm", "calm_part", "end_of", "follow_outline", "has_texture", "normal_of"]
