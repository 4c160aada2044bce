"""The two unknown fields and their parameters (paper Eq. 1-2): material per part or point, force per frame, mode or voxel."""

from .box import Box
from .decoder import Bounds
from .force import FORCE_FIELDS, ForceField, ForceSizes, NodeForce
from .material import MATERIAL_FIELDS, Believed, Material, MaterialField, MaterialSizes
from .pretrain import pretrain
from .smoothness import Smoothness

__all__ = [
    "FORCE_FIELDS",
    "MATERIAL_FIELDS",
    "Believed",
    "Bounds",
    "Box",
    "ForceField",
    "ForceSizes",
    "Material",
    "MaterialField",
    "MaterialSizes",
    "NodeForce",
    "Smoothness",
    "pretrain",
]
