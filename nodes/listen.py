"""What a robot would receive: `python -m diffphys_ros.nodes.listen --node fit_node` prints it, line by line.

Ends with status 0 when material, force and quality have arrived, whenever it was started; with 1 when the fit failed or
`--timeout` passed. `--out FILE` keeps the net force and the moduli as an .npz.
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from typing import Any, NoReturn

import numpy as np

from diffphys_ros.errors import short
from diffphys_ros.msg_schemas import TOPICS, clouds, messages
from diffphys_ros.nodes import middleware
from diffphys_ros.nodes.executables import Stop, clean_up

WANTED = ("~/material_field", "~/force_field", "~/quality")
HEARD = (*WANTED, "~/progress", "~/net_force")
EVERY_S = 2.0  # between two lines about iterations
MOST_PARTS = 255  # that are told; a label image has no more
MOST_SD = 100.0  # of log10 E that is told


class Listener:
    """Receives the answer of a fit node."""

    def __init__(self, node: Any, name: str) -> None:
        from diffphys_ros.nodes.convert import message_class
        from diffphys_ros.nodes.net import Net
        from diffphys_ros.nodes.qos import profile

        self.net = Net(node.get_logger)

        self.received: dict[str, Any] = {}
        self.failure = ""
        self._said_at, self._began, self._stage = 0.0, time.monotonic(), ""
        for topic in HEARD:
            row = TOPICS[topic]
            absolute = topic.replace("~", name, 1)
            node.create_subscription(message_class(row.type_name), absolute, self.net.around(partial(self._take, topic), absolute), profile(row))

    @property
    def complete(self) -> bool:
        """Whether the whole answer is here, or none will come."""
        return bool(self.failure) or all(topic in self.received for topic in WANTED)

    def say(self, text: str) -> None:
        """Print a line with the time since the start."""
        print(f"[{time.monotonic() - self._began:6.1f} s] {text}", flush=True)

    def arrays(self) -> dict[str, np.ndarray]:
        """Net force (T, 3) [N] summed over the received cloud, times (T,) [s], moduli (K,) [Pa] and parts (K,); NaN where no newtons and pascals are known."""
        rows, material = self.received["~/force_field"], self.received["~/material_field"]
        net = (clouds.xyz(rows, "f") * rows["volume"][..., None]).sum(1)
        return {"net_force": net, "t": rows["t"][:, 0], "young": material["young_modulus"], "part": material["part"]}

    def _take(self, topic: str, message: Any) -> None:
        if topic in clouds.LAYOUTS:
            rows = clouds.particles(message, clouds.LAYOUTS[topic])
            content = rows.ravel() if topic == "~/material_field" else rows
        else:
            content = message
        first = topic not in self.received
        self.received[topic] = content
        if topic == "~/progress":
            self._hear_progress(message)
        elif topic == "~/material_field" and first:
            self._tell_material(content, message.header.frame_id)
        elif first:
            {"~/force_field": self._tell_force, "~/quality": self._tell_quality}.get(topic, self._tell_played)(content)

    def _hear_progress(self, message: Any) -> None:
        for status in message.status:
            news, text = messages.values_of(status), status.message
            if status.level == bytes([messages.ERROR]):
                self.failure = text
            due, stage = time.monotonic() - self._said_at > EVERY_S, news.get("stage", "")
            if due or stage != self._stage or (text and news.get("iterations", "0") == "0"):
                self._said_at, self._stage = time.monotonic(), stage
                self.say(_progress_line(news, text))

    def _tell_material(self, points: np.ndarray, frame_id: str) -> None:
        self.say(f"material_field: {len(points)} particles in frame {short(frame_id)}" + ("" if points["absolute"].all() else "; E and force are relative: nobody told a density or a size"))
        for part in np.unique(points["part"])[:MOST_PARTS]:
            own = points["part"] == part
            self.say(f"  part {part}: {_stiffness_line(points[own])}")

    def _tell_force(self, rows: np.ndarray) -> None:
        force, name, unit = clouds.known_force(rows)
        net = (force * rows["volume"][..., None]).sum(1)
        net = net if unit else net / (float(np.linalg.norm(net, axis=1).max()) or 1.0)
        size = np.linalg.norm(net, axis=1)
        k = int(size.argmax())
        vector = ", ".join(f"{v:+.3f}" for v in net[k])
        self.say(f"force_field: {rows.shape[0]} frames x {rows.shape[1]} particles; peak net {name} {size[k]:.3g} {unit or 'of its peak'} = ({vector}) at t = {rows['t'][k, 0]:.3f} s")

    def _tell_quality(self, message: Any) -> None:
        for status in message.status:
            v = messages.values_of(status)
            self.say(f"quality, {status.name}: identified {v.get('identified', '')}: {v.get('reason', '')}")
            for source in ("density_source", "metric_scale_source"):
                if source in v:
                    self.say(f"  {source}: {v[source]}")
            if status.level == bytes([messages.ERROR]):
                self.failure = status.message

    def _tell_played(self, message: Any) -> None:
        f = message.wrench.force
        self.say(f"net_force: playing; first sample ({f.x:+.3f}, {f.y:+.3f}, {f.z:+.3f}) N")


def _stiffness_line(points: np.ndarray) -> str:
    """Of the particles of a part, as far as its scale is known."""
    young, specific, relative, sd, of_specific = (
        float(np.median(points[name])) for name in ("young_modulus", "young_over_density", "young_relative", "log10_young_sd", "log10_young_over_density_sd")
    )
    if points["absolute"].all():
        return f"E = {young:.4g} Pa (x/ {10 ** min(sd, MOST_SD):.2f}), {1e3 * float((points['volume'] * points['density']).sum()):.0f} g"
    if np.isfinite(specific):
        return f"E/density = {specific:.4g} m^2/s^2 (x/ {10 ** min(of_specific, MOST_SD):.2f})"
    return f"E = {relative:.4g} of the stiffest part's" if np.isfinite(relative) else "E is not identified"


def _progress_line(news: dict[str, str], text: str) -> str:
    known = {name: messages.number(news.get(name, "")) for name in ("iteration", "iterations", "loss", "seconds_left")}
    count = f" {known['iteration'] or 0:.0f}/{known['iterations']:.0f}" if known["iterations"] else ""
    loss = "" if known["loss"] is None else f", loss {known['loss']:.4g}"
    left = "" if known["seconds_left"] is None else f", {known['seconds_left']:.0f} s left"
    return f"{news.get('stage', '')}{count}{loss}{left}{': ' + text if text else ''}"


def main() -> NoReturn:
    """Listens until the answer is complete."""
    parser = argparse.ArgumentParser(description="Prints what a fit node publishes.")
    parser.add_argument("--node", default="fit_node", help="name of the fit node, with its namespace")
    parser.add_argument("--timeout", type=float, default=float("inf"), help="longest wait [s]")
    parser.add_argument("--out", help=".npz for the received net force and moduli")
    options = parser.parse_args()
    middleware.prepare()
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    rclpy.init()
    node = rclpy.create_node("robot")
    listener = Listener(node, options.node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    until, status = time.monotonic() + options.timeout, 1
    try:
        while not listener.complete and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.2)
        status = _end(listener, options.out)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        sys.excepthook(*sys.exc_info())
    finally:
        Stop.deafen()
        clean_up(status, node.destroy_node, rclpy.try_shutdown)


def _end(listener: Listener, out: str | None) -> int:
    if listener.failure or not listener.complete:
        print(f"listen: {listener.failure or 'no answer came in time; is the fit node running in this ROS domain?'}", file=sys.stderr)
        return 1
    if out:
        arrays: dict[str, Any] = listener.arrays()
        np.savez(out, **arrays)
    return 0


if __name__ == "__main__":
    main()
