"""Constitutive laws: one file each, one line here."""

from functools import cache

from . import (
    drucker_prager,
    fixed_corotated,
    linear_corotated,
    neo_hookean,
    st_venant_kirchhoff,
    von_mises,
    weakly_compressible,
)
from .law import VISCOSITY, Functions, Law, Parameter

__all__ = ["LAWS", "VISCOSITY", "Functions", "Law", "Parameter", "law_of"]

LAWS: dict[str, Law] = {
    "neo_hookean": neo_hookean.LAW,
    "fixed_corotated": fixed_corotated.LAW,
    "linear_corotated": linear_corotated.LAW,
    "st_venant_kirchhoff": st_venant_kirchhoff.LAW,
    "drucker_prager": drucker_prager.LAW,
    "von_mises": von_mises.LAW,
    "weakly_compressible": weakly_compressible.LAW,
}


@cache
def law_of(name: str, real: type) -> Functions:
    """The Warp functions of a law over wp.float32 or wp.float64, built once."""
    return LAWS[name].build(real)
