"""Tests of the nodes need rclpy; each run has a ROS domain of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from .domains import claimed

os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

try:
    import rclpy
except ImportError:
    rclpy = None


class WithoutRos(pytest.Module):
    """Stands for a test file that cannot be imported."""

    def collect(self) -> list[Any]:
        pytest.skip("rclpy is not installed; pip install '.[ros]' or source a ROS 2 Jazzy", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    return WithoutRos.from_parent(parent, path=module_path) if rclpy is None else None


@pytest.fixture(scope="session")
def domain() -> Iterator[int]:
    """The ROS domain of the nodes in this process."""
    with claimed() as number:
        yield number


@pytest.fixture
def make_node(domain: int) -> Iterator[Callable[..., Any]]:
    """Makes a node of a class in this process, with parameters as on a command line (`__` for a dot)."""
    made: list[Any] = []

    def make(cls: Callable[[], Any], **parameters: object) -> Any:
        words = [w for key, value in parameters.items() for w in ("-p", f"{key.replace('__', '.')}:={value}")]
        rclpy.init(args=["--ros-args", *words], domain_id=domain)
        made.append(cls())
        return made[-1]

    yield make
    for node in made:
        node.close()
        node.destroy_node()
    rclpy.try_shutdown()
