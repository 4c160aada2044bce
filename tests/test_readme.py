"""Claims about README.md."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from diffphys_ros import config

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    spec = importlib.util.spec_from_file_location("readme_tables", ROOT / "scripts" / "readme_tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_those_of_the_code(tables: ModuleType) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert tables.filled(text) == text, "README.md is out of date; run: make tables"


def test_every_setting_stands_in_the_table_with_its_range(tables: ModuleType) -> None:
    rows = tables.settings_table().splitlines()[2:]
    assert len(rows) == len(config.leaves())
    assert any("`scene.mass_kg`" in row and "kg" in row and "1e-06 .. 100000" in row for row in rows)


def test_a_readme_without_markers_is_refused(tables: ModuleType) -> None:
    with pytest.raises(ValueError, match="misses <!-- settings -->"):
        tables.filled("nothing here")


def test_every_make_target_that_is_named_exists() -> None:
    named = set(re.findall(r"`?make ([a-z-]+)", "".join((ROOT / name).read_text() for name in ("README.md", "CONTRIBUTING.md"))))
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    assert named
    assert named <= targets


def test_continuous_integration_runs_the_test_command_of_the_readme() -> None:
    assert "make test" in (ROOT / "README.md").read_text()
    assert "make test" in (ROOT / ".ci" / "run").read_text()
