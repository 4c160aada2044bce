"""The import rule of docs/architecture.md: who may import whom, and one door per third party."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import diffphys_ros

PACKAGE = Path(diffphys_ros.__file__).parent

GROUND = {"errors", "damping", "footprints", "types", "config", "devices", "progress", "linear_systems", "nuisance", "differences", "rotations", "similarity", "inpaint", "ways", "colours", "hooke"}
SHARED = {"matching", "measured", "picture", "steady", "surface_plane", "pretrained", "shapes", "plainness", "mask_border", "columns"}  # what several stages need alike; imports the ground alone, but for plainness and columns
STAGES = {"segment", "depth", "tracks", "outline", "body", "elements", "modes", "vibration", "start", "particles", "prior", "splats", "fields", "simulate", "render", "metrics"}
LEAVES = {"bags", "msg_schemas"}
FILES = {"npz", "store"}
OUTPUT = FILES | {"folder", "result", "report", "score"}

# room -> rooms that it may import beside itself
MAY_IMPORT: dict[str, set[str]] = {
    "errors": set(),
    "damping": set(),
    "footprints": {"errors"},
    "inpaint": set(),
    "ways": set(),
    "types": {"errors", "damping", "footprints", "inpaint"},
    "config": {"errors"},
    "devices": {"errors"},
    "progress": set(),
    "linear_systems": set(),
    "nuisance": set(),
    "differences": set(),
    "rotations": set(),
    "similarity": set(),
    "colours": set(),
    "hooke": set(),
    "npz": set(),
    "typed": set(),
    "store": {"errors", "npz", "typed"},
    "folder": {"errors", "npz", "store"},
    **dict.fromkeys(SHARED, GROUND),
    "plainness": GROUND | {"matching"},
    "columns": GROUND | {"mask_border"},
    **dict.fromkeys(STAGES, GROUND | SHARED),
    "pretrained": GROUND | {"npz"},
    "metrics": GROUND | SHARED | {"npz"},
    **dict.fromkeys(("prior", "depth"), GROUND | SHARED | {"store"}),
    "splats": GROUND | SHARED | {"render", "metrics"},
    "elements": GROUND | SHARED | {"modes"},
    "vibration": GROUND | SHARED | {"modes"},
    "start": GROUND | SHARED | {"elements", "modes", "vibration"},
    **dict.fromkeys(LEAVES, GROUND),
    "capture": GROUND | SHARED | STAGES | LEAVES | {"store"},
    "plain_swing": GROUND | {"segment", "outline"},
    "inverse": GROUND | SHARED | STAGES | LEAVES | {"store", "plain_swing"},
    "result": GROUND | SHARED | STAGES | LEAVES | FILES | {"folder", "inverse", "report"},
    "report": GROUND,
    "batch": GROUND | {"store", "result", "score"},
    "score": GROUND | SHARED | {"store", "folder", "result"},
    "resimulate": GROUND | {"simulate", "modes", "result"},
    "predict": GROUND | SHARED | STAGES | LEAVES | {"inverse", "resimulate"},
    "nodes": GROUND | SHARED | STAGES | LEAVES | OUTPUT | {"inverse", "plain_swing"},
    "__main__": GROUND | SHARED | STAGES | LEAVES | OUTPUT | {"inverse", "capture", "resimulate", "predict", "batch"},
    "__init__": GROUND,
}

# third party -> places that may import it: a room, or one file of it
DOORS: dict[str, set[str]] = {
    "warp": {"simulate", "render"},
    "skfem": {"elements"},
    "cv2": {"matching.py", "mask_border.py", "columns.py", "plainness.py", "steady.py", "segment", "tracks", "outline", "body", "depth", "bags", "capture"},
    "rclpy": {"nodes"},
    "mcap": {"bags"},
    "mcap_ros2": {"bags"},
    "rosbags": {"bags"},
    "rerun": {"report/rerun_log.py"},
    "matplotlib": {"report/figure.py"},
    "transformers": {"pretrained.py"},
    "pycolmap": {"capture/structure.py"},
    "ray": {"batch/cluster.py"},
    "mujoco": set(),  # tools/sample_maker, outside the package
}

SOLVER = ("fields", "simulate", "render", "metrics", "inverse", "result", "modes", "vibration", "start", "resimulate")
FRONT_END_ONLY = ("rclpy", "mcap", "mcap_ros2", "rosbags", "rerun", "cv2", "skfem", "matplotlib")



@cache
def sources() -> list[Path]:
    """Every source file of the library, with nodes, bags and msg_schemas reached through their links."""
    return sorted(path for room in (PACKAGE, *(p for p in PACKAGE.iterdir() if p.is_dir())) for path in _python_files(room))


def _python_files(folder: Path) -> Iterator[Path]:
    return (p for p in (folder.glob("*.py") if folder == PACKAGE else folder.rglob("*.py")) if "__pycache__" not in p.parts)


def room_of(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


@cache
def imported(path: Path, package: Path = PACKAGE) -> frozenset[str]:
    """Absolute dotted names that a file imports; leaves out what only type checkers read."""
    return frozenset(_imported(path, package))


def _imported(path: Path, package: Path) -> Iterator[str]:
    here = ["diffphys_ros", *path.relative_to(package).with_suffix("").parts]
    for node in _nodes(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*here[: len(here) - node.level], *([node.module] if node.module else [])]) if node.level else str(node.module)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        yield child
        yield from _nodes(child)


def rooms_imported(path: Path) -> set[str]:
    known = {room_of(source) for source in sources()}
    names = [name.split(".") for name in imported(path)]
    return {parts[1] for parts in names if parts[0] == "diffphys_ros" and len(parts) > 1 and parts[1] in known}


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down_only(path: Path) -> None:
    room = room_of(path)
    assert room in MAY_IMPORT, f"{room} is not in the table of rooms; add it to docs/architecture.md and here"
    wrong = rooms_imported(path) - MAY_IMPORT[room] - {room}
    assert not wrong, f"{path.relative_to(PACKAGE)} must not import {', '.join(sorted(wrong))}"


@pytest.mark.parametrize("party", DOORS)
def test_each_third_party_has_one_door(party: str) -> None:
    wrong = [
        str(path.relative_to(PACKAGE))
        for path in sources()
        if party in {name.split(".")[0] for name in imported(path)}
        and not any(path.relative_to(PACKAGE).is_relative_to(door) for door in DOORS[party])
    ]
    assert not wrong, f"{party} is imported outside {', '.join(sorted(DOORS[party]))}"


def test_the_reader_of_imports_sees_relative_late_and_aliased_ones(tmp_path: Path) -> None:
    path = tmp_path / "report" / "made_up.py"
    path.parent.mkdir()
    path.write_text("import cv2 as c\nfrom .. import config\nfrom ..modes.model import M\ndef f():\n    from rclpy.node import Node\n")
    assert {"cv2", "diffphys_ros.config", "diffphys_ros.modes.model", "rclpy.node"} <= imported(path, tmp_path)


def test_the_type_checker_leaves_no_file_out() -> None:
    """Files of Warp kernels name the few errors that Warp's annotations bring; everything else in them is checked."""
    assert not [str(path.relative_to(PACKAGE)) for path in sources() if "mypy: ignore-errors" in path.read_text(encoding="utf-8")]


