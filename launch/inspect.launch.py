"""Looks at nodes that run elsewhere: ros2 launch diffphys_ros inspect.launch.py viewer:=web, or rviz:=true, or foxglove:=true."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import common

from launch import LaunchDescription

OWN = {
    "rerun": common.Argument("true", "start inspect_node, which writes a rerun recording or feeds a viewer", bool),
    "fit_node": common.Argument("fit_node", "name of the fit node to look at"),
}
ARGUMENTS = {**common.INSPECT, **OWN, **common.VIEWERS, **common.NODE}


def actions(given: dict[str, str]) -> Iterator[Any]:
    """The viewers that are wanted."""
    if common.said(given, "rerun"):
        yield common.node("inspect_node", given, common.inspect_node(given) | common.parameters(given, ARGUMENTS, {"fit_node": "fit_node"}))
    yield from common.viewers(given)


def generate_launch_description() -> LaunchDescription:
    """For `ros2 launch`."""
    return common.description(ARGUMENTS, actions)
