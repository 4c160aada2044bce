#!/usr/bin/env python3
"""Memory of fit_node before, during and after a fit of the bundled sample, and its processor time afterwards with and without a subscriber.

`benchmarks/footprint.py [--domain 80] [NAME:=VALUE ...]`: a row a phase; further words are parameters of the node.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.nodes import middleware
from diffphys_ros.nodes.memory import children, held_mib_of

CODE = "from diffphys_ros.nodes.executables import fit_node; fit_node()"
LOOK_S, WATCHED_S = 0.1, 15.0


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Measures the footprint of fit_node.")
    parser.add_argument("--domain", type=int, default=80)
    parser.add_argument("parameters", nargs="*")
    options = parser.parse_args()
    middleware.prepare()
    os.environ |= {"ROS_DOMAIN_ID": str(options.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    words = [f"config:={sample_folder() / 'given.yaml'}", *options.parameters]
    node = subprocess.Popen([sys.executable, "-c", CODE, "--ros-args", *(w for p in words for w in ("-p", p))], stderr=subprocess.DEVNULL)
    try:
        watch(node.pid)
    finally:
        node.send_signal(signal.SIGINT)
        node.wait()
    return 0


def watch(pid: int) -> None:
    """Has the node fit the sample, and prints a row a phase."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rcl_interfaces.srv import SetParameters
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from std_srvs.srv import Trigger

    from diffphys_ros.msg_schemas import TOPICS, messages
    from diffphys_ros.msg_schemas.topics import PLAYED
    from diffphys_ros.nodes.convert import message_class
    from diffphys_ros.nodes.qos import profile

    rclpy.init()
    me, heard = rclpy.create_node("measure"), [""]
    executor = SingleThreadedExecutor()
    executor.add_node(me)
    me.create_subscription(DiagnosticArray, "/fit_node/progress", lambda m: heard.append(messages.values_of(m.status[0])["stage"]), profile(TOPICS["~/progress"]))

    def call(kind, name: str, request):  # type: ignore[no-untyped-def]
        client = me.create_client(kind, f"/fit_node/{name}")
        while not client.service_is_ready():
            executor.spin_once(timeout_sec=LOOK_S)
        future = client.call_async(request)
        while not future.done():
            executor.spin_once(timeout_sec=LOOK_S)

    def row(phase: str, mib: float, seconds: float) -> None:
        began, until = busy_s(pid), time.monotonic() + seconds
        while time.monotonic() < until:
            executor.spin_once(timeout_sec=LOOK_S)
        print(f"| {phase} | {mib:.0f} | {f'{100 * (busy_s(pid) - began) / seconds:.1f} %' if seconds else ''} |", flush=True)

    print("| phase | memory [MiB] | of a core |\n| --- | --- | --- |")
    bag = Parameter("bag", value=str(sample_folder() / "clip.mcap")).to_parameter_msg()
    call(SetParameters, "set_parameters", SetParameters.Request(parameters=[bag]))
    row("before the fit", sum(memory_mib(pid)), WATCHED_S)
    call(Trigger, "fit", Trigger.Request())
    peak = (0.0, 0.0)
    while heard[-1] not in ("done", "failed"):
        executor.spin_once(timeout_sec=LOOK_S)
        peak = max(peak, memory_mib(pid), key=sum)
    row(f"peak of the fit ({peak[0]:.0f} of it the node)", sum(peak), 0)
    time.sleep(1.0)
    row(f"after the fit ({heard[-1]}), nobody subscribes", sum(memory_mib(pid)), WATCHED_S)
    for name in PLAYED:
        me.create_subscription(message_class(TOPICS[name].type_name), name.replace("~", "/fit_node"), lambda m: None, profile(TOPICS[name]))
    row("all played topics are subscribed to", sum(memory_mib(pid)), WATCHED_S)
    me.destroy_node()
    rclpy.try_shutdown()


def memory_mib(pid: int) -> tuple[float, float]:
    """Of the node, and of its children."""
    return held_mib_of(pid), sum(map(held_mib_of, children(pid)))


def busy_s(pid: int) -> float:
    """Processor time of the node so far [s]."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    sys.exit(main())
