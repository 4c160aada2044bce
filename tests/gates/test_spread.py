"""The stated spread of the stiffness, from both sides, against what a person can work out of what was told about the clip.

Thickness and mass are told exactly. The outline is known to a tenth of a pixel: E goes with its width to the -2 and its length to the 4. Of two
parts only the common mass is told, so that solids of unlike density would swing alike. And a modulus found on three cells over the
thickness scatters from grid to grid.
"""

from __future__ import annotations

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from diffphys_ros import result
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.msg_schemas import clouds

from .conftest import Answer, Recover

OUTLINE_PX = 0.1  # as parts at the clamp tell that were not chosen (docs/measurements/choices.md)
GRIDS = 0.02  # of log10 E (docs/measurements/accuracy.md)
DENSITY = 0.5  # of ln(density), between the parts of one object
LEAST, MOST = 1 / 1.6, 1.2  # factors: half and twice the spread lie beyond


@pytest.mark.parametrize("kind", ["strip", "bar"])
def test_the_stated_spread_is_what_the_knowledge_of_the_clip_leaves(kind: str, recovered: Recover) -> None:
    answer, expected = recovered(kind), expected_sd(kind)
    for stated in (answer.recovery.log10_young_sd, published_sd(answer)):
        assert stated.min() > LEAST * expected
        assert stated.max() < MOST * expected


@pytest.mark.parametrize("kind", ["strip", "bar"])
def test_the_error_lies_within_two_stated_spreads(kind: str, recovered: Recover) -> None:
    answer = recovered(kind)
    for part, error in enumerate(answer.log10_young_error, 1):
        assert abs(error) < 2 * answer.recovery.log10_young_sd[answer.recovery.part == part].max()


def expected_sd(kind: str) -> float:
    """Standard deviation of log10 E."""
    truth = np.load(sample_folder(kind) / "truth.npz")
    pose, vertices = truth["T_world_cam"], truth["rest_vertices"]
    pixel = ((vertices.mean(0) - pose[:3, 3]) @ pose[:3, 2]) / truth["camera_K"][0, 0]
    _, width, length = np.sort(np.ptp(vertices, axis=0))
    outline = OUTLINE_PX * pixel * np.hypot(2 / width, 4 / length)
    return float(np.hypot(GRIDS, np.hypot(outline, densities(truth)) / np.log(10)))


def densities(truth: np.lib.npyio.NpzFile) -> float:
    """Standard deviation of ln E by densities of which the common mass is told: as far as the parts share in the swing of a cantilever
    (a deflection like the 1.86th power of the distance, Rayleigh) otherwise than in the mass."""
    if len(truth["part_E"]) == 1:
        return 0.0
    part, mass = truth["vertex_part"], truth["vertex_mass"]
    away = np.linalg.norm(truth["rest_vertices"] - truth["rest_vertices"][truth["clamped"]].mean(0), axis=1)
    swing, weight = (np.bincount(part, w) / w.sum() for w in (mass * away**3.72, mass))
    along = weight / np.linalg.norm(weight)
    return DENSITY * float(np.linalg.norm(swing - (swing @ along) * along))


def published_sd(answer: Answer) -> np.ndarray:
    """On the particles of ~/material_field."""
    messages = read_ros2_messages(answer.folder / result.RECORDING)
    (cloud,) = (m.ros_msg for m in messages if m.channel.topic.endswith("material_field"))
    return clouds.unpack(cloud)["log10_young_sd"].ravel()
