"""A clip that begins in the middle of a swing, out of the picture too: what is built is not the shape of its first frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.write import write_recording
from diffphys_ros.inverse import Prepared
from tests.coarse import coarse_elements
from tools.sample_maker.messages import clip_messages

from .conftest import folder_of

BEGINS = 8  # frame: the push is over, the bar at the end of its way


@pytest.fixture(scope="module")
def begun_late(tmp_path_factory: pytest.TempPathFactory, ingested: Callable[[str], Path]) -> Prepared:
    """The flat bar from BEGINS on, of which nobody tells that it rests."""
    folder, clip = tmp_path_factory.mktemp("late"), result.load_prepared(ingested("flat")).clip
    late = clip.part(BEGINS, len(clip))
    write_recording(folder / "clip.mcap", clip_messages(late.camera, late.frames, late.depth))
    words = ["--scene.first_mask", "null", "--scene.at_rest", "false", "--out", str(folder / "clip.npz")]
    with coarse_elements():
        assert main(["ingest", str(folder / "clip.mcap"), "--config", str(folder_of("flat") / "given.yaml"), *words]) == 0
    return result.load_prepared(folder / "clip.npz")


def test_the_stiffness_is_not_that_of_a_body_bent_out_of_the_picture(begun_late: Prepared) -> None:
    with np.load(folder_of("flat") / "truth.npz") as truth:
        error = np.log10(begun_late.start.young / truth["part_E"])
    assert abs(error[0]) < 0.15
    assert abs(error[0]) < 2 * begun_late.start.log10_young_sd[0]
