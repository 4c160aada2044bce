"""The actions that the launch files share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from diffphys_arguments import ARGUMENTS, GETS, SHOWN, file_of_all, parameters, said
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

RESPAWN_S = 2.0  # before a node that has ended is started again
CONFIG = Path(__file__).absolute().parent.parent / "config"


def description(launch: str, actions: Any) -> LaunchDescription:
    """A launch file: its arguments, and `actions`, which makes actions of a table of their values."""

    def setup(context: Any) -> list[Any]:
        return list(actions({name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS[launch]}))

    declared = [DeclareLaunchArgument(name, default_value=each.default, description=each.doc) for name, each in ARGUMENTS[launch].items()]
    return LaunchDescription([*declared, OpaqueFunction(function=setup)])


def node(launch: str, name: str, given: dict[str, str], **more: Any) -> Node:
    """One of the nodes, with its own parameters after those of the file that all share."""
    ends = name == "fit_node" and said(given, "exit_when_done")
    own = {key: value if isinstance(value, list) else ParameterValue(value, value_type=type(value)) for key, value in parameters(launch, name, given).items()}
    return Node(
        package="diffphys_ros",
        executable=name,
        name=name,
        namespace=given["namespace"],
        parameters=[*files(given), own],
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
        on_exit=[Shutdown(reason="the fit is done")] if ends else None,
        respawn=said(given, "respawn") and not ends,
        respawn_delay=RESPAWN_S,
        **more,
    )


def one_process(launch: str, names: list[str], given: dict[str, str], **more: Any) -> Node:
    """These nodes in one process."""
    again = said(given, "respawn") and not said(given, "exit_when_done")
    return Node(
        package="diffphys_ros",
        executable="graph",
        namespace=given["namespace"],
        arguments=[word for name in GETS[launch] if name not in names for word in ("--without", name)],
        parameters=[*files(given), file_of_all(launch, names, given)],
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
        on_exit=None if again else [Shutdown(reason="the nodes have ended")],
        respawn=again,
        respawn_delay=RESPAWN_S,
        **more,
    )


def files(given: dict[str, str]) -> list[str]:
    """Files of parameters that were given."""
    return [given["params_file"]] if given["params_file"] else []


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
