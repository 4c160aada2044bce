"""Frame 0 -> what is believed of the material: a database, a person's file or a vision-language model (paper section 3.2)."""

from .database import Material, find, materials
from .source import SOURCES, believing, material_prior

__all__ = ["SOURCES", "Material", "believing", "find", "material_prior", "materials"]
