"""What the launch files share. It stands beside them, because `ros2 launch` may run under a Python that does not see the package.

Arguments become a table of plain values; a node is given what the table says about it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

CONFIG = Path(__file__).resolve().parent.parent / "config"
YES = ("true", "1", "yes", "on")


class Argument(NamedTuple):
    """Of a launch file. One that is empty, or false, is not handed on, so that the node's own default holds."""

    default: str
    doc: str
    kind: type = str  # as a parameter of a node


NODE = {
    "config": Argument("", "YAML file of settings, as for the command line"),
    "params_file": Argument("", "ROS file of parameters, as for --params-file"),
    "namespace": Argument("", "namespace of the nodes"),
    "use_sim_time": Argument("false", "take the time from /clock", bool),
    "log_level": Argument("info", "debug, info, warn, error or fatal"),
}
FIT = {
    "out": Argument("", "folder for the results; empty: none are written"),
    "exit_when_done": Argument("false", "end the process, and with it the launch, when the result is there", bool),
}
BAG = {"bag": Argument("", "recording: MCAP file, .db3 file, rosbag2 folder, video or folder of images")}
PLAY = {
    "rate": Argument("0.0", "speed at which the recording is played, with /clock; 0: its clip is read at once", float),
    "loop": Argument("false", "play the recording again and again", bool),
    "start": Argument("0.0", "of the recording, left out at the beginning [s]", float),
    "duration": Argument("0.0", "of the recording, taken at most [s]; 0: to its end", float),
}
INPUTS = {name: Argument(name, f"topic that ingest_node takes as {name}") for name in ("image", "camera_info", "depth", "mask", "camera_pose")}
INSPECT = {
    "rrd": Argument("diffphys.rrd", "rerun recording that inspect_node writes; earlier ones are kept"),
    "viewer": Argument("", "rerun viewer instead: a grpc URL, spawn, or web for a page at web_port"),
    "web_port": Argument("9090", "of the page; its data come from the next port", int),
}
VIEWERS = {
    "rviz": Argument("false", "open RViz with config/diffphys.rviz", bool),
    "fixed_frame": Argument("world", "of RViz: the frame of the results"),
    "foxglove": Argument("false", "start foxglove_bridge on port 8765; import config/foxglove.json in Foxglove", bool),
}
# Topics that config/diffphys.rviz names: a namespace goes before them.
SHOWN = (
    *(f"/fit_node/{name}" for name in ("material_field", "state", "force_markers", "stiffness_markers", "net_force", "rendered", "camera_info")),
    "/clip/image",
    "/click",
)


def description(arguments: dict[str, Argument], actions: Any) -> LaunchDescription:
    """A launch file: its arguments, and `actions`, which makes the actions of a table of their values."""

    def setup(context: Any) -> list[Any]:
        return list(actions({name: LaunchConfiguration(name).perform(context) for name in arguments}))

    declared = [DeclareLaunchArgument(name, default_value=each.default, description=each.doc) for name, each in arguments.items()]
    profile = SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", str(CONFIG / "fastdds.xml"))
    return LaunchDescription([*declared, profile, OpaqueFunction(function=setup)])


def said(given: dict[str, str], name: str) -> bool:
    """Whether an argument says yes."""
    return given.get(name, "false").lower() in YES


def parameters(given: dict[str, str], arguments: dict[str, Argument], names: dict[str, str]) -> dict[str, Any]:
    """Parameters of a node: those of `names` (argument: parameter) that were given, in their kind."""
    found: dict[str, Any] = {}
    for argument, parameter in names.items():
        value, each = given[argument], arguments[argument]
        if each.kind is bool:
            found |= {parameter: True} if said(given, argument) else {}
        elif value and (value != each.default or argument == "rrd"):
            found[parameter] = each.kind(value)
    return found


def node(name: str, given: dict[str, str], own: dict[str, Any], **more: Any) -> Node:
    """One of the nodes, with its own parameters after those of the file that all share."""
    return Node(
        package="diffphys_ros",
        executable=name,
        name=name,
        namespace=given["namespace"],
        parameters=[*files(given), {key: ParameterValue(value, value_type=type(value)) for key, value in shared(given, own).items()}],
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
        on_exit=[Shutdown(reason="the fit is done")] if name == "fit_node" and said(given, "exit_when_done") else None,
        **more,
    )


def one_process(given: dict[str, str], own: dict[str, dict[str, Any]], **more: Any) -> Node:
    """The nodes of the table `own` (name: parameters) in one process."""
    text = yaml.safe_dump({f"/**/{name}": {"ros__parameters": shared(given, each)} for name, each in own.items()})
    with tempfile.NamedTemporaryFile("w", prefix="diffphys_ros_", suffix=".yaml", delete=False) as file:
        file.write(text)
    left_out = sorted({"ingest_node", "segment_node", "splat_node", "fit_node", "inspect_node"} - own.keys())
    return Node(
        package="diffphys_ros",
        executable="graph",
        namespace=given["namespace"],
        arguments=[word for name in left_out for word in ("--without", name)],
        parameters=[*files(given), file.name],
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
        on_exit=[Shutdown(reason="the nodes have ended")],
        **more,
    )


def files(given: dict[str, str]) -> list[str]:
    """Files of parameters that were given."""
    return [given["params_file"]] if given["params_file"] else []


def shared(given: dict[str, str], own: dict[str, Any]) -> dict[str, Any]:
    """A node's own parameters with those that all nodes have."""
    return parameters(given, NODE, {"config": "config", "use_sim_time": "use_sim_time"}) | own


def inspect_node(given: dict[str, str]) -> dict[str, Any]:
    """Parameters of inspect_node."""
    return parameters(given, INSPECT, {"rrd": "file", "viewer": "viewer", "web_port": "web_port"})


def viewers(given: dict[str, str]) -> list[Any]:
    """RViz and what Foxglove connects to, where they are wanted."""
    actions: list[Any] = []
    if said(given, "rviz"):
        space = given["namespace"].strip("/")
        actions.append(
            Node(
                package="rviz2",
                executable="rviz2",
                name="rviz2",
                arguments=["-d", str(CONFIG / "diffphys.rviz"), "-f", given["fixed_frame"]],
                remappings=[(topic, f"/{space}{topic}") for topic in SHOWN] if space else [],
                parameters=[{"use_sim_time": said(given, "use_sim_time")}],
            )
        )
    if said(given, "foxglove"):
        actions += [
            Node(package="foxglove_bridge", executable="foxglove_bridge", name="foxglove_bridge", parameters=[{"use_sim_time": said(given, "use_sim_time")}]),
            LogInfo(msg=f"in Foxglove: open ws://localhost:8765 and import the layout {CONFIG / 'foxglove.json'}"),
        ]
    return actions
