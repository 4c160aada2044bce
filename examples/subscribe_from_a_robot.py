"""A robot that asks how stiff a thing is and what pushed it: python examples/subscribe_from_a_robot.py [--ros-args -r fit_node:=...]

Results are latched: it may start before the fit, or long after it. It ends when it has both."""

from __future__ import annotations

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from diffphys_ros.msg_schemas import clouds

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Robot(Node):
    """Subscribes to the two fields and prints what they say."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.wanted = {"stiffness", "force"}
        self.create_subscription(PointCloud2, "fit_node/material_field", self.hear_stiffness, LATCHED)
        self.create_subscription(PointCloud2, "fit_node/force_field", self.hear_force, LATCHED)

    def hear_stiffness(self, cloud: PointCloud2) -> None:
        """Young's modulus of every particle at rest; NaN where its part is not identified, or nobody told a mass and a size."""
        points = clouds.particles(cloud, clouds.MATERIAL).ravel()
        name, unit = ("young_modulus", "Pa") if points["absolute"].all() else ("young_relative", "of the stiffest part's")
        for part in np.unique(points["part"]):
            own = points[points["part"] == part]
            said = f"E = {np.median(own[name]):.4g} {unit}" if own["identified"].all() else "not identified"
            print(f"part {part}: {said}", flush=True)
        self.wanted.discard("stiffness")

    def hear_force(self, cloud: PointCloud2) -> None:
        """Force densities [N/m^3], a row a frame; times volume and summed over a row they are the net force. NaN where nobody told a mass and a size."""
        rows = clouds.particles(cloud, clouds.FIELD)
        net = (clouds.xyz(rows, "f") * rows["volume"][..., None]).sum(1)
        print(f"largest net force: {np.linalg.norm(net, axis=1).max():.4g} N in frame {cloud.header.frame_id}", flush=True)
        self.wanted.discard("force")


def main() -> None:
    """Listens until both are here."""
    rclpy.init()
    robot = Robot()
    while robot.wanted:
        rclpy.spin_once(robot)
    robot.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
