"""Stiffness and forces of a deforming object, recovered from one video. The library; ROS lives in diffphys_ros.nodes."""

__version__ = "0.2.0"
