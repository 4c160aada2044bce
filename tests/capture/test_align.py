"""Claims about similarities and scales."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from diffphys_ros.capture.align import onto_camera, onto_positions, read_positions, scale_of
from diffphys_ros.capture.structure import Placed, Structure
from diffphys_ros.capture.views import moved
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera

SIMILARITY = np.eye(4)
SIMILARITY[:3, :3] = 0.37 * Rotation.from_rotvec([0.4, -1.1, 0.3]).as_matrix()
SIMILARITY[:3, 3] = [1.0, -2.0, 0.5]


def through(similarity: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ similarity[:3, :3].T + similarity[:3, 3]


def camera(position: np.ndarray, turn: np.ndarray) -> Camera:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), position
    return Camera(np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]]), pose, 320, 240)


def structure_of(positions: np.ndarray) -> Structure:
    nothing = np.zeros(0, int)
    placed = tuple(Placed(f"p{k}.png", camera(p, np.zeros(3)), np.zeros(4), nothing, np.zeros((0, 2))) for k, p in enumerate(positions))
    return Structure(placed, np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0), 0.0, ())


def test_a_camera_and_a_scale_fix_the_similarity() -> None:
    found = camera(np.array([0.3, 0.1, -2.0]), np.array([0.2, 0.9, -0.4]))
    known = moved(found, SIMILARITY)
    assert np.allclose(onto_camera(found, known, 0.37), SIMILARITY)


def test_a_camera_sees_the_same_after_the_world_is_moved() -> None:
    before = camera(np.array([0.3, 0.1, -2.0]), np.array([0.1, 0.2, 0.0]))
    points = np.random.default_rng(2).normal(size=(30, 3))
    pixels, depth = before.project(points)
    again, deeper = moved(before, SIMILARITY).project(through(SIMILARITY, points))
    assert np.allclose(again, pixels)
    assert np.allclose(deeper, 0.37 * depth)


def test_the_scale_is_the_median_and_comes_with_the_spread_of_the_depths() -> None:
    rng = np.random.default_rng(3)
    depth = rng.uniform(3, 9, 400)
    metres = 0.2 * depth * np.exp(0.01 * rng.normal(size=400))
    metres[:40] *= 2  # the topic sees something else there
    metres[40:60] = 0  # unknown
    scale, spread = scale_of(metres, depth)
    assert scale == pytest.approx(0.2, rel=0.005)
    assert spread == pytest.approx(0.011, rel=0.2)


def test_few_depths_are_refused() -> None:
    with pytest.raises(InputError, match="3 points of frame 0 have a depth"):
        scale_of(np.array([1.0, 1, 1, 0]), np.ones(4))


def test_positions_in_a_line_or_too_few_are_refused() -> None:
    line = np.outer(np.arange(5.0), [1, 2, 3])
    at = {f"p{k}": p for k, p in enumerate(line)}
    with pytest.raises(InputError, match="in one line"):
        onto_positions(structure_of(line), at, "at.txt")
    with pytest.raises(InputError, match="names 2 of the pictures"):
        onto_positions(structure_of(line), {"p0": line[0], "p1": line[1], "other": line[2]}, "at.txt")


def test_a_picture_that_stands_twice_is_refused_and_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "at.txt").write_text("a.png 1 2 3\n# none\nb.png 0 0 1\na.jpg 1 2 4\n")
    with pytest.raises(InputError, match="line 4: 'a' stands twice"):
        read_positions(tmp_path / "at.txt")
    os.mkfifo(tmp_path / "pipe.txt")
    with pytest.raises(InputError, match="is no regular file"):
        read_positions(tmp_path / "pipe.txt")


@pytest.mark.parametrize("text", ["a 1 2", "a 1 2 x", "a 1 2 3 4", "a 1 2 nan", "a 1 2 1e300", "a 1 2 3\nb"])
def test_lines_that_are_no_positions_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "at.txt").write_text(text)
    with pytest.raises(InputError, match="x y z in metres"):
        read_positions(tmp_path / "at.txt")
    with pytest.raises(InputError, match="readable file"):
        read_positions(tmp_path / "none.txt")
