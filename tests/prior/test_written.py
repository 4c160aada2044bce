"""A person's file of materials."""

import re

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.prior.written import read_records


@pytest.fixture
def write(tmp_path):
    def to_file(text: str):
        path = tmp_path / "materials.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return to_file


def test_materials_parts_boxes_and_bare_numbers_are_read(write) -> None:
    path = write(
        "parts:\n- {part: 1, material: wood}\n- {name: leaf, box: [0.4, 0.1, 0.8, 0.5], E: 2e6, nu: 0.4, rho: 900, within: 3}\n- {part: 2, material: rubber, rho: 1234}\n"
    )
    wood, leaf, rubber = read_records(path, parts=2)
    assert (wood.part, wood.material, wood.young) == (1, "wood", 1e10)
    assert (leaf.box, leaf.young, leaf.poisson, leaf.density) == ((0.4, 0.1, 0.8, 0.5), 2e6, 0.4, 900.0)
    assert leaf.log10_young_sd == pytest.approx(np.log10(3))
    assert (rubber.density, rubber.young) == (1234.0, 2e6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("parts: []", "must hold 'parts:'"),
        ("- 1", "must hold 'parts:'"),
        ("parts: [{part: 1}]", "entry 1: E is None, must be a number in 100 .. 1e+12 Pa"),
        ("parts: [{part: 3, material: wood}]", "part is 3, must be a whole number in 1 .. 2"),
        ("parts: [{part: 1, material: wod}]", "'wod' is not in the database; choose one such as wood"),
        ("parts: [{part: 1, E: 5, nu: 0.3, rho: 900}]", "E is 5, must be a number in"),
        ("parts: [{part: 1, E: 5e6, nu: 0.5, rho: 900}]", "nu is 0.5, must be a number in 0 .. 0.49"),
        ("parts: [{part: 1, E: .nan, nu: 0.3, rho: 900}]", "E is nan"),
        ("parts: [{part: 1, material: wood, density: 900}]", "unknown key 'density'"),
        ("parts: [{box: [0.1, 0.1, 1.2, 0.5], material: wood}]", "must be [left, top, right, bottom] inside the image"),
        ("parts: [{box: [0.5, 0.1, 0.2, 0.5], material: wood}]", "with left < right"),
        ("parts: [{part: 1, box: [0, 0, 1, 1], material: wood}]", "has both part and box"),
        ("parts: [{part: 1, material: wood}, {part: 1, material: rubber}]", "2 entries are for part 1; keep one"),
        ("parts: [{material: wood}, {material: rubber}]", "2 entries are for the whole object"),
        ("parts: [3]", "must be an object"),
        ("parts: {", "not valid YAML"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence_that_names_the_file(write, text: str, says: str) -> None:
    path = write(text)
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        read_records(path, parts=2)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path) -> None:
    with pytest.raises(InputError, match=r"no_such\.yaml: No such file"):
        read_records(tmp_path / "no_such.yaml", parts=1)
