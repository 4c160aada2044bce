"""Five nodes from a camera's topics, or from a recording that is played, to fields; in five processes, or with composed:=true in one.

ros2 launch diffphys_ros graph.launch.py image:=/camera/color/image_raw depth:=/camera/aligned_depth_to_color/image_raw clip_trigger:=manual
ros2 launch diffphys_ros graph.launch.py bag:=clip.mcap rate:=1.0
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import diffphys_launch as shared
from diffphys_arguments import GETS, renamed, said

from launch import LaunchDescription


def actions(given: dict[str, str]) -> Iterator[Any]:
    """The nodes, and what shows their results."""
    names = [name for name in GETS["graph"] if name != "inspect_node" or said(given, "inspect")]
    if said(given, "composed"):
        yield shared.one_process("graph", names, given, remappings=[(f"{name}:{old}", new) for name in names for old, new in renamed(name, given)])
    else:
        for name in names:
            yield shared.node("graph", name, given, remappings=renamed(name, given))
    yield from shared.viewers(given)


def generate_launch_description() -> LaunchDescription:
    """For `ros2 launch`."""
    return shared.description("graph", actions)
