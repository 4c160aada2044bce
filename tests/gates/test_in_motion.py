"""A clip that begins in the middle of a swing, out of the picture too: what is built is not the shape of its first frame, and the answer is of that frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.write import write_recording
from tests.coarse import coarse_elements
from tools.sample_maker.messages import clip_messages

from .conftest import SHORT, Answer, folder_of, scored, solved

BEGINS = 8  # frame: the push is over, the bar at the end of its way
TOLD = ("--scene.mass_kg", "null", "--scene.density_kg_m3", "[950]", "--segment.max_parts", "1")  # E itself
UNTOLD = ("--scene.first_mask", "null", "--scene.at_rest", "false")
SHARP = {"--experiment.splat_iterations": "60", "--experiment.max_splats": "1200", "--fit.iterations": "2"}  # pictures that tell where Gaussians are bound
FREE_END = 0.93  # quantile of the way from the clamp beyond which points are of it


@pytest.fixture(scope="module")
def begun_late(tmp_path_factory: pytest.TempPathFactory, ingested: Callable[[str], Path]) -> Path:
    """The clip.npz of the flat bar from BEGINS on, of which nobody tells that it rests; its truth beside it."""
    folder, clip = tmp_path_factory.mktemp("late"), result.load_prepared(ingested("flat")).clip
    late = clip.part(BEGINS, len(clip))
    write_recording(folder / "clip.mcap", clip_messages(late.camera, late.frames, late.depth))
    with coarse_elements():
        assert main(["ingest", str(folder / "clip.mcap"), "--config", str(folder_of("flat") / "given.yaml"), *TOLD, *UNTOLD, "--out", str(folder / "clip.npz")]) == 0
    with np.load(folder_of("flat") / "truth.npz") as truth:
        np.savez(folder / "truth.npz", **{name: values[BEGINS:] if values.shape[:1] == (len(clip),) else values for name, values in truth.items()})
    return folder / "clip.npz"


@pytest.fixture(scope="module")
def answer(begun_late: Path, tmp_path_factory: pytest.TempPathFactory) -> Answer:
    words = dict(zip(SHORT[::2], SHORT[1::2], strict=True)) | SHARP
    out = tmp_path_factory.mktemp("answer")
    solved(begun_late, out, *(word for pair in words.items() for word in pair))
    return scored(out, begun_late.with_name("truth.npz"))


def test_the_stiffness_is_not_that_of_a_body_bent_out_of_the_picture(answer: Answer) -> None:
    (error,), (spread,) = answer.log10_young_error, answer.metrics["young_log10_sd"]
    assert abs(error) < 0.025
    assert abs(error) < 2 * spread < 0.04


def test_the_answer_begins_where_the_clip_does(answer: Answer, begun_late: Path) -> None:
    with np.load(begun_late.with_name("truth.npz")) as truth:
        way, there = truth["rest_vertices"][:, 0], truth["positions"][0]
    expected = there[way > np.quantile(way, FREE_END)].mean(0)
    begun = answer.recovery.trajectory[0]
    way = np.linalg.norm(begun - begun[answer.recovery.clamped].mean(0), axis=1)
    assert np.linalg.norm(expected - [way.max(), 0, 0]) > 0.05  # bent
    assert np.linalg.norm(begun[way > np.quantile(way, FREE_END)].mean(0) - expected) < 0.025
    assert answer.trajectory_error < 0.08


def test_the_simulation_begins_there_too(answer: Answer) -> None:
    """Its motion, whichever is the answer, misses the tracks by less than a tenth of theirs."""
    assert answer.metrics["track_rms_refined_m"] < 1.3e-3


def test_the_pictures_are_of_gaussians_that_move_with_the_places_where_they_were_seen(answer: Answer) -> None:
    assert answer.metrics["psnr_masked"] > 23
