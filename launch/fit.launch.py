"""One process from a bag to fields: ros2 launch diffphys_ros fit.launch.py bag:=clip.mcap config:=given.yaml out:=results."""

from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "bag": ("", "recording: MCAP file, rosbag2 folder, video or image folder"),
    "config": ("", "YAML file of settings"),
    "out": ("", "folder for the results; empty: none are written"),
    "namespace": ("", "namespace of the node"),
}


def generate_launch_description() -> LaunchDescription:
    profile = PathJoinSubstitution([FindPackageShare("diffphys_ros"), "config", "fastdds.xml"])
    node = Node(
        package="diffphys_ros",
        executable="fit_node",
        name="fit_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[{name: LaunchConfiguration(name) for name in ("bag", "config", "out")}],
        output="screen",
    )
    declared = [DeclareLaunchArgument(name, default_value=default, description=doc) for name, (default, doc) in ARGUMENTS.items()]
    return LaunchDescription([*declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", profile), node])
