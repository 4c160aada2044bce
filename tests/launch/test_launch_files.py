"""Claims about the launch files: their tables always, the files themselves where `launch` is installed (it is not on PyPI)."""

from __future__ import annotations

import ast
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from diffphys_ros import config
from tests.script import loaded

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "launch"
FILES = sorted(FOLDER.glob("*.launch.py"))
NAMES = [path.name.removesuffix(".launch.py") for path in FILES]
WITH_LAUNCH = find_spec("launch_ros") is not None
OF_ALL = ("config", "use_sim_time")


@pytest.fixture(scope="module")
def arguments() -> ModuleType:
    return loaded(FOLDER / "diffphys_arguments.py")


def given(arguments: ModuleType, name: str, **changes: str) -> dict[str, str]:
    return {argument: each.default for argument, each in arguments.ARGUMENTS[name].items()} | changes


def test_there_is_one_file_a_use_and_all_take_the_common_arguments(arguments) -> None:
    assert NAMES == sorted(arguments.ARGUMENTS) == sorted(arguments.GETS)
    for name in NAMES:
        assert arguments.ARGUMENTS[name].keys() >= {*arguments.NODE, *arguments.VIEWERS, *arguments.INSPECT}
        for each in arguments.ARGUMENTS[name].values():
            assert each.doc
            assert each.kind is not bool or each.default in ("true", "false")
            assert not each.default or each.kind(each.default) is not None


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_that_a_node_gets_is_one_of_its_own_with_the_same_default(arguments, name) -> None:
    pytest.importorskip("rclpy")
    for node, gets in arguments.GETS[name].items():
        module = importlib.import_module(f"diffphys_ros.nodes.{node}")
        own = {each.name: each.default for each in getattr(module, "OWN", ())}
        own |= {setting: config.leaves()[setting].default for setting in config.read_by(node)}
        for argument, parameter in gets.items():
            each = arguments.ARGUMENTS[name][argument]
            if parameter in OF_ALL or parameter not in own:
                assert parameter in OF_ALL, (node, parameter)
            elif each.default == "":  # left to the node, whatever its default is
                assert parameter == "bag" or parameter in config.leaves() or own[parameter] == "", (node, parameter)
            elif each.kind is bool:
                assert own[parameter] is (each.default == "true")
            else:
                assert own[parameter] == each.kind(each.default), (node, parameter)


def test_what_keeps_its_default_is_left_to_the_node_and_the_rest_has_its_kind(arguments) -> None:
    assert arguments.parameters("graph", "ingest_node", given(arguments, "graph")) == {}
    told = given(arguments, "graph", bag="/tmp/1.mcap", rate="2", loop="True", start="0.0")
    assert arguments.parameters("graph", "ingest_node", told) == {"bag": "/tmp/1.mcap", "rate": 2.0, "loop": True}
    assert arguments.parameters("fit", "fit_node", given(arguments, "fit", out="7", exit_when_done="yes")) == {"out": "7", "exit_when_done": True}
    assert arguments.parameters("graph", "splat_node", given(arguments, "graph", config="[a.yaml, b.yaml]")) == {"config": ["a.yaml", "b.yaml"]}


WRITES = """
import sys, yaml
sys.path.insert(0, sys.argv[1])
from diffphys_arguments import ARGUMENTS, file_of_all
given = {name: each.default for name, each in ARGUMENTS["graph"].items()} | {"rate": "2"}
print(file_of_all("graph", ["ingest_node", "fit_node"], given))
print(yaml.safe_load(open(file_of_all("graph", ["ingest_node", "fit_node"], given))))
"""


