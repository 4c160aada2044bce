"""What a robot does with fit_node, which runs in this process or in one of its own."""

from __future__ import annotations

import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.convert import message_class
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.qos import profile

from .processes import PATIENCE_S


class Robot:
    """A node that subscribes to fit_node and calls its services; spun together with it where it is given."""

    def __init__(self, node: FitNode | None = None, *, context: rclpy.Context | None = None) -> None:
        self.node, self.me, self.heard = node, rclpy.create_node("robot", context=context), {}
        self.executor = SingleThreadedExecutor(context=context)
        for each in filter(None, (node, self.me)):
            self.executor.add_node(each)

    def listen(self, name: str) -> None:
        topic, self.heard[name] = TOPICS[name], []
        self.me.create_subscription(message_class(topic.type_name), name.replace("~", "/fit_node"), self.heard[name].append, profile(topic))

    def until(self, condition, timeout_s: float = PATIENCE_S) -> None:
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, f"waited in vain; heard {self.stages()[-3:]}"
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, service: str):
        client = self.me.create_client(Trigger, f"/fit_node/{service}")
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def progress(self) -> list[dict[str, str]]:
        return [messages.values_of(m.status[0]) for m in self.heard.get("~/progress", ())]

    def stages(self) -> list[str]:
        return [values["stage"] for values in self.progress()]

    def fits(self, iteration: int) -> bool:
        """Whether the fit has told of this iteration."""
        return str(iteration) in self.iterations()

    def iterations(self) -> list[str]:
        """Of the fit, that were told of."""
        return [values["iteration"] for values in self.progress() if values["stage"] == "fit"]

    def close(self) -> None:
        """Leave fit_node alone; its owner closes it."""
        self.executor.shutdown()
        self.me.destroy_node()
