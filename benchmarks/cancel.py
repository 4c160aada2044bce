#!/usr/bin/env python3
"""How fast fit_node answers ~/cancel, and how fast the fit has ended: cancels at random moments of fits of the bundled sample.

`benchmarks/cancel.py [--count 40] [--earliest 0.05] [--longest 40] [--cold]`: a row a stage. `--earliest` and `--longest` bound the moment after
~/fit [s]; with `--cold` Warp compiles its kernels anew in every fit.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict

import numpy as np

from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.nodes import middleware

CODE = "from diffphys_ros.nodes.executables import fit_node; fit_node()"
QUICK = {"fit.iterations": 3, "experiment.cells": 2}


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Measures ~/cancel.")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--earliest", type=float, default=0.05)
    parser.add_argument("--longest", type=float, default=40.0)
    parser.add_argument("--cold", action="store_true")
    parser.add_argument("--domain", type=int, default=77)
    options = parser.parse_args()
    middleware.prepare()
    os.environ |= {"ROS_DOMAIN_ID": str(options.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryDirectory() as cache:
        if options.cold:
            os.environ["WARP_CACHE_PATH"] = cache
        given = QUICK | {"bag": sample_folder() / "clip.mcap", "config": sample_folder() / "given.yaml"}
        words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
        node = subprocess.Popen([sys.executable, "-c", CODE, "--ros-args", *words], stderr=subprocess.DEVNULL)
        try:
            measure(options, cache)
        finally:
            node.send_signal(signal.SIGINT)
            node.wait()
    return 0


def measure(options: argparse.Namespace, cache: str) -> None:
    """Cancels `options.count` fits."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import Trigger

    from diffphys_ros.msg_schemas import TOPICS, messages
    from diffphys_ros.nodes.qos import profile

    rclpy.init()
    me, heard = rclpy.create_node("measure"), [""]
    executor = SingleThreadedExecutor()
    executor.add_node(me)
    me.create_subscription(DiagnosticArray, "/fit_node/progress", lambda m: heard.append(messages.values_of(m.status[0])["stage"]), profile(TOPICS["~/progress"]))
    clients = {name: me.create_client(Trigger, f"/fit_node/{name}") for name in ("fit", "cancel", "reset")}

    def until(condition, timeout_s: float = 300.0) -> float:  # type: ignore[no-untyped-def]
        began = time.monotonic()
        while not condition():
            assert time.monotonic() - began < timeout_s
            executor.spin_once(timeout_sec=0.002)
        return time.monotonic() - began

    def call(name: str):  # type: ignore[no-untyped-def]
        future = clients[name].call_async(Trigger.Request())
        took = until(future.done)
        return took, future.result()

    until(lambda: all(client.service_is_ready() for client in clients.values()))
    call("cancel")
    until(lambda: heard[-1] == "cancelled")
    answered, ended = defaultdict(list), defaultdict(list)
    for when in np.random.default_rng(0).permutation(np.linspace(options.earliest, options.longest, options.count)):
        if options.cold:
            shutil.rmtree(cache, ignore_errors=True)
        call("reset")
        heard.append("start")
        assert call("fit")[1].success
        at = time.monotonic() + when
        until(lambda at=at: time.monotonic() > at or heard[-1] == "done")
        if heard[-1] == "done":
            continue
        took, answer = call("cancel")
        if not answer.success:
            continue
        stage = heard[-1]
        answered[stage].append(took)
        ended[stage].append(took + until(lambda: heard[-1] == "cancelled"))
    rows = {stage: (answered[stage], ended[stage]) for stage in answered}
    rows["all"] = tuple([each for some in values.values() for each in some] for values in (answered, ended))
    print("| stage | cancels | answer: median, largest [s] | ended: median, largest [s] |\n| --- | --- | --- | --- |")
    for stage, (a, e) in rows.items():
        print(f"| {stage} | {len(a)} | {np.median(a):.3f}, {max(a):.3f} | {np.median(e):.2f}, {max(e):.2f} |")
    me.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
