"""The fixed material database."""

import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.prior import find, materials
from diffphys_ros.prior.database import UNKNOWN, Material
from diffphys_ros.prior.records import DENSITY_RANGE, POISSON_RANGE, YOUNG_RANGE, of_material


@pytest.mark.parametrize("entry", materials().values(), ids=lambda entry: entry.name)
def test_every_entry_is_ordered_and_lies_in_the_range_of_solids(entry: Material) -> None:
    for span, (low, high) in ((entry.young, YOUNG_RANGE), (entry.poisson, POISSON_RANGE), (entry.density, DENSITY_RANGE)):
        assert low <= span.low <= span.typical <= span.high <= high
    assert 0.0 < entry.log10_young_sd < 1.0


def test_no_two_entries_go_by_one_name() -> None:
    names = [name for entry in materials().values() for name in (entry.name, *entry.aliases)]
    assert len(names) == len(set(names))


@pytest.mark.parametrize(
    ("said", "meant"), [("Rubber", "rubber"), ("STYROFOAM", "polystyrene foam"), ("petals", "petal"), ("soft-tissue", "soft tissue"), ("cloth", "woven fabric"), ("glass", "glass")]
)
def test_names_are_found_by_alias_case_plural_and_hyphen(said: str, meant: str) -> None:
    assert find(said, "here").name == meant


def test_a_misspelt_name_is_answered_with_the_nearest_ones() -> None:
    with pytest.raises(InputError, match=r"prior.materials: material 'rubbr' .* rubber"):
        find("rubbr", "prior.materials")


def test_stiffness_orders_common_materials_as_everyone_knows_them() -> None:
    order = ["gelatin", "polyurethane foam", "rubber", "hard plastic", "wood", "aluminium", "steel"]
    values = [find(name, "test").young.typical for name in order]
    assert values == sorted(values)


def test_the_entry_for_the_unknown_spans_most_soft_things() -> None:
    record = of_material(materials()[UNKNOWN])
    assert record.log10_young_sd > 0.7


def test_a_name_like_no_other_is_answered_with_a_few_in_a_sentence() -> None:
    with pytest.raises(InputError, match="choose one such as soft solid") as caught:
        find("x" * 80, "prior.file " + "y" * 200)
    assert len(str(caught.value)) < 600
