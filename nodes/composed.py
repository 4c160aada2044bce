"""The five nodes in one process: one executor, one participant of the middleware, one copy of the libraries.

They keep their names, topics and parameters; a file of parameters says whose each one is. A clip still goes over topics, so that it can be
inspected and joined by nodes elsewhere.
"""

from __future__ import annotations

import argparse
import importlib
from typing import Any

from rclpy.utilities import remove_ros_args

from diffphys_ros.errors import InputError

NODES = {
    "ingest_node": "IngestNode",
    "segment_node": "SegmentNode",
    "splat_node": "SplatNode",
    "fit_node": "FitNode",
    "inspect_node": "InspectNode",
}


class Graph:
    """The nodes, to be spun, closed and destroyed together. `--without NAME` leaves one out."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        for name in chosen(remove_ros_args()[1:]):
            try:
                self.nodes.append(getattr(importlib.import_module(f"diffphys_ros.nodes.{name}"), NODES[name])())
            except Exception:
                self.close()
                self.destroy_node()
                raise

    @property
    def exit_status(self) -> int | None:
        """With which a node wants the process to end, where one does."""
        return next((status for node in self.nodes if (status := getattr(node, "exit_status", None)) is not None), None)

    def close(self) -> None:
        """Stop the work of all."""
        for node in self.nodes:
            node.close()

    def destroy_node(self) -> None:
        """Destroy all."""
        for node in self.nodes:
            node.destroy_node()


def chosen(words: list[str]) -> list[str]:
    """Names of the nodes that a command line asks for. Raises InputError where it cannot be read."""
    parser = argparse.ArgumentParser(prog="graph", description="The five nodes in one process.", exit_on_error=False)
    parser.add_argument("--without", action="append", default=[], choices=NODES, help="a node that is left out; may be given again")
    try:
        options, strange = parser.parse_known_args(words)
    except argparse.ArgumentError as error:
        raise InputError(f"graph: {error}; give --without and the name of a node") from error
    if strange:
        raise InputError(f"graph: {strange[0]!r} is no argument of it; it takes --without NAME and ROS arguments")
    return [name for name in NODES if name not in options.without]
