"""Five nodes from a camera's topics, or from a recording that is played, to fields; in five processes, or with composed:=true in one.

ros2 launch diffphys_ros graph.launch.py image:=/camera/color/image_raw camera_info:=/camera/color/camera_info depth:=/camera/depth/image_raw
ros2 launch diffphys_ros graph.launch.py bag:=clip.mcap rate:=1.0
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import common

from launch import LaunchDescription

OWN = {
    "reliability": common.Argument("best_effort", "of the camera's topics: best_effort or reliable"),
    "inspect": common.Argument("true", "start inspect_node", bool),
    "composed": common.Argument("false", "all nodes in one process", bool),
}
ARGUMENTS = {**common.INPUTS, **OWN, **common.BAG, **common.PLAY, **common.FIT, **common.NODE, **common.VIEWERS, **common.INSPECT}


def actions(given: dict[str, str]) -> Iterator[Any]:
    """The nodes, and what shows their results."""
    own = {
        "ingest_node": common.parameters(given, ARGUMENTS, {name: name for name in ("reliability", "bag", *common.PLAY)}),
        "segment_node": {},
        "splat_node": {},
        "fit_node": common.parameters(given, ARGUMENTS, {"out": "out", "exit_when_done": "exit_when_done"}),
        "inspect_node": common.inspect_node(given),
    }
    if not common.said(given, "inspect"):
        del own["inspect_node"]
    if common.said(given, "composed"):
        yield common.one_process(given, own, remappings=[(f"ingest_node:{old}", new) for old, new in renamed(given)])
    else:
        for name, each in own.items():
            yield common.node(name, given, each, remappings=renamed(given) if name == "ingest_node" else [])
    yield from common.viewers(given)


def renamed(given: dict[str, str]) -> list[tuple[str, str]]:
    """The camera's topics as ingest_node hears them; image transports publish compressed images below the raw topic."""
    return [*((name, given[name]) for name in common.INPUTS), ("image/compressed", f"{given['image']}/compressed")]


def generate_launch_description() -> LaunchDescription:
    """For `ros2 launch`."""
    return common.description(ARGUMENTS, actions)
