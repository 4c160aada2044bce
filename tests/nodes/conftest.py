"""Tests of the nodes need rclpy; each run has a ROS domain of its own."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from .domains import claimed
from .processes import FIT_S, Domain

os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

# A few iterations on a coarse grid; a count that is given makes the fit forget the clock.
FEW = """
fit: {iterations: 3}
experiment: {cells: 2, max_splats: 300, per_cell: 2.0, splat_iterations: 6, refine_frames: 2}
"""

FRAMES = 26  # of the half sample; its force ends with frame 10

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
def half_sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As elsewhere, ended as soon as its free motion tells the stiffness: what processes do with a clip is the same."""
    from tests import halved

    return halved.write(tmp_path_factory.mktemp("half_sample"), frames=FRAMES)


@pytest.fixture(scope="session")
def domain() -> Iterator[int]:
    """The ROS domain of the nodes in this process."""
    with claimed() as number:
        yield number


@pytest.fixture
def make_node(domain: int) -> Iterator[Callable[..., Any]]:
    """Makes a node of a class in this process, with other ROS arguments and parameters as on a command line (`__` for a dot)."""
    made: list[Any] = []

    def make(cls: Callable[[], Any], *others: str, **parameters: object) -> Any:
        words = [*others]
        words += [w for key, value in parameters.items() for w in ("-p", f"{key.replace('__', '.')}:={value}")]
        rclpy.init(args=["--ros-args", *words], domain_id=domain)
        made.append(cls())
        return made[-1]

    yield make
    for node in made:
        node.close()
        node.destroy_node()
    rclpy.try_shutdown()


@dataclass(frozen=True)
class Resumed:
    """What became of a fit by a process of fit_node with a bag that was cancelled after an iteration and called again."""

    out: Path
    config: str  # files of settings, as a parameter of any node
    left: list[str]  # names of files in `out` between the two
    iterations: list[str]  # that the second told of
    force_so_far: list[Any]  # messages of both
    run: str  # name of the second
    quality: Any  # that it published
    again: list[tuple[bool, str]]  # what ~/fit answers then: as it is, and without the result
    status: int  # of the process, which was ended while it played


@pytest.fixture(scope="session")
def resumed(half_sample: Path, tmp_path_factory: pytest.TempPathFactory) -> Resumed:
    from .robot import Robot

    folder, context = tmp_path_factory.mktemp("resumed"), rclpy.Context()
    few, out = folder / "few.yaml", folder / "out"
    few.write_text(FEW)
    files = f"[{half_sample / 'given.yaml'}, {few}]"
    with Domain(folder) as domain:
        rclpy.init(context=context, domain_id=int(domain.environment["ROS_DOMAIN_ID"]))
        robot = Robot(context=context)
        robot.listen("~/progress")
        robot.listen("~/force_so_far")
        robot.listen("~/quality")
        domain.node("fit_node", bag=half_sample / "clip.mcap", config=files, out=out, resume=True)
        robot.until(lambda: robot.fits(1), FIT_S)
        assert robot.call("cancel").success
        robot.until(lambda: "cancelled" in robot.stages())
        left = sorted(path.name for path in out.iterdir())
        robot.heard["~/progress"].clear()
        assert robot.call("fit").success
        robot.until(lambda: "done: results in" in domain.said("fit_node"), FIT_S)
        robot.until(lambda: robot.heard["~/quality"])
        iterations, run = robot.iterations(), robot.progress()[-1]["run"]
        again = [robot.call("fit")]
        (out / "recovery.npz").rename(out / "elsewhere.npz")
        again.append(robot.call("fit"))
        assert robot.call("cancel").success
        robot.until(lambda: "cancelled" in robot.stages())
        (out / "elsewhere.npz").rename(out / "recovery.npz")
        robot.close()
        rclpy.try_shutdown(context=context)
        answers = [(each.success, each.message) for each in again]
        return Resumed(out, files, left, iterations, robot.heard["~/force_so_far"], run, robot.heard["~/quality"][-1], answers, domain.end("fit_node", signal.SIGINT))
