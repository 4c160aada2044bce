"""Claims about numbers that decide something: beside each stands what it is and, in brackets, where it comes from."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

import diffphys_ros

PACKAGE = Path(diffphys_ros.__file__).resolve().parent
ROOT = PACKAGE.parent
ROOMS = ("vibration", "start", "elements", "modes", "outline", "plainness.py", "segment/even.py", "segment/plain.py", "inverse/outlined.py", "inverse/swing.py", "inverse/yielding.py")
KINDS = ("chosen", "derived", "numerical")  # else a paper with its year, or a file of this repository that measures it
TABLES = (ast.Tuple, ast.List, ast.Dict)


def files() -> list[Path]:
    return sorted(path for room in ROOMS for path in ([PACKAGE / room] if room.endswith(".py") else (PACKAGE / room).glob("*.py")))


def numbers(path: Path) -> Iterator[tuple[str, str]]:
    """Names of the numbers that a module sets, and the comments on the lines that set them; tables of numbers left out."""
    source = path.read_text(encoding="utf-8")
    comments = {t.start[0]: t.string.lstrip("# ") for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type == tokenize.COMMENT}
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.Assign) and is_number(statement.value):
            name = ast.unparse(statement.targets[0]).strip("()")
            if name.split(",")[0].isupper():
                yield name, comments.get(statement.end_lineno or 0, "")


def is_number(value: ast.expr) -> bool:
    """Whether an expression holds a number and is no table of several rows, array or text."""
    nodes = list(ast.walk(value))
    called = {node.func.attr for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)}
    rows = sum(isinstance(node, TABLES) for node in nodes)
    constants = [node.value for node in nodes if isinstance(node, ast.Constant)]
    return rows < 3 and not called & {"array", "full"} and not any(isinstance(c, str) for c in constants) and bool(constants)


@pytest.mark.parametrize("path", files(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_each_number_says_what_it_is_and_where_it_comes_from(path: Path) -> None:
    for name, comment in numbers(path):
        said = re.fullmatch(r"(.+) \[([^][]+)\]", comment)
        assert said, f"{path.name}: {name} needs a comment that says what it is, and ends with where it comes from in brackets"
        kind = said[2].partition(":")[0]
        named = [word for word in re.split(r"[ ,;]+", said[2]) if re.match(r"(tests|docs|benchmarks)/", word)]
        assert kind in KINDS or named or re.search(r"[A-Z].* \d{4}$", said[2]), f"{path.name}: {name} comes from {said[2]!r}; name a paper, a file, or one of {KINDS}"
        assert all((ROOT / word).exists() for word in named), f"{path.name}: {name} names {named}"


def test_numbers_are_seen_and_tables_are_not(tmp_path: Path) -> None:
    path = tmp_path / "made_up.py"
    path.write_text("A, B = 1.0, (2, 3)  # both [chosen]\nC = np.log(10.0)\nEDGES = ((0, 1), (1, 2))\nWORD = 'x1'\nD = np.array([1.0])\nlower = 3\nE = A\n")
    assert list(numbers(path)) == [("A, B", "both [chosen]"), ("C", "")]
