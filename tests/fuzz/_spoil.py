"""What several doors' cases share: bytes and values spoiled by a generator, and the check of a sentence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from diffphys_ros.errors import InputError

LONGEST_SENTENCE = 600  # characters
VALUES = (None, True, False, 0, 1, -1, 3, 2**31, 2**63, 10**400, -(10**5000), 0.0, -0.0, 0.3, 1e-320, 1e308, math.inf, -math.inf, math.nan, "", "a", "1", "\0", "\ud800", "x" * 10**5, [], {}, (), b"", b"\0\xff", {1: 2, "a": 3}, [[]], [None], [1, 2, 3], [0.1] * 6, ["a", 1], [math.nan] * 3, [1e308] * 3, set(), object, 1j, np.float32(0.5), np.int64(3), np.zeros(3), range(3))  # fmt: skip


def checked_sentence(error: InputError) -> str:
    """ "refused", where the message is one line of bounded length that can be printed."""
    text = str(error)
    assert "\n" not in text, f"more than a line: {text[:200]!r}"
    assert 0 < len(text) < LONGEST_SENTENCE, f"{len(text)} characters: {text[:200]!r}"
    assert text.isprintable(), f"not printable: {text[:200]!a}"
    return "refused"


def words_of(rng: np.random.Generator, depth: int = 0) -> Any:
    """A Python value of any kind, nested now and then."""
    pick = rng.random()
    if pick < 0.8 or depth > 3:
        return VALUES[rng.integers(len(VALUES))]
    if pick < 0.98:
        items = [words_of(rng, depth + 1) for _ in range(rng.integers(0, 7))]
        return items if rng.random() < 0.7 else {str(k): item for k, item in enumerate(items)}
    return itself() if rng.random() < 0.5 else deep(int(rng.integers(10, 3000)))


def itself() -> list[Any]:
    """A list that holds itself."""
    found: list[Any] = []
    found.append(found)
    return found


def deep(levels: int) -> list[Any]:
    found: list[Any] = []
    for _ in range(levels):
        found = [found]
    return found


def spoiled_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    """The bytes as they are, or cut, flipped, repeated, swapped, or with others put in."""
    if not data or rng.random() < 0.4:
        return data
    at, to = sorted(int(k) for k in rng.integers(0, len(data) + 1, 2))
    kind = rng.integers(7)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + data[to:]
    if kind == 2:
        return data[:to] + data[at:]
    if kind == 3:
        return data[:at] + data[at:to][:200] * int(rng.integers(1, 50)) + data[to:]
    if kind == 4:
        return data[:at] + rng.bytes(int(rng.integers(1, 20))) + data[at:]
    spoiled = bytearray(data)
    for k in rng.integers(0, len(data), int(rng.integers(1, 9))):
        spoiled[k] = spoiled[k] ^ (1 << int(rng.integers(8))) if kind == 5 else int(rng.integers(256))
    return bytes(spoiled)
