"""What a user or a file gave, in a sentence."""

from __future__ import annotations

from diffphys_ros.errors import listed, named


def test_a_value_is_shown_on_one_short_line_of_printable_characters() -> None:
    assert named("/camera/image é") == "/camera/image é"
    assert named("a\nb\0\ud800") == "a\\nb\\x00\\ud800"
    assert len(named("x" * 10**6)) <= 84
    assert named("a" + "x" * 500 + "z").startswith("ax")
    assert named("a" + "x" * 500 + "z").endswith("xz")


def test_a_long_list_is_shown_by_its_first() -> None:
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(k) for k in range(9)], 3) == "0, 1, 2 and 6 more"
    assert listed([]) == ""
