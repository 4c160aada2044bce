"""What a robot would receive: `python -m diffphys_ros.nodes.listen --node fit_node` prints it, line by line.

Ends with status 0 when material, force and quality have arrived, whenever it was started; with 1 when the fit failed or
`--timeout` passed. `--out FILE` keeps the net force and the moduli as an .npz.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np

from diffphys_ros.msg_schemas import TOPICS, clouds, messages

WANTED = ("~/material_field", "~/force_field", "~/quality")
HEARD = (*WANTED, "~/progress", "~/net_force")
EVERY_S = 2.0  # between two lines about iterations


class Listener:
    """Receives the answer of a fit node."""

    def __init__(self, node: Any, name: str) -> None:
        from diffphys_ros.nodes.convert import message_class
        from diffphys_ros.nodes.qos import profile

        self.received: dict[str, Any] = {}
        self.failure = ""
        self._said_at, self._began, self._stage = 0.0, time.monotonic(), ""
        for topic in HEARD:
            row = TOPICS[topic]
            absolute = topic.replace("~", name, 1)
            node.create_subscription(message_class(row.type_name), absolute, lambda m, t=topic: self._take(t, m), profile(row))

    @property
    def complete(self) -> bool:
        """Whether the whole answer is here, or none will come."""
        return bool(self.failure) or all(topic in self.received for topic in WANTED)

    def say(self, text: str) -> None:
        """Print a line with the time since the start."""
        print(f"[{time.monotonic() - self._began:6.1f} s] {text}", flush=True)

    def arrays(self) -> dict[str, np.ndarray]:
        """Net force (T, 3) [N] summed over the received cloud, times (T,) [s], moduli (K,) [Pa] and parts (K,)."""
        rows, material = clouds.unpack(self.received["~/force_field"]), clouds.unpack(self.received["~/material_field"])[0]
        net = (clouds.xyz(rows, "f") * rows["volume"][..., None]).sum(1)
        return {"net_force": net, "t": rows["t"][:, 0], "young": material["young_modulus"], "part": material["part"]}

    def _take(self, topic: str, message: Any) -> None:
        first = topic not in self.received
        self.received[topic] = message
        if topic == "~/progress":
            self._hear_progress(message)
        elif first:
            {"~/material_field": self._tell_material, "~/force_field": self._tell_force, "~/quality": self._tell_quality}.get(
                topic, self._tell_played
            )(message)

    def _hear_progress(self, message: Any) -> None:
        for status in message.status:
            news, text = messages.values_of(status), status.message
            if status.level == bytes([messages.ERROR]):
                self.failure = text
            due = time.monotonic() - self._said_at > EVERY_S
            if due or news["stage"] != self._stage or (text and news["iterations"] == "0"):
                self._said_at, self._stage = time.monotonic(), news["stage"]
                self.say(_progress_line(news, text))

    def _tell_material(self, message: Any) -> None:
        points = clouds.unpack(message)[0]
        self.say(f"material_field: {len(points)} particles in frame {message.header.frame_id!r}")
        for part in np.unique(points["part"]):
            own = points["part"] == part
            young, sd = float(np.median(points["young_modulus"][own])), float(np.median(points["log10_young_sd"][own]))
            self.say(f"  part {part}: E = {young:.4g} Pa (x/ {10**sd:.2f}), {1e3 * float((points['volume'] * points['density'])[own].sum()):.0f} g")

    def _tell_force(self, message: Any) -> None:
        rows = clouds.unpack(message)
        net = (clouds.xyz(rows, "f") * rows["volume"][..., None]).sum(1)
        size = np.linalg.norm(net, axis=1)
        k = int(size.argmax())
        vector = ", ".join(f"{v:+.3f}" for v in net[k])
        self.say(f"force_field: {rows.shape[0]} frames x {rows.shape[1]} particles; peak net force {size[k]:.3g} N = ({vector}) at t = {rows['t'][k, 0]:.3f} s")

    def _tell_quality(self, message: Any) -> None:
        for status in message.status:
            v = messages.values_of(status)
            self.say(f"quality, {status.name}: identified {v['identified']}: {v['reason']}")
            for source in ("density_source", "metric_scale_source"):
                if source in v:
                    self.say(f"  {source}: {v[source]}")
            if status.level == bytes([messages.ERROR]):
                self.failure = status.message

    def _tell_played(self, message: Any) -> None:
        f = message.wrench.force
        self.say(f"net_force: playing; first sample ({f.x:+.3f}, {f.y:+.3f}, {f.z:+.3f}) N")


def _progress_line(news: dict[str, str], text: str) -> str:
    count = f" {news['iteration']}/{news['iterations']}" if news["iterations"] != "0" else ""
    loss = f", loss {float(news['loss']):.4g}" if news["loss"] else ""
    left = f", {float(news['seconds_left']):.0f} s left" if news["seconds_left"] else ""
    return f"{news['stage']}{count}{loss}{left}{': ' + text if text else ''}"


def main() -> int:
    """Listens until the answer is complete; returns the exit status."""
    parser = argparse.ArgumentParser(description="Prints what a fit node publishes.")
    parser.add_argument("--node", default="fit_node", help="name of the fit node, with its namespace")
    parser.add_argument("--timeout", type=float, default=float("inf"), help="longest wait [s]")
    parser.add_argument("--out", help=".npz for the received net force and moduli")
    options = parser.parse_args()
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    rclpy.init()
    node = rclpy.create_node("robot")
    listener = Listener(node, options.node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    until = time.monotonic() + options.timeout
    try:
        while not listener.complete and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.2)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return _end(listener, options.out)


def _end(listener: Listener, out: str | None) -> int:
    if listener.failure or not listener.complete:
        print(f"listen: {listener.failure or 'no answer came in time; is the fit node running in this ROS domain?'}", file=sys.stderr)
        return 1
    if out:
        arrays: dict[str, Any] = listener.arrays()
        np.savez(out, **arrays)
    return 0


if __name__ == "__main__":
    sys.exit(main())