def test_the_parameters_of_nodes_in_one_process_are_a_file_that_is_gone_when_the_launch_has_ended(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", WRITES, str(FOLDER)], env=os.environ | {"TMPDIR": str(tmp_path)}, capture_output=True, text=True, check=True)
    name, content = done.stdout.splitlines()
    assert Path(name).parent == tmp_path
    assert ast.literal_eval(content) == {"/**/ingest_node": {"ros__parameters": {"rate": 2.0}}}
    assert not list(tmp_path.iterdir())


def test_a_camera_is_named_by_its_images_and_its_camera_info_is_looked_for_beside_them(arguments) -> None:
    renamed = dict(arguments.renamed("ingest_node", given(arguments, "graph", image="/cam/color/image_raw", depth="/cam/depth/image_rect_raw")))
    assert (renamed["image"], renamed["camera_info"]) == ("/cam/color/image_raw", "/cam/color/camera_info")
    assert (renamed["depth"], renamed["depth_camera_info"]) == ("/cam/depth/image_rect_raw", "/cam/depth/camera_info")
    told = dict(arguments.renamed("ingest_node", given(arguments, "graph", image="/image_raw", camera_info="/info", depth_camera_info="/deep", imu="/imu/data")))
    assert (told["camera_info"], told["depth_camera_info"], told["imu"]) == ("/info", "/deep", "/imu/data")
    assert dict(arguments.renamed("segment_node", given(arguments, "graph", click="/clicked_point")))["click"] == "/clicked_point"
    for node in ("segment_node", "splat_node", "fit_node"):
        assert dict(arguments.renamed(node, given(arguments, "graph", clamp_click="/drawn")))["clamp_click"] == "/drawn"
    assert arguments.renamed("inspect_node", given(arguments, "graph")) == []


def test_without_arguments_the_graph_listens_to_the_names_of_the_nodes(arguments) -> None:
    for node in arguments.GETS["graph"]:
        assert all(old == new for old, new in arguments.renamed(node, given(arguments, "graph")))


def test_every_topic_of_a_camera_has_an_argument(arguments) -> None:
    pytest.importorskip("rclpy")
    from diffphys_ros.nodes import camera_topics

    assert {*arguments.INPUTS, *camera_topics.RAW} == {*camera_topics.NAMES}


def test_a_namespace_goes_before_every_topic_that_rviz_shows(arguments) -> None:
    rviz = yaml.safe_load((ROOT / "config" / "diffphys.rviz").read_text())["Visualization Manager"]
    named = {each["Topic"]["Value"] for each in (*rviz["Displays"], *rviz["Tools"]) if "Topic" in each}
    assert named | {"/fit_node/camera_info"} == set(arguments.SHOWN)


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_launch_files_name_executables_and_arguments_that_exist(arguments, path: Path) -> None:
    tree, name = ast.parse(path.read_text()), path.name.removesuffix(".launch.py")
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    asked = {node.slice.value for node in ast.walk(tree) if isinstance(node, ast.Subscript) and getattr(node.value, "id", "") == "given"}
    asked |= {node.args[1].value for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "said"}
    assert asked <= arguments.ARGUMENTS[name].keys()
    executables = {word for word in words if word.endswith("_node")} | set(arguments.GETS[name]) | {"graph"}
    assert executables <= {p.name for p in (ROOT / "resource" / "bin").iterdir()}
    assert any(isinstance(node, ast.FunctionDef) and node.name == "generate_launch_description" for node in tree.body)


@pytest.fixture
def real(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Actions of a launch file with some arguments, as `launch` makes them."""
    if not WITH_LAUNCH:
        pytest.skip("launch and launch_ros are not on PyPI; source a ROS 2 Jazzy")
    from launch import LaunchContext

    monkeypatch.setattr(sys, "path", list(sys.path))

    def actions(name: str, **changes: str) -> tuple[list[Any], list[Any]]:
        described = loaded(FOLDER / f"{name}.launch.py").generate_launch_description()
        context = LaunchContext()
        context.launch_configurations.update(changes)
        return described.entities, [made for entity in described.entities for made in entity.execute(context) or []]

    yield actions
    for module in ("diffphys_launch", "diffphys_arguments"):
        sys.modules.pop(module, None)


@pytest.mark.parametrize(("composed", "nodes"), [("false", 5), ("true", 1)])
def test_the_graph_is_five_processes_or_one(real, composed: str, nodes: int) -> None:
    _, made = real("graph", composed=composed)
    assert len([each for each in made if type(each).__name__ == "Node"]) == nodes


@pytest.mark.parametrize(("changes", "again"), [({}, 0), ({"respawn": "true"}, 5), ({"respawn": "true", "exit_when_done": "true"}, 4), ({"respawn": "true", "composed": "true"}, 1)])
def test_nodes_are_started_again_where_that_is_wanted_and_not_a_fit_that_is_done(real, changes: dict[str, str], again: int) -> None:
    _, made = real("graph", **changes)
    respawned = [each for each in made if type(each).__name__ == "Node" and each._ExecuteLocal__respawn]
    assert len(respawned) == again


@pytest.mark.parametrize("name", NAMES)
def test_every_argument_is_declared_with_a_description_and_viewers_open_on_demand(real, name: str) -> None:
    declared, made = real(name, rviz="true", foxglove="true", namespace="robot1")
    assert all(each.description for each in declared if type(each).__name__ == "DeclareLaunchArgument")
    assert {"rviz2", "foxglove_bridge"} <= {each.node_package for each in made if type(each).__name__ == "Node"}
