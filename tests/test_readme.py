"""Claims about README.md and the tables that a command writes."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS
from tests.script import loaded

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    return loaded(ROOT / "scripts" / "readme_tables.py")


@pytest.mark.parametrize("name", ["settings", "topics"])
def test_the_tables_are_those_of_the_code(tables: ModuleType, name: str) -> None:
    text = tables.page(name).read_text(encoding="utf-8")
    assert tables.filled(name, text) == text, f"docs/{name}.md is out of date; run: make tables"


def test_every_setting_stands_in_the_table_with_its_range(tables: ModuleType) -> None:
    rows = [line for line in tables.settings_table().splitlines() if line.startswith("| `")]
    assert len(rows) == len(config.leaves())
    assert any("`scene.mass_kg`" in row and "kg" in row and "1e-06 .. 100000" in row for row in rows)


def test_a_page_without_markers_is_refused(tables: ModuleType) -> None:
    with pytest.raises(ValueError, match="misses <!-- settings -->"):
        tables.filled("settings", "nothing here")


def test_the_readme_is_short_and_begins_with_a_moving_picture() -> None:
    lines = README.splitlines()
    assert len(lines) <= 120
    assert max(len(line) for line in lines) <= 160
    (picture,) = re.findall(r"!\[.+?\]\((.+?)\)", "\n".join(lines[:10]))
    with Image.open(ROOT / picture) as shown:
        assert shown.n_frames > 20


def test_every_setting_that_the_readme_names_exists() -> None:
    groups = {name.split(".")[0] for name in config.leaves()}
    named = {f"{group}.{key}" for group, key in re.findall(r"`([a-z]+)\.([a-z_0-9]+)\b", README) if group in groups and key != "json"}
    assert "scene.mass_kg" in named
    assert named <= set(config.leaves())


def test_the_drawing_names_every_node_and_topics_that_exist() -> None:
    drawing = re.search("```mermaid\n(.*?)```", README, re.S)
    assert drawing is not None
    assert set(re.findall(r"\b[a-z]+_node\b", drawing[1])) == {path.stem for path in (ROOT / "nodes").glob("*_node.py")}
    topics = set(re.findall(r"(?:~|\bclip)/[a-z_]+", drawing[1]))
    assert {"~/material_field", "clip/mask"} <= topics <= set(TOPICS)


def test_every_make_target_that_is_named_exists() -> None:
    named = set(re.findall(r"`?make ([a-z-]+)", "".join((ROOT / name).read_text() for name in ("README.md", "CONTRIBUTING.md"))))
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    assert named
    assert named <= targets


def test_continuous_integration_runs_the_test_command_of_the_readme() -> None:
    assert "make test" in README
    assert "make test" in (ROOT / ".ci" / "run").read_text()
