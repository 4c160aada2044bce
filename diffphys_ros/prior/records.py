"""What is said of one part of the object, by a person, the database or a model: one record, checked in one place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import InputError, short
from .database import Material, find, known

YOUNG_RANGE, POISSON_RANGE, DENSITY_RANGE = (1e2, 1e12), (0.0, 0.49), (1.0, 3e4)  # Pa, 1, kg/m^3: what a solid can have
LONGEST_NAME = 80
WITHIN = 2.0  # factor on E that is one standard deviation, where a value is given without one
KEYS = ("name", "part", "box", "material", "E", "nu", "rho", "within")  # of a person's entry
QUANTITIES = (("E", "Pa", YOUNG_RANGE), ("nu", "", POISSON_RANGE), ("rho", "kg/m^3", DENSITY_RANGE))


@dataclass(frozen=True)
class Record:
    """Material constants of one region of frame 0."""

    name: str
    material: str
    young: float  # [Pa]
    log10_young_sd: float
    poisson: float
    density: float  # [kg/m^3]
    box: tuple[float, float, float, float] | None = None  # left, top, right, bottom as shares of the image's width and height
    part: int | None = None  # part number of the label image; neither box nor part: the whole object


def of_material(material: Material, *, part: int | None = None) -> Record:
    """A record with the database's typical values."""
    values = material.young.typical, material.log10_young_sd, material.poisson.typical, material.density.typical
    return Record(material.name, material.name, *values, part=part)


def of_model(entry: Any, origin: str, *, parts: int) -> Record:
    """One element of a model's JSON array (paper appendix C): name, box, material, E, nu, rho, and perhaps part.

    Raises InputError that says what is wrong in words that the model can act on: also where a material of the database is
    given constants that nothing of its name has.
    """
    words = _mapping(entry, origin)
    name, material = (_text(words, key, origin) for key in ("name", "material"))
    young, poisson, density = (_quantity(words, *quantity, origin) for quantity in QUANTITIES)
    entry_known = known(material)
    if entry_known is not None:
        _plausible(entry_known, young, density, origin)
    sd = entry_known.log10_young_sd if entry_known else math.log10(WITHIN) * 2
    part = None if words.get("part") is None else _part(words["part"], origin, parts)
    return Record(name, material, young, sd, poisson, density, _box(words, origin), part)


def of_person(entry: Any, origin: str, *, parts: int) -> Record:
    """One element of `parts` in a person's file: `part` or `box` or neither, `material` or E, nu and rho; values given
    beside a material replace the database's; `within` is the factor on E that is one standard deviation. Raises InputError."""
    words = _mapping(entry, origin)
    unknown = next((key for key in words if key not in KEYS), None)
    if unknown is not None:
        raise InputError(f"{origin}: unknown key {short(unknown)}; the known ones are {', '.join(KEYS)}")
    if "part" in words and "box" in words:
        raise InputError(f"{origin}: has both part and box; give one of the two")
    material = find(_text(words, "material", origin), origin) if "material" in words else None
    values = [_given_or_typical(words, quantity, material, origin) for quantity in QUANTITIES]
    part = _part(words["part"], origin, parts) if "part" in words else None
    box = _box(words, origin) if "box" in words else None
    name = _text(words, "name", origin) if "name" in words else (material.name if material else f"part {part}" if part else "object")
    return Record(name, material.name if material else name, values[0], _spread(words, material, origin), values[1], values[2], box, part)


def _given_or_typical(words: Mapping[str, Any], quantity: tuple[str, str, tuple[float, float]], material: Material | None, origin: str) -> float:
    key = quantity[0]
    if key in words or material is None:
        return _quantity(words, *quantity, origin)
    return {"E": material.young, "nu": material.poisson, "rho": material.density}[key].typical


def _spread(words: Mapping[str, Any], material: Material | None, origin: str) -> float:
    """Standard deviation of log10 E."""
    if "within" in words:
        return math.log10(_quantity(words, "within", "", (1.01, 1e3), origin))
    return material.log10_young_sd if material and "E" not in words else math.log10(WITHIN)


def _plausible(material: Material, young: float, density: float, origin: str) -> None:
    """Refuses constants that nothing of the material's name has: mostly a slip of units."""
    for key, unit, value, span in (("E", "Pa", young, material.young), ("rho", "kg/m^3", density, material.density)):
        if not span.low / 1.001 <= value <= span.high * 1.001:
            raise InputError(
                f"{origin}: {key} is {value:g} {unit}, but {material.name} has {span.low:g} .. {span.high:g} {unit}; correct {key}, its unit or the material"
            )


def _mapping(entry: Any, origin: str) -> Mapping[str, Any]:
    if not isinstance(entry, Mapping):
        raise InputError(f"{origin}: is {short(entry)}, must be an object with name, box, material, E, nu, rho")
    return entry


def _text(words: Mapping[str, Any], key: str, origin: str) -> str:
    value = words.get(key)
    if not isinstance(value, str) or not value.strip() or len(value) > LONGEST_NAME or not value.strip().isprintable():
        raise InputError(f"{origin}: {key} is {short(value)}, must be text of 1 to {LONGEST_NAME} printable characters")
    return value.strip()


def _quantity(words: Mapping[str, Any], key: str, unit: str, bounds: tuple[float, float], origin: str) -> float:
    value = number(words.get(key))
    of_unit = f" {unit}" if unit else ""
    if value is None or not bounds[0] <= value <= bounds[1]:
        raise InputError(f"{origin}: {key} is {short(words.get(key))}, must be a number in {bounds[0]:g} .. {bounds[1]:g}{of_unit}")
    return value


def number(value: Any) -> float | None:
    """A finite number. None for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) else None


def _part(value: Any, origin: str, parts: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= parts:
        raise InputError(f"{origin}: part is {short(value)}, must be a whole number in 1 .. {parts}, the parts that the masks show")
    return value


def _box(words: Mapping[str, Any], origin: str) -> tuple[float, float, float, float]:
    value = words.get("box")
    corners = [number(v) for v in value] if isinstance(value, (list, tuple)) and len(value) == 4 else [None]
    if any(c is None or not 0.0 <= c <= 1.0 for c in corners) or not (corners[0] < corners[2] and corners[1] < corners[3]):  # type: ignore[operator]
        raise InputError(
            f"{origin}: box is {short(value)}, must be [left, top, right, bottom] inside the image as shares of its width and height in 0 .. 1, with left < right and top < bottom"
        )
    return tuple(corners)  # type: ignore[return-value]
