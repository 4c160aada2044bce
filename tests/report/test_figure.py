"""Claims about the summary figure."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.types import TOLD, Clip, Recovery

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import StepPatch
from matplotlib.text import Text

from diffphys_ros.colours import COMPONENTS, pascals, ramp, stiffness_colours
from diffphys_ros.report import figure


def has_colour(image: np.ndarray, colour: str) -> bool:
    rgb = np.frombuffer(bytes.fromhex(colour[1:]), np.uint8) / 255.0
    return bool((np.abs(image[..., :3] - rgb).max(-1) < 0.02).sum() > 50)


def test_the_figure_shows_input_and_force(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    image = imread(figure.summary(tmp_path / "a.png", made_recovery, made_clip))
    assert image.shape[1] == 1430
    assert has_colour(image, "#3c5ac8")  # the blue part of the input frames
    assert has_colour(image, COMPONENTS[2])  # the gust acts along z


def test_equal_results_give_equal_figures(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    first, second = (figure.summary(tmp_path / name, made_recovery, made_clip).read_bytes() for name in ("a.png", "b.png"))
    assert first == second


def test_a_truth_is_written_beside_the_stiffness_and_drawn_over_the_force(made_recovery: Recovery, made_clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: shown.append(self))
    truth = figure.Truth([8.2e4, 1.9e4], 1.1 * made_recovery.net_force())
    for given in (None, truth):
        figure.summary("nowhere.png", made_recovery, made_clip, truth=given)
    plain, compared = ([text.get_text() for text in drawn.findobj(Text)] for drawn in shown)
    assert not any("tru" in text for text in plain)
    assert any("true 82 kPa, -2.4 %" in text and "true 19 kPa, +5.3 %" in text for text in compared)
    dashed = [patch.get_data().values for patch in shown[1].findobj(StepPatch) if patch.get_linestyle() not in ("-", "solid")]
    np.testing.assert_allclose(np.transpose(dashed), truth.net_force, atol=1e-12)


def test_a_recovery_without_renders_still_has_a_figure(tmp_path: Path, made_recovery: Recovery, made_clip: Clip) -> None:
    bare = dataclasses.replace(made_recovery, frames=None, force=0 * made_recovery.force, identified=np.array([False, False]))
    full = imread(figure.summary(tmp_path / "a.png", made_recovery, made_clip))
    assert len(imread(figure.summary(tmp_path / "b.png", bare, made_clip))) < len(full)


def test_a_force_that_is_not_known_is_no_headline(made_recovery: Recovery) -> None:
    assert "force not identified" in figure._headline(made_recovery, TOLD)
    assert "peak net force" in figure._headline(dataclasses.replace(made_recovery, force_identified=True), TOLD)


@pytest.mark.parametrize(
    ("density", "length", "said"),
    [
        ("assumed: 1000 kg/m^3", "depth topic", ("E/density = 160 m^2/s^2, 40 m^2/s^2", "net force over mass [m/s^2]", "nobody told a mass or a density")),
        ("mass_kg over the filled volume", "unknown: the object is assumed 1 m away", ("E over the largest = 1, 0.25", "net force over its peak", "nobody told a length")),
    ],
)
def test_the_figure_has_no_pascals_and_newtons_where_mass_or_size_are_assumed(
    made_recovery: Recovery, made_clip: Clip, monkeypatch: pytest.MonkeyPatch, density: str, length: str, said: tuple[str, ...]
) -> None:
    shown: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: shown.append(self))
    untold = dataclasses.replace(made_recovery, force_identified=True, metrics={"density_source": density, "metric_scale_source": length})
    figure.summary("nowhere.png", untold, made_clip)
    figure.summary("nowhere.png", untold, made_clip, scale=TOLD)
    words, allowed = (" | ".join(text.get_text() for text in drawn.findobj(Text)) for drawn in shown)
    assert all(each in words for each in said)
    assert not any(each in words for each in ("Pa", " N ", "[N]"))
    assert "80 kPa" in allowed
    assert "[N]" in allowed


def test_shown_frames_are_those_that_moved_most(made_recovery: Recovery) -> None:
    shown = figure.shown_frames(made_recovery, 4)
    motion = np.abs(made_recovery.trajectory - made_recovery.trajectory[0]).max((1, 2))
    assert shown[0] == 0
    assert shown == sorted(set(shown))
    assert motion[shown[1:]].max() == motion.max()


def test_one_stiffness_has_one_colour_and_the_unknown_is_grey() -> None:
    soft, stiff, unknown = stiffness_colours(np.array([1e4, 1e6, np.nan]))
    assert soft.sum() < stiff.sum()
    assert len(set(unknown.tolist())) == 1
    np.testing.assert_array_equal(*stiffness_colours(np.array([5e4, 5e4])))
    assert ramp(np.linspace(0, 1, 5)).dtype == np.uint8


@pytest.mark.parametrize(("value", "words"), [(83_210.0, "83.2 kPa"), (1.8e6, "1.8 MPa"), (7.0, "7 Pa"), (np.nan, "not identified")])
def test_stiffness_is_told_in_a_fitting_unit(value: float, words: str) -> None:
    assert pascals(value) == words
