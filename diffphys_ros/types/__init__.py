"""The data that flows through the pipeline: frozen, shapes and units on every field.

Frames of reference: `world` is the root of the camera's transform tree (z up where gravity is known), `camera` the
optical frame (x right, y down, z forward; REP-103), `body` the object's own frame (see Body). `a_from_b` maps
coordinates of b to coordinates of a. Pixel centres lie at integer coordinates.

Reading order: poses, camera, labels, clip, tracks, outline, body, floor, particles, prior, splats, start, initial_value, scale, recovery.
"""

from .body import Body, Front
from .camera import Camera
from .clip import Clip, Doubt, Thickness
from .floor import Floor
from .initial_value import PROBLEMS, ModalProblem, MpmProblem
from .labels import IGNORE, object_mask
from .outline import Hanging, Swing
from .particles import Grid, Particles
from .poses import transformed
from .prior import MaterialPrior
from .recovery import Recovery
from .scale import TOLD, Quantity, Scale
from .splats import Splats
from .start import MaterialDoubt, StartValues
from .tracks import Tracks

__all__ = [
    "IGNORE",
    "PROBLEMS",
    "TOLD",
    "Body",
    "Camera",
    "Clip",
    "Doubt",
    "Floor",
    "Front",
    "Grid",
    "Hanging",
    "MaterialDoubt",
    "MaterialPrior",
    "ModalProblem",
    "MpmProblem",
    "Particles",
    "Quantity",
    "Recovery",
    "Scale",
    "Splats",
    "StartValues",
    "Swing",
    "Thickness",
    "Tracks",
    "object_mask",
    "transformed",
]
