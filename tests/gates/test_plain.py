"""The bar painted: without texture and depth its outline tells what its points did."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.bags.write import write_recording
from diffphys_ros.inverse import Prepared
from diffphys_ros.score import net_force, read_truth
from tests.coarse import coarse_elements
from tools.sample_maker.messages import clip_messages

from . import clips


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory, ingested: Callable[[str], Path]) -> Prepared:
    """The bar's clip with parts of one colour each, by colour images alone."""
    folder, source = tmp_path_factory.mktemp("painted"), sample_folder("bar")
    clip = result.load_prepared(ingested("bar")).clip
    frames = clips.painted(clip, source / "truth.npz")
    write_recording(folder / "clip.mcap", clip_messages(clip.camera, frames, clip.depth))
    out = folder / "clip.npz"
    words = ["--scene.first_mask", str(source / "mask0.png"), "--topics.depth", "none", "--out", str(out)]
    with coarse_elements():
        assert main(["ingest", str(folder / "clip.mcap"), "--config", str(source / "given.yaml"), *words]) == 0
    return result.load_prepared(out)


def test_the_stiffness_of_a_painted_bar_is_read_off_its_outline(painted: Prepared) -> None:
    with np.load(sample_folder("bar") / "truth.npz") as truth:
        error = np.log10(painted.start.young / truth["part_E"])
    assert painted.tracks.normals is not None
    assert painted.start.identified.all()
    assert abs(error[0]) < 0.06
    assert (np.abs(error) < 2 * painted.start.log10_young_sd).all()


def test_its_force_is_not_lost_in_what_no_outline_shows(painted: Prepared) -> None:
    true = net_force(read_truth(sample_folder("bar") / "truth.npz"))
    found = painted.body.rotate_to_world(painted.start.force) * painted.body.volume_m3
    true, found = true[: len(found)], found[: len(true)]
    cosine = (true * found).sum() / np.linalg.norm(true) / np.linalg.norm(found)
    assert cosine > 0.99
    assert np.linalg.norm(found - true) < 0.15 * np.linalg.norm(true)
