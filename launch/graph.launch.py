"""Five processes from a camera's raw topics to fields.

ros2 launch diffphys_ros graph.launch.py image:=/camera/color/image_raw camera_info:=/camera/color/camera_info depth:=/camera/depth/image_raw
"""

from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

INPUTS = {"image": "image", "camera_info": "camera_info", "depth": "depth", "mask": "mask", "camera_pose": "camera_pose"}
ARGUMENTS = {
    **{name: (topic, f"topic of {name}") for name, topic in INPUTS.items()},
    "reliability": ("best_effort", "of the raw inputs: best_effort or reliable"),
    "clip_trigger": ("always", "what opens a clip: always, manual (~/record) or motion"),
    "config": ("", "YAML file of settings"),
    "out": ("", "folder for the results; empty: none are written"),
    "rrd": ("diffphys.rrd", "rerun recording that inspect_node writes"),
    "namespace": ("", "namespace of the nodes"),
}


def generate_launch_description() -> LaunchDescription:
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    own = {
        "ingest_node": {"reliability": given["reliability"], "clip.trigger": given["clip_trigger"]},
        "segment_node": {},
        "splat_node": {},
        "fit_node": {"out": given["out"]},
        "inspect_node": {"file": given["rrd"]},
    }
    # image transports publish the compressed images below the raw topic
    raw = [*((name, given[name]) for name in INPUTS), ("image/compressed", [given["image"], "/compressed"])]
    nodes = [
        Node(
            package="diffphys_ros",
            executable=name,
            name=name,
            namespace=given["namespace"],
            parameters=[{"config": given["config"], **parameters}],
            remappings=raw if name == "ingest_node" else [],
            output="screen",
        )
        for name, parameters in own.items()
    ]
    profile = PathJoinSubstitution([FindPackageShare("diffphys_ros"), "config", "fastdds.xml"])
    declared = [DeclareLaunchArgument(name, default_value=default, description=doc) for name, (default, doc) in ARGUMENTS.items()]
    return LaunchDescription([*declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", profile), *nodes])
