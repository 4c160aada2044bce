#!/usr/bin/env python3
"""What the five nodes hold of an endless 640x480 camera with depth at 30 Hz: PSS of each, and shared memory, while clips are recorded and fitted.

A process of its own publishes a strip that is pushed every few seconds. Exit status 0 only if all nodes together stay under the bound.
"""

from __future__ import annotations

import argparse
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from clip_rig import NODES
from processes import environment, node, run, stop

from diffphys_ros.msg_schemas import messages
from diffphys_ros.nodes.memory import held_mib
from diffphys_ros.nodes.middleware import PROFILE, VARIABLE

WIDTH, HEIGHT, HZ = 640, 480, 30
FOCAL_PX, DISTANCE_M = 600.0, 0.5
LEFT, RIGHT, TOP, BOTTOM = 150, 470, 200, 280  # of the strip [px]
PERIOD = 240  # frames from push to push
BOUND_MIB = 4096
FIRST_S, BETWEEN_S, CLIP_S = 12.0, 10.0, 5.0  # when clips are recorded: the second one while the first is worked on
SETTINGS = {
    "scene.clamp_box_m": "[-0.152, -0.06, 0.4, -0.1415, 0.06, 0.6]",
    "scene.thickness_m": 0.03,
    "scene.thickness_axis": "[0.0, 0.0, 1.0]",
    "scene.gravity_m_s2": "[0.0, 0.0, 0.0]",
    "segment.max_parts": 1,
    "fit.iterations": 2,
}
MIB = 2**20
MAPPING = re.compile(r"[0-9a-f]+-[0-9a-f]+ ")  # begins the rows of one in /proc/PID/smaps


