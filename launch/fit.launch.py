"""One process from a recording to fields: ros2 launch diffphys_ros fit.launch.py bag:=clip.mcap config:=given.yaml out:=results."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import common

from launch import LaunchDescription

INSPECTED = {"inspect": common.Argument("false", "start inspect_node beside it", bool)}
ARGUMENTS = {**common.BAG, **common.FIT, **common.NODE, **common.VIEWERS, **INSPECTED, **common.INSPECT}


def actions(given: dict[str, str]) -> Iterator[Any]:
    """fit_node, and what shows its results."""
    if not given["bag"]:
        yield common.LogInfo(msg="no bag:= was given: fit_node waits for a clip from ingest_node, segment_node and splat_node (graph.launch.py starts all)")
    names = {"bag": "bag", "out": "out", "exit_when_done": "exit_when_done"}
    yield common.node("fit_node", given, common.parameters(given, ARGUMENTS, names))
    if common.said(given, "inspect"):
        yield common.node("inspect_node", given, common.inspect_node(given))
    yield from common.viewers(given)


def generate_launch_description() -> LaunchDescription:
    """For `ros2 launch`."""
    return common.description(ARGUMENTS, actions)
