"""Bodies of other families than the generator's."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from tests.script import loaded

OTHER_SCENES = Path(__file__).resolve().parents[2] / "benchmarks" / "other_scenes.py"


@pytest.fixture
def other_scenes(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """With a generator's mesh that knows nothing but its parts."""
    families = ModuleType("softbody.families")
    families.refine_blocks = lambda blocks, size, part, refine: SimpleNamespace(blocks=blocks, part=part, vertices=np.zeros((1, 3)))  # type: ignore[attr-defined]
    families.mesh_shift = lambda mesh, shift: None  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "softbody", ModuleType("softbody"))
    monkeypatch.setitem(sys.modules, "softbody.families", families)
    return loaded(OTHER_SCENES)


@pytest.mark.parametrize("family", ["hook", "fork", "cord", "sheet"])
@pytest.mark.parametrize("parts", [1, 2, 3])
def test_a_body_of_so_many_materials_has_a_part_of_each(other_scenes: ModuleType, family: str, parts: int) -> None:
    mesh = other_scenes.FAMILIES[family].shape(np.random.default_rng(7), parts, True)
    assert set(mesh.part) == set(range(parts))
    assert len(mesh.part) == len(set(mesh.blocks))
    assert mesh.part[0] == 0
