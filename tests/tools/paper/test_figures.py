"""make paper: figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from matplotlib.quiver import Quiver

from diffphys_ros.types import Clip, Recovery
from tools.paper import figures
from tools.paper.pictures import moving


def test_arrows_point_where_the_force_pushes_in_the_picture(made_recovery: Recovery, made_clip: Clip) -> None:
    arrows = figures.force(made_recovery, made_clip).findobj(Quiver)
    strongest = max(arrows, key=lambda each: float(np.hypot(each.U, each.V).max()))
    tail = made_recovery.points.mean(0)
    push = np.linalg.norm(made_recovery.force, axis=2).sum(1).argmax()
    (a, _), (b, _) = made_clip.camera.project(tail[None]), made_clip.camera.project((tail + 1e-3 * made_recovery.force[push].mean(0) / np.abs(made_recovery.force[push]).max())[None])
    mean = np.array([strongest.U.mean(), strongest.V.mean()])
    assert mean @ (b - a)[0] > 0.95 * np.linalg.norm(mean) * np.linalg.norm(b - a)


def test_forces_are_shown_in_frames_in_which_they_act() -> None:
    force = np.zeros((40, 5, 3))
    force[6:19, :, 1] = 1e3
    force[30] = 1.0  # next to nothing
    np.testing.assert_array_equal(figures.acting(force), [6, 10, 14, 18])
    np.testing.assert_array_equal(figures.acting(0 * force), [0, 13, 26, 39])
    force[8:] = 0  # two frames alone
    np.testing.assert_array_equal(figures.acting(force), [5, 6, 7, 8])
    np.testing.assert_array_equal(figures.acting(force[:8]), [4, 5, 6, 7])


def test_the_slice_is_taken_where_most_pixels_move(made_clip: Clip) -> None:
    frame, video, ours, difference = figures.slices(made_clip.frames, made_clip.frames).findobj(AxesImage)
    moved = moving(made_clip.frames).sum(1)
    rows = [k for k in range(made_clip.frames.shape[1]) if np.array_equal(video.get_array(), made_clip.frames[:, k])]
    assert moved[rows].max() == moved.max() > 0
    assert np.array_equal(video.get_array(), ours.get_array())
    assert not np.any(difference.get_array())
    assert np.array_equal(frame.get_array(), made_clip.frames[0])


def test_every_part_has_a_box_about_its_own_particles(made_recovery: Recovery, made_clip: Clip) -> None:
    boxes = [patch for patch in figures.parts(made_recovery, made_clip).findobj(Rectangle) if patch.get_linewidth() and not patch.get_fill()]
    pixels = made_clip.camera.project(made_recovery.points)[0]
    assert len(boxes) == len(made_recovery.reasons)
    for number, box in enumerate(boxes, 1):
        here = pixels[made_recovery.part == number]
        np.testing.assert_allclose([*box.get_xy(), box.get_width(), box.get_height()], [*here.min(0), *np.ptp(here, axis=0)])


@pytest.mark.slow
def test_the_page_shows_the_figures_of_every_run(made_recovery: Recovery, made_clip: Clip, tmp_path: Path) -> None:
    for run in ("sample, paper", "sample, default"):
        figures.draw_all(tmp_path / run, made_recovery, made_clip)
    titles = [title for title, *_ in figures.drawn(tmp_path)]
    assert titles[:2] == ["Figures 1 and 3. Force: sample, default", "Figures 1 and 3. Force: sample, paper"]
    assert len(titles) == 2 * (4 if made_recovery.frames is not None else 3)
