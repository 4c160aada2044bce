"""What several rooms' tests share: a small made-up recovery with the clip it belongs to."""

from __future__ import annotations

import gc
import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.types import Camera, Clip, Grid, MpmProblem, Recovery

FRAMES, HEIGHT, WIDTH, PERIOD_S = 12, 48, 64, 1 / 30
SPACING = 0.01  # m

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # a hundred processes of the tests would each compile the whole package

TESTS = Path(__file__).parent
SLOW = ("capture", "gates", "inverse", "nodes", "predict", "resimulate")  # folders of whole recoveries, whole captures and nodes: left out of `make check`
QUICK = "not slow and not faults"  # the marks of `make check`
FAULTS, MARKED = "faults", "pytest.mark.faults"  # the marks of `make faults`, and what a file of such tests says
LONGEST_NAME = 200  # letters of a parameter
SLOW_TIMEOUT_S = 600.0  # their waits end well before


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Folders and files of which every test would be left out are not even read: what they import takes seconds in every process."""
    if config.option.markexpr == FAULTS and collection_path.suffix == ".py":
        return None if _says_faults(collection_path) else True
    inside = collection_path.is_relative_to(TESTS) and collection_path.relative_to(TESTS).parts[:1]
    return True if inside and inside[0] in SLOW and config.option.markexpr == QUICK else None


@cache
def _says_faults(path: Path) -> bool:
    return MARKED in path.read_text(encoding="utf-8")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.is_relative_to(TESTS) and item.path.relative_to(TESTS).parts[0] in SLOW:
            item.add_marker("slow")
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.timeout(SLOW_TIMEOUT_S))
        if item.get_closest_marker(FAULTS) and not _says_faults(item.path):
            raise pytest.UsageError(f"{item.nodeid} has the mark {FAULTS} and its file does not say {MARKED}: `make faults` would not read it")
    if hasattr(config, "workerinput"):  # of several processes
        from tests.shared_out import rank

        items.sort(key=lambda item: rank(item.nodeid, item.get_closest_marker("slow") is not None))


def pytest_make_parametrize_id(val: object) -> str | None:
    """Of a hostile text of many thousand letters, how it begins and its length: a name of that size fills a whole log."""
    return f"{val[:20]}..{len(val)}" if isinstance(val, str) and len(val) > LONGEST_NAME else None


def pytest_collection_finish() -> None:
    """What is imported by now stays. A node collects its garbage after every clip: it need not look through all that the tests import."""
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    if config.getvalue("dist") != "loadfile":
        return None
    from tests.shared_out import ByGroup

    return ByGroup(config, log)


@pytest.fixture(scope="session")
def scenes() -> Path:
    """Folder of truth scenes, named by DIFFPHYS_SCENES."""
    folder = os.environ.get("DIFFPHYS_SCENES")
    if not folder or not Path(folder).is_dir():
        pytest.skip("DIFFPHYS_SCENES names no folder of truth scenes")
    return Path(folder)


@pytest.fixture(scope="session")
def half_sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the bundled sample at half its size."""
    from tests import halved  # late: the solver's tests need no OpenCV

    return halved.write(tmp_path_factory.mktemp("half_sample"))


@pytest.fixture
def made_clip() -> Clip:
    return make_clip()


@pytest.fixture
def made_recovery(made_clip: Clip) -> Recovery:
    return make_recovery(made_clip)


