"""How a message shows what was given."""

from __future__ import annotations

import sys

import pytest

from diffphys_ros.errors import LONGEST_PATH, SHORT, short, shown

DEEP: list = []
for _ in range(5000):
    DEEP = [DEEP]


@pytest.mark.parametrize("value", ["a" * 10**6, "line\nline", 10**5000, -(10**5000), [1] * 10**6, DEEP, {"a": ["b" * 999] * 99} | {str(k): k for k in range(99)}, b"\0" * 999, "\ud800" * 99, object], ids=lambda value: type(value).__name__)
def test_a_value_is_shown_in_one_short_line_that_can_be_printed(value):
    text = short(value)
    assert len(text) <= SHORT
    assert text.isprintable()


def test_small_values_are_shown_as_they_are():
    assert [short(v) for v in (0.5, "stem", [1, 2], None, 10**12, {"a": 1})] == ["0.5", "'stem'", "[1, 2]", "None", "1000000000000", "{'a': 1}"]


def test_a_value_that_holds_itself_is_shown():
    value: list = []
    value.append(value)
    assert "..." in short(value)


def test_a_path_is_shown_on_one_line_with_its_ends():
    text = shown("/far/" + "x" * 5000 + "\ud800\n/clip.mcap")
    assert text.startswith("/far/")
    assert text.endswith("\\ud800\\n/clip.mcap")
    assert len(text) < LONGEST_PATH + 20
    assert text.encode(sys.getdefaultencoding())
    assert shown("/tmp/Grünes Blatt.mcap") == "/tmp/Grünes Blatt.mcap"
