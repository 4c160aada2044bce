"""Looks at nodes that run elsewhere: ros2 launch diffphys_ros inspect.launch.py viewer:=web, or rviz:=true, or foxglove:=true."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import diffphys_launch as shared
from diffphys_arguments import said

from launch import LaunchDescription


def actions(given: dict[str, str]) -> Iterator[Any]:
    """The viewers that are wanted."""
    if said(given, "rerun"):
        yield shared.node("inspect", "inspect_node", given)
    yield from shared.viewers(given)


def generate_launch_description() -> LaunchDescription:
    """For `ros2 launch`."""
    return shared.description("inspect", actions)
