"""Recordings that are not what they are taken for are doubted, and the bundled ones are not."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.inverse import Prepared
from tests.coarse import coarse_elements

from . import clips

PAGE = Path(__file__).parents[2] / "docs" / "film_a_clip.md"


@pytest.fixture
def prepared(tmp_path: Path, half_sample: Path) -> Callable[..., Prepared]:
    """The bar's clip, changed, as the start of a fit; at half its size where no `source` is given."""

    def prepare(change: Callable, *flags: str, source: Path = half_sample) -> Prepared:
        folder, out = clips.changed(source, tmp_path, change), tmp_path / "clip.npz"
        with coarse_elements():
            assert main(["ingest", str(folder / "clip.mcap"), "--config", str(folder / "given.yaml"), "--out", str(out), *flags]) == 0
        return result.load_prepared(out)

    return prepare


@pytest.mark.parametrize("kind", ["bar", "strip", "flat"])
def test_a_sound_clip_is_not_doubted(kind: str, ingested: Callable[[str], Path]) -> None:
    found = result.load_prepared(ingested(kind))
    assert found.doubts == ()
    assert found.start.identified.all()


def test_a_camera_that_turns_slowly_is_taken_off(prepared: Callable[..., Prepared]) -> None:
    found = prepared(clips.panned, "--frames.fit", "24", source=sample_folder("bar"))
    with np.load(sample_folder("bar") / "truth.npz") as truth:
        error = np.log10(found.start.young / truth["part_E"])
    assert found.doubts == ()
    assert any("the camera moves" in note for note in found.clip.notes)
    assert np.abs(error).max() < 0.06


def test_a_camera_that_turns_far_is_noticed(prepared: Callable[..., Prepared]) -> None:
    (doubt,) = prepared(partial(clips.panned, px=4 * clips.PAN_PX), "--frames.fit", "16", source=sample_folder("bar")).doubts
    assert doubt.of_young
    assert "the camera moves" in doubt.text


def test_frames_cut_out_under_continuous_stamps_are_noticed_though_the_stiffness_is_right(prepared: Callable[..., Prepared]) -> None:
    found = prepared(clips.cut)
    (doubt,) = found.doubts
    assert f"between frames {clips.CUT.start - 1} and {clips.CUT.start}" in doubt.text
    assert not doubt.of_young
    assert found.start.identified.all()


def test_a_camera_that_hangs_loses_those_frames_and_nothing_else(prepared: Callable[..., Prepared]) -> None:
    found = prepared(clips.stuck)
    assert np.flatnonzero(~found.clip.seen).tolist() == list(range(clips.STUCK.start, clips.STUCK.stop))
    assert found.doubts == ()
    assert any("once more" in note for note in found.clip.notes)


def test_a_gravity_that_is_not_there_leaves_no_stiffness(prepared: Callable[..., Prepared]) -> None:
    found = prepared(lambda clip: (clip.frames, clip.depth), "--scene.gravity_m_s2", "[0, 0, -100]")
    assert not found.start.identified.any()
    assert "scene.gravity_m_s2" in found.start.reasons[0]


def test_the_page_shows_the_first_answer_that_the_bar_has(ingested: Callable[[str], Path]) -> None:
    shown = re.findall(r"([\d.e+]+) Pa \(x/ ([\d.]+)\)", PAGE.read_text())
    start = result.load_prepared(ingested("bar")).start
    np.testing.assert_allclose(np.array(shown, float), np.stack([start.young, 10**start.log10_young_sd], 1), rtol=0.02)