def make_clip() -> Clip:
    """A block that slides to the right over a plain background, seen from 0.5 m in front."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # camera looks along world y
    pose[:3, 3] = [0.05, -0.5, 0.01]
    camera = Camera(np.array([[120.0, 0, 31.5], [0, 120.0, 23.5], [0, 0, 1]]), pose, WIDTH, HEIGHT, "camera_optical", "world")
    frames = np.full((FRAMES, HEIGHT, WIDTH, 3), 90, np.uint8)
    labels = np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8)
    for k in range(FRAMES):
        left = 20 + round(3 * _swing(k))
        frames[k, 18:30, left : left + 12], labels[k, 18:30, left : left + 12] = (60, 90, 200), 1
        frames[k, 18:30, left + 12 : left + 24], labels[k, 18:30, left + 12 : left + 24] = (220, 180, 60), 2
    frames[:, 0, 0, 0] = np.arange(FRAMES)  # no two pictures of a real camera are equal
    return Clip(frames, 1_700_000_000_000_000_000, PERIOD_S, camera, labels=labels, source="made up")


def make_recovery(made_clip: Clip) -> Recovery:
    """A beam of two parts, held at x = 0, under a uniform gust along z in frames 2 to 5."""
    points = np.stack(np.meshgrid(np.arange(10) + 0.5, np.arange(2) + 0.5, np.arange(2) + 0.5, indexing="ij"), -1).reshape(-1, 3) * SPACING
    count, part = len(points), np.where(points[:, 0] < 0.05, 1, 2)
    swing = np.array([_swing(k) for k in range(FRAMES)])
    motion = np.zeros((FRAMES, count, 3))
    motion[..., 2] = 0.02 * swing[:, None] * (points[:, 0] / 0.1) ** 2
    force = np.zeros((FRAMES, count, 3), np.float32)
    force[2:6, :, 2] = 400 * np.sin(np.pi * (np.arange(4) + 0.5) / 4)[:, None]
    young = np.where(part == 1, 8e4, 2e4)
    return Recovery(
        points=points,
        volume=np.full(count, SPACING**3),
        part=part,
        young=young,
        log10_young_sd=np.where(part == 1, 0.02, 0.03),
        poisson=np.full(count, 0.3),
        density=np.full(count, 500.0),
        poisson_sd=np.full(count, 0.1),
        density_sd=np.zeros(count),
        young_lower=np.where(part == 1, np.nan, 1e4),
        log10_specific_sd=np.where(part == 1, 0.02, 0.03),
        force=force,
        net_force_sd=np.where(np.abs(force).max((1, 2))[:, None] > 0, (0.002, 0.003, 0.004), 0.0),
        net_force_peak=0.0145,
        net_force_peak_sd=0.0012,
        trajectory=(points + motion).astype(np.float32),
        clamped=points[:, 0] < SPACING,
        frames=made_clip.frames,
        world_from_body=np.eye(4),
        gravity=np.zeros(3),
        simulation=_problem(points, young / 0.96),
        apparent_stiffness=0.96,
        grid=Grid(np.array([-0.03, -0.03, -0.03]), SPACING, (16, 8, 8), 3),
        period_s=PERIOD_S,
        substeps=40,
        damping=Damping(0.2, 1e-3),
        initial_velocity=np.zeros((count, 3)),
        identified=np.array([True, True]),
        reasons=("seen in two frequencies", "seen in two frequencies"),
        metrics={"psnr_masked": 31.0, "loss": [1.0, float("nan")], "density_source": "mass_kg over the filled volume", "metric_scale_source": "depth topic"},
        notes=("density assumed",),
    )


def _problem(points: np.ndarray, young: np.ndarray) -> MpmProblem:
    """The beam at rest, no ghost behind it and no mode damped."""
    count = len(points)
    return MpmProblem(
        ghost=np.zeros(count, bool),
        rest=points,
        volume=np.full(count, SPACING**3),
        density=np.full(count, 500.0),
        young=young.astype(np.float32),
        poisson=np.full(count, 0.3, np.float32),
        position=points.astype(np.float32),
        velocity=np.zeros((count, 3), np.float32),
        velocity_gradient=np.zeros((count, 3, 3), np.float32),
        deformation_gradient=np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
        force=np.zeros((FRAMES, 3), np.float32),
        force_weight=np.ones(count, np.float32),
        damping_shapes=np.zeros((count, 3, 0), np.float32),
        damping_gradients=np.zeros((count, 3, 3, 0), np.float32),
        damping_frequencies=np.zeros(0, np.float32),
        law="neo_hookean",
        plane_normal=np.zeros((0, 3)),
        plane_offset=np.zeros(0),
        plane_friction=np.zeros(0),
        plane_kind=np.zeros(0, "U8"),
    )


def _swing(frame: int) -> float:
    return float(np.sin(2 * np.pi * 3.0 * frame * PERIOD_S))
