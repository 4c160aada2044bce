"""An object without texture, seen by its outline: when it is calm (reference), where its edge is (edges), what shape it has at rest (average), how
it moves (follow). Needs OpenCV."""

from .average import covered, end_of, rest_cover, rest_outline
from .edges import edge_distances, edge_levels
from .follow import follow_outline
from .reference import Calm, begins_in_motion, calm_part, middle
from .sway import Sway, sway_of
from .texture import has_texture, plain_at_first

__all__ = ["Calm", "Sway", "begins_in_motion", "calm_part", "covered", "edge_distances", "edge_levels", "end_of", "follow_outline", "has_texture", "middle", "plain_at_first", "rest_cover", "rest_outline", "sway_of"]