def main(arguments: list[str]) -> int:
    """Prints a table; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--camera", action="store_true", help="be the camera")
    parser.add_argument("--clips", type=int, default=2, help="of 5 s, one after the other")
    parser.add_argument("--slow", type=float, default=1.0, help="how many times slower than its stamps the camera sends, for a machine that is busy")
    parser.add_argument("--limit", type=float, default=900.0, help="longest wait for them [s]")
    parser.add_argument("--out", type=Path, default=Path("out/live_memory"), help="folder for the logs")
    options = parser.parse_args(arguments)
    if options.camera:
        return camera(options.slow)
    shutil.rmtree(options.out, ignore_errors=True)
    options.out.mkdir(parents=True)
    given = options.out / "given.yaml"
    given.write_text("".join(f"{name}: {value}\n" for name, value in SETTINGS.items()))
    own = {"ingest_node": {"clip.trigger": "manual", "reliability": "reliable"}, "inspect_node": {"file": options.out / "all.rrd"}}
    commands = {name: node(name, own.get(name, {}) | {"config": given}) for name in NODES}
    commands["camera"] = [sys.executable, __file__, "--camera", "--slow", str(options.slow)]
    env = environment() | {VARIABLE: str(PROFILE)}
    running: dict[str, subprocess.Popen] = {}
    try:
        for name, command in commands.items():
            with (options.out / f"{name}.log").open("w") as log:
                running[name] = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, env=env)
        while "publishing" not in (options.out / "camera.log").read_text():
            time.sleep(0.5)
        return watch(running, options)
    finally:
        for process in running.values():
            stop(process)


def watch(running: dict[str, subprocess.Popen], options: argparse.Namespace) -> int:
    """Records clips and looks at memory until all are fitted; returns the exit status."""
    most = then = dict.fromkeys([*NODES, "/dev/shm", "all"], 0.0)
    began, recorded, opened, ended = time.monotonic(), 0, None, 0
    while ended < options.clips and time.monotonic() - began < options.limit:
        time.sleep(0.5)
        now = {name: held_mib(running[name].pid) for name in NODES} | {"/dev/shm": shared_mib([running[name].pid for name in NODES])}
        now["all"] = sum(now.values())
        then = max(then, now, key=lambda each: each["all"])
        most = {name: max(value, now[name]) for name, value in most.items()}
        said = (options.out / "ingest_node.log").read_text()
        fits = (options.out / "fit_node.log").read_text()
        ended = fits.count("done: fields are latched") + fits.count("failed:")
        if opened is None and time.monotonic() - began > options.slow * (FIRST_S + BETWEEN_S * recorded) and recorded < options.clips:
            call("/ingest_node/record", "std_srvs/srv/SetBool", options)
            opened, recorded = time.monotonic(), recorded + 1
        elif opened is not None and time.monotonic() - opened > options.slow * CLIP_S:
            call("/ingest_node/end", "std_srvs/srv/Trigger", options)
            opened = None
        print(f"{time.monotonic() - began:6.0f} s  " + "  ".join(f"{name} {value:5.0f}" for name, value in now.items()), f" published {said.count('published a clip')}, fitted {ended}", flush=True)
    print(f"\n{'MiB (PSS)':16}{'most':>8}{'when all held most':>22}")
    for name, value in most.items():
        print(f"{name:16}{value:8.0f}{then[name]:22.0f}")
    print(f"{ended} of {options.clips} clips fitted; bound {BOUND_MIB} MiB")
    return 0 if ended >= options.clips and most["all"] < BOUND_MIB else 1


def call(service: str, kind: str, options: argparse.Namespace) -> None:
    """A service, from a process that does not count."""
    code = (
        "import sys, rclpy, importlib; rclpy.init(); n = rclpy.create_node('person')\n"
        f"k = getattr(importlib.import_module('std_srvs.srv'), {kind.rsplit('/', 1)[-1]!r}); r = k.Request()\n"
        "setattr(r, 'data', True) if hasattr(r, 'data') else None\n"
        f"c = n.create_client(k, {service!r}); c.wait_for_service(20); f = c.call_async(r); rclpy.spin_until_future_complete(n, f, timeout_sec=20); print(f.result(), flush=True)"
    )
    with (options.out / "calls.log").open("a") as log:
        subprocess.Popen([sys.executable, "-c", code], stdout=log, stderr=subprocess.STDOUT, env=environment() | {VARIABLE: str(PROFILE)})


def shared_mib(pids: list[int]) -> float:
    """What lies in files of /dev/shm that these processes map, beyond what is in their PSS of it."""
    held, counted = dict[str, int](), 0
    for pid in pids:
        file = ""
        with suppress(OSError):
            for row in Path(f"/proc/{pid}/smaps").read_text().splitlines():
                if MAPPING.match(row):
                    file = row.split()[-1] if "/dev/shm/" in row else ""
                    if file and Path(file).exists():
                        held[file] = Path(file).stat().st_blocks * 512
                elif file in held and row.startswith("Pss:"):
                    counted += int(row.split()[1]) * 1024
    return (sum(held.values()) - counted) / MIB


def film() -> tuple[np.ndarray, np.ndarray]:
    """PERIOD frames (H, W, 3) uint8 and depth (H, W) uint16 [mm] of a strip that rests, is pushed and swings."""
    rng = np.random.default_rng(0)
    texture = cv2.resize(rng.integers(60, 250, (60, 80, 3), dtype=np.uint8), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    grey = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    u, v = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    along = np.clip((u - LEFT) / (RIGHT - LEFT), 0, 1)
    frames = np.empty((PERIOD, HEIGHT, WIDTH, 3), np.uint8)
    depth = np.full((HEIGHT, WIDTH), 900, np.uint16)
    depth[TOP - 20 : BOTTOM + 20, LEFT:RIGHT] = round(1e3 * DISTANCE_M)
    for k, q in enumerate(swing()):
        back = v - (np.float32(q) * along**2 * (3 - along) / 2)
        inside = (u >= LEFT) & (u < RIGHT) & (back >= TOP) & (back < BOTTOM)
        shown = np.where(inside[..., None], cv2.remap(texture, u, back, cv2.INTER_LINEAR), grey)
        frames[k] = np.clip(shown + rng.normal(0, 1.5, (HEIGHT, WIDTH, 1)).round(), 0, 255)
    return frames, depth


def swing() -> np.ndarray:
    """Tip displacement (PERIOD,) [px] of an oscillator of 2 Hz that is pushed for a third of a second after two."""
    q, speed, track, step = 0.0, 0.0, [], 1 / (HZ * 100)
    for k in range(PERIOD):
        for _ in range(100):
            push = 3000.0 if 2.0 < k / HZ < 2.3 else 0.0
            speed += step * (push - (2 * np.pi * 2) ** 2 * q - 1.2 * speed)
            q += step * speed
        track.append(q)
    return np.array(track)


def camera(slow: float) -> int:
    """Publishes for ever, at the camera's rate."""
    import rclpy
    from geometry_msgs.msg import TransformStamped
    from sensor_msgs.msg import CameraInfo, Image

    from diffphys_ros.nodes.convert import to_ros
    from diffphys_ros.nodes.qos import latched, sensor
    from diffphys_ros.types import Camera

    frames, depth = film()
    k = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]])
    seen = Camera(k, np.eye(4), WIDTH, HEIGHT, "camera_optical", "world")
    rclpy.init()
    me = rclpy.create_node("camera")
    image, deep = (me.create_publisher(Image, topic, sensor("reliable")) for topic in ("image", "depth"))
    info, pose = me.create_publisher(CameraInfo, "camera_info", sensor("reliable")), me.create_publisher(TransformStamped, "camera_pose", latched())
    pose.publish(to_ros("geometry_msgs/msg/TransformStamped", messages.camera_pose(0, seen)))
    print("publishing", flush=True)
    began, first = time.monotonic(), time.time_ns()
    millimetres = depth.tobytes()
    for number in range(10**9):
        time.sleep(max(0.0, began + slow * number / HZ - time.monotonic()))
        head = messages.header(first + round(number / HZ * 1e9), "camera_optical")
        if number % HZ == 0:
            info.publish(to_ros("sensor_msgs/msg/CameraInfo", messages.camera_info(head, seen)))
        deep.publish(to_ros("sensor_msgs/msg/Image", {"header": head, "height": HEIGHT, "width": WIDTH, "encoding": "16UC1", "step": 2 * WIDTH, "data": millimetres}))
        image.publish(to_ros("sensor_msgs/msg/Image", messages.image(head, frames[number % PERIOD], "rgb8")))
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run(lambda: main(sys.argv[1:]))
