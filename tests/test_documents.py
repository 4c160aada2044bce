"""Claims about the pages of this repository: links lead somewhere, tables are those of the rows that a benchmark stored."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest

from tests.script import loaded

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
CODE = [path for folder in ("diffphys_ros", "nodes", "bags", "msg_schemas", "benchmarks", "examples", "scripts", "tests", "tools") for path in sorted((ROOT / folder).glob("**/*.py"))]


@pytest.fixture(scope="module")
def notes() -> ModuleType:
    return loaded(ROOT / "benchmarks" / "notes.py")


def anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub names them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_of_a_page_leads_to_a_file_and_a_heading_of_it(page: Path) -> None:
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", prose):
        if link.startswith(("http://", "https://")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{link} leads to no file"
        assert not anchor or anchor in anchors(target), f"{link} leads to no heading"


def test_every_page_that_code_or_a_page_names_exists() -> None:
    named = {(path, name) for path in (*CODE, *PAGES) for name in re.findall(r"\bdocs/[\w/]+\.md", path.read_text())}
    assert named
    assert [(str(path.relative_to(ROOT)), name) for path, name in named if not (ROOT / name).exists()] == []


def test_every_test_that_a_page_names_exists() -> None:
    named = {name for page in PAGES for name in re.findall(r"`(tests/[\w/]+\.py)`", page.read_text())}
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_the_tables_of_the_measurements_are_those_of_the_stored_rows(notes: ModuleType) -> None:
    for page in sorted(notes.NOTES.glob("*.md")):
        assert notes.filled(page.read_text()) == page.read_text(), "run: python benchmarks/notes.py"


def test_every_table_of_stored_rows_stands_in_one_page(notes: ModuleType) -> None:
    found = re.findall(r"<!-- rows (.+?) -->", "".join(page.read_text() for page in notes.NOTES.glob("*.md")))
    assert sorted(found) == sorted(notes.TABLES)


def test_a_table_changes_with_its_rows(notes: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for path in notes.RESULTS.glob("*.json"):
        (tmp_path / path.name).write_text(path.read_text().replace('"value": 0.', '"value": 7.'))
    before = notes.table("clamp")
    monkeypatch.setattr(notes, "RESULTS", tmp_path)
    assert notes.table("clamp") != before
