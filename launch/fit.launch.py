"""One process from a recording to fields: ros2 launch diffphys_ros fit.launch.py bag:=clip.mcap config:=given.yaml out:=results."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import diffphys_launch as shared
from diffphys_arguments import said
from launch.actions import LogInfo

from launch import LaunchDescription


def actions(given: dict[str, str]) -> Iterator[Any]:
    """fit_node, and what shows its results."""
    if not given["bag"]:
        yield LogInfo(msg="no bag:= was given: fit_node waits for a clip from ingest_node, segment_node and splat_node (graph.launch.py starts all)")
    yield shared.node("fit", "fit_node", given)
    if said(given, "inspect"):
        yield shared.node("fit", "inspect_node", given)
    yield from shared.viewers(given)


def generate_launch_description() -> LaunchDescription:
    """For `ros2 launch`."""
    return shared.description("fit", actions)
