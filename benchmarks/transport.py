#!/usr/bin/env python3
"""How many VGA images of a camera driver reach ingest_node, with and without the Fast DDS profile, and what it says: a row a case.

`benchmarks/transport.py [--images 100] [--domain 78]`: the driver is a process of its own that publishes colour at 30 Hz.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np

from diffphys_ros.nodes.middleware import PROFILE, VARIABLE

NODE = "from diffphys_ros.nodes.executables import ingest_node; ingest_node()"
CASES = (  # driver has the profile, node has it, reliability of driver and node
    (False, False, "best_effort"),
    (False, True, "best_effort"),
    (True, True, "best_effort"),
    (False, True, "reliable"),
)
PERIOD_S, HEIGHT, WIDTH = 1 / 30, 480, 640
LONGEST_S = 25.0


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Measures the loss of images on their way to ingest_node.")
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--domain", type=int, default=78)
    parser.add_argument("--drive", help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(options.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    if options.drive:
        drive(options.images, options.drive)
        return 0
    print("| driver has the profile | node has it | reliability | arrived | told lost | warned after | first warning |\n| --- | --- | --- | --- | --- | --- | --- |")
    for case in CASES:
        print("| " + " | ".join(map(str, case)) + " | " + " | ".join(map(str, measure(*case, options.images))) + " |", flush=True)
    return 0


def measure(driver_has: bool, node_has: bool, reliability: str, images: int) -> tuple[Any, ...]:
    """Images that arrived, losses that were told of, when the first warning came [s], and what it said."""
    without = {name: value for name, value in os.environ.items() if name != VARIABLE}
    with_it, plain = without | {VARIABLE: str(PROFILE)}, without | {"FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}
    words = ["--ros-args", "-p", f"reliability:={reliability}", "-p", "silence_s:=60.0"]
    node = subprocess.Popen([sys.executable, "-c", NODE, *words], env=with_it if node_has else plain, stderr=subprocess.DEVNULL)
    driver = subprocess.Popen([sys.executable, __file__, "--images", str(images), "--drive", reliability], env=with_it if driver_has else without)
    try:
        return _heard(images)
    finally:
        driver.kill()
        node.send_signal(signal.SIGINT)
        node.wait()


def _heard(images: int) -> tuple[Any, ...]:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.executors import SingleThreadedExecutor

    from diffphys_ros.msg_schemas import messages

    rclpy.init()
    me, heard = rclpy.create_node("measure"), []
    me.create_subscription(DiagnosticArray, "/diagnostics", lambda m: heard.append((time.monotonic(), m.status[0])), 10)
    executor = SingleThreadedExecutor()
    executor.add_node(me)
    until, there = time.monotonic() + LONGEST_S, 0
    while time.monotonic() < until and there < images - 2:
        executor.spin_once(timeout_sec=0.05)
        values = [messages.values_of(status) for _, status in heard]
        there = int(values[-1]["received"]) + int(values[-1]["lost"]) if values else 0
    began = next((at for (at, _), v in zip(heard, values, strict=True) if int(v["received"])), float("nan"))
    warned = [(at, s.message) for (at, s), v in zip(heard, values, strict=True) if s.level == b"\x01" and "/image:" in s.message]
    at, said = warned[0] if warned else (float("nan"), "")
    me.destroy_node()
    rclpy.try_shutdown()
    return values[-1]["received"], values[-1]["lost"], f"{max(at - began, 0):.1f} s" if warned else "", said


def drive(images: int, reliability: str) -> None:
    """The driver: waits for a subscriber, then publishes."""
    import rclpy
    from sensor_msgs.msg import Image

    from diffphys_ros.nodes.qos import sensor

    rclpy.init()
    node = rclpy.create_node("camera")
    output = node.create_publisher(Image, "image", sensor(reliability))
    while not output.get_subscription_count():
        time.sleep(0.05)
    time.sleep(0.5)
    data, began = np.zeros(HEIGHT * WIDTH * 3, np.uint8).tobytes(), time.monotonic()
    for k in range(images):
        time.sleep(max(0.0, began + k * PERIOD_S - time.monotonic()))
        message = Image(height=HEIGHT, width=WIDTH, encoding="rgb8", step=3 * WIDTH)
        message.header.stamp, message.data = node.get_clock().now().to_msg(), data
        output.publish(message)
    time.sleep(LONGEST_S)  # a driver does not end with its last image


if __name__ == "__main__":
    sys.exit(main())
