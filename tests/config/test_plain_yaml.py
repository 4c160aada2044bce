"""Claims about the YAML of settings: numbers are those of YAML 1.2, nothing stands twice, nothing small becomes large."""

from __future__ import annotations

import math
import time

import pytest

from diffphys_ros.config import loaded
from diffphys_ros.errors import InputError


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1e-06", 1e-6),
        ("2e6", 2e6),
        ("1e+07", 1e7),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("0", 0),
        ("-12", -12),
        ("+3", 3),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("1" * 5000, math.inf),
        ("~", None),
        ("null", None),
        ("", None),
        ("true", True),
        ("no", False),
        ("'1e-3'", "1e-3"),
        ("[1, [2e0, a]]", [1, [2.0, "a"]]),
        ("a: {b: c}", {"a": {"b": "c"}}),
    ],
)
def test_words_stand_for_what_a_person_means(text, value):
    found = loaded(text, "here")
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", ["1:30", "2020-01-02", "010", "0x10", "0o10", "1_000", "1e", "e5", "١٢", "1 2", "inf", "nan", "+-1"])
def test_what_only_looks_like_a_number_is_text(text):
    assert loaded(text, "here") == text


BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("scene: {mass_kg: 2.5}\nscene: {thickness_m: 0.1}", "'scene' stands twice, in lines 1 and 2; keep one"),
        ("scene:\n  mass_kg: 1\n  mass_kg: 2", "'mass_kg' stands twice, in lines 2 and 3"),
        ('{"a": 1, a: 2}', "'a' stands twice"),
        (BOMB, "line 1: anchors and aliases such as &a are not read"),
        ("*nobody", "anchors and aliases"),
        ("a: &b 1", "anchors and aliases"),
        ("a: {<<: {b: 1}}", "merges (<<) are not read"),
        ("!!int foo", "tags such as"),
        ("!!timestamp x", "tags such as"),
        ("!!python/object/apply:os.system [ls]", "tags such as"),
        ("[" * 3000, "nested deeper than 20 levels"),
        ("- " * 3000, "nested deeper than 20 levels"),
        ("{" * 100_000, "nested deeper than 20 levels"),
        ("? [a]\n: 1", "a name must be a word"),
        ("scene: [", "not valid YAML (line 1: "),
        ("a: 1\n\tb: 2", "not valid YAML (line 2: "),
        ("a\0b", "not valid YAML"),
        ("\ud800", "not valid YAML"),
        ('"\\U00ffffff"', "not valid YAML (ValueError in the parser)"),
        ("%YAML " + "1" * 5000 + ".1\n--- a", "not valid YAML"),
        ("--- a\n--- b", "not valid YAML"),
    ],
)
def test_what_files_of_settings_never_need_is_refused_at_once_in_one_sentence(text, told):
    began = time.process_time()
    with pytest.raises(InputError) as caught:
        loaded(text, "config made.yaml")
    assert time.process_time() - began < 1.0
    assert told in str(caught.value)
    assert str(caught.value).startswith("config made.yaml")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300
