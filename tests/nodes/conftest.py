"""Tests of the nodes need rclpy; each run has a ROS domain of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from .domains import claimed

os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

# A few iterations on a coarse grid; a count that is given makes the fit forget the clock.
FEW = """
fit: {iterations: 3}
particles: {cells: 2}
splats: {max_count: 300, refine_frames: 2}
experiment: {per_cell: 2.0, splat_iterations: 3}
"""

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


@contextmanager
def making(domain: int) -> Iterator[Callable[..., Any]]:
    """Makes a node of a class in this process, with parameters as on a command line (`__` for a dot); they end with the context."""
    made: list[Any] = []

    def make(cls: Callable[[], Any], **parameters: object) -> Any:
        words = [w for key, value in parameters.items() for w in ("-p", f"{key.replace('__', '.')}:={value}")]
        rclpy.init(args=["--ros-args", *words], domain_id=domain)
        made.append(cls())
        return made[-1]

    try:
        yield make
    finally:
        for node in made:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def make_node(domain: int) -> Iterator[Callable[..., Any]]:
    with making(domain) as make:
        yield make


@dataclass(frozen=True)
class Resumed:
    """A fit of one fit_node with a bag that was cancelled after an iteration and called again."""

    out: Path
    config: str  # files of settings, as a parameter of any node
    left: list[str]  # names of files in `out` between the two
    iterations: list[str]  # that the second told of
    force_so_far: list[Any]  # messages of both
    run: str  # name of the second
    quality: Any  # that it published
    again: list[tuple[bool, str]]  # what ~/fit answers then: as it is, without the result, with another setting


@pytest.fixture(scope="session")
def resumed(half_sample: Path, domain: int, tmp_path_factory: pytest.TempPathFactory) -> Resumed:
    from rclpy.parameter import Parameter

    from diffphys_ros.nodes.fit_node import FitNode

    from .robot import Robot

    folder = tmp_path_factory.mktemp("resumed")
    few, out = folder / "few.yaml", folder / "out"
    few.write_text(FEW)
    files = f"[{half_sample / 'given.yaml'}, {few}]"
    with making(domain) as make:
        robot = Robot(make(FitNode, bag=half_sample / "clip.mcap", config=files, out=out, resume=True))
        robot.listen("~/progress")
        robot.listen("~/force_so_far")
        robot.listen("~/quality")
        robot.until(lambda: robot.fits(1))
        assert robot.call("cancel").success
        robot.until(lambda: robot.node.state == "cancelled")
        left = sorted(path.name for path in out.iterdir())
        robot.heard["~/progress"].clear()
        assert robot.call("fit").success
        robot.until(lambda: robot.node.state == "done")
        run, iterations = robot.node.run, robot.iterations()
        again = [called(robot)]
        (out / "recovery.npz").rename(out / "elsewhere.npz")
        again.append(called(robot))
        (out / "elsewhere.npz").rename(out / "recovery.npz")
        robot.node.state, robot.node.begun_with = "done", robot.node._given()
        robot.node.set_parameters_atomically([Parameter("scene.thickness_m", value=0.06)])
        again.append(called(robot))
        robot.close()
    return Resumed(out, files, left, iterations, robot.heard["~/force_so_far"], run, robot.heard["~/quality"][-1], again)


def called(robot: Any) -> tuple[bool, str]:
    """What ~/fit answers; a fit that it begins is ended."""
    answer = robot.call("fit")
    if robot.node.worker.busy:
        robot.call("cancel")
        robot.until(lambda: not robot.node.worker.busy)
    return answer.success, answer.message