def solver_modules() -> list[str]:
    names = (path.relative_to(PACKAGE).with_suffix("") for path in sources() if room_of(path) in SOLVER)
    dotted = (".".join(part for part in name.parts if part != "__init__") for name in names)
    return sorted(f"diffphys_ros.{name}" for name in dotted)


@pytest.fixture(scope="module")
def solver() -> subprocess.CompletedProcess[str]:
    """A process that has imported every module of the solver, taken two steps of a fit of Gaussians, a gradient by pictures, and begun a solve; it says what else it has imported."""
    program = f"""
import importlib, sys
for name in {FRONT_END_ONLY!r}:
    sys.modules[name] = None
for name in {solver_modules()!r}:
    importlib.import_module(name)
import torch
from diffphys_ros.splats.descent import DescentPlan, ShrinkingAdam
class One:
    unknowns = {{"color": torch.ones(3, requires_grad=True)}}
descent = ShrinkingAdam(DescentPlan(2, {{"color": 0.1}}, 0.1, 0.0, 0))
descent.begin(One)
descent.step(One.unknowns["color"].sum())
sys.modules["diffphys_ros.inverse.evidence.recomputed"].recomputed(lambda color: (color.sum(), color.prod()), One.unknowns["color"])[0].backward()
sys.modules["diffphys_ros.inverse.solve"]._repeatable("cpu")
print(torch.are_deterministic_algorithms_enabled(), *sys.modules)
"""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, cwd=PACKAGE.parent)


@pytest.mark.slow
def test_the_solver_imports_on_a_machine_without_ros_images_and_plots(solver: subprocess.CompletedProcess[str]) -> None:
    assert solver.returncode == 0, solver.stderr


@pytest.mark.slow
def test_neither_gaussians_nor_gradients_by_pictures_nor_a_solve_that_is_repeatable_wait_for_torchs_compiler(solver: subprocess.CompletedProcess[str]) -> None:
    """Which takes seconds to import, as sympy does beside it."""
    repeatable, *imported = solver.stdout.split()
    assert repeatable == "True"
    assert "diffphys_ros.inverse.solve" in imported
    assert not {"torch._dynamo", "sympy"} & set(imported)


def module_of(path: Path, package: Path = PACKAGE) -> str:
    parts = path.relative_to(package).with_suffix("").parts
    return ".".join(["diffphys_ros", *(parts[:-1] if parts[-1] == "__init__" else parts)])


def imported_files(path: Path, known: set[str], package: Path = PACKAGE) -> set[str]:
    """Modules of the library that a file imports, late ones and those for type checkers too."""
    here = ["diffphys_ros", *path.relative_to(package).with_suffix("").parts]
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*here[: len(here) - node.level], *([node.module] if node.module else [])]) if node.level else str(node.module)
            found |= {f"{base}.{alias.name}" if f"{base}.{alias.name}" in known else base for alias in node.names}
    return (found & known) - {module_of(path, package)}


def circle(imports: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a ring; empty where there is none."""
    left = {name: set(others) for name, others in imports.items()}
    while ends := {name for name, others in left.items() if not others}:
        left = {name: others - ends for name, others in left.items() if name not in ends}
    return sorted(name for name in left if any(name in others for others in left.values()))


def test_no_file_imports_itself_through_others() -> None:
    known = {module_of(path) for path in sources()}
    assert not circle({module_of(path): imported_files(path, known) for path in sources()})


def test_a_circle_of_late_imports_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .b import B\n")
    (tmp_path / "b.py").write_text("def f():\n    from . import a\n")
    known = {"diffphys_ros.a", "diffphys_ros.b"}
    assert circle({f"diffphys_ros.{name}": imported_files(tmp_path / f"{name}.py", known, tmp_path) for name in "ab"}) == ["diffphys_ros.a", "diffphys_ros.b"]
