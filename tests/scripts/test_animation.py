"""Claims about scripts/animation.py: a small moving picture with the recovered force and stiffness in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

from diffphys_ros import config, result
from diffphys_ros.bags.write import write_recording
from diffphys_ros.colours import stiffness_colours
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip, Recovery
from tests.script import loaded
from tools.sample_maker.messages import clip_messages

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def animation() -> ModuleType:
    return loaded(ROOT / "scripts" / "animation.py")


def test_arrows_point_along_the_force_and_are_gone_without_one(animation: ModuleType, made_recovery: Recovery, made_clip: Clip) -> None:
    tails, heads = animation.arrows(made_recovery, made_clip.camera)
    reach = heads - tails
    assert np.all(reach[3, :, 1] < -3)  # the gust goes up, rows of an image go down
    assert np.all(np.abs(reach[3, :, 0]) < 1)
    assert np.all(reach[[0, 1, *range(6, len(reach))]] == 0)
    assert np.allclose(reach[2, :, 1] / reach[3, :, 1], made_recovery.force[2, 0, 2] / made_recovery.force[3, 0, 2], rtol=0.05)


def test_arrows_ride_on_free_particles_that_the_camera_sees(animation: ModuleType, made_recovery: Recovery, made_clip: Clip) -> None:
    held = animation.carriers(made_recovery, made_clip.camera)
    assert len(set(held.tolist())) == len(held) > 5
    assert not made_recovery.clamped[held].any()
    assert np.all(made_recovery.points[held, 1] == made_recovery.points[:, 1].min())  # the camera looks along y


def test_particles_have_the_colours_of_the_other_figures_and_grey_where_unknown(animation: ModuleType, made_recovery: Recovery, made_clip: Clip) -> None:
    known = animation.drawing(made_recovery, made_clip)
    known.show(3)
    shown = {tuple(colour) for colour in (known.particles.get_facecolor()[:, :3] * 255).round().astype(int).tolist()}
    assert shown == {tuple(colour) for colour in stiffness_colours(made_recovery.young).tolist()}
    unknown = animation.drawing(replace(made_recovery, identified=np.array([True, False])), made_clip)
    unknown.show(3)
    assert (150, 150, 150) in {tuple(colour) for colour in (unknown.particles.get_facecolor()[:, :3] * 255).round().astype(int).tolist()}


def test_another_clip_than_that_of_the_result_is_refused(animation: ModuleType, made_recovery: Recovery, made_clip: Clip) -> None:
    with pytest.raises(InputError, match="name the clip that the result came from"):
        animation.drawing(made_recovery, replace(made_clip, frames=made_clip.frames[:-1]))


def test_a_result_and_its_recording_become_a_small_picture_with_every_frame(animation: ModuleType, made_recovery: Recovery, made_clip: Clip, tmp_path: Path) -> None:
    clip = replace(made_clip, depth=np.full(made_clip.frames.shape[:3], 0.5, np.float32))
    write_recording(tmp_path / "clip.mcap", clip_messages(clip.camera, clip.frames, clip.depth))
    (tmp_path / "result").mkdir()
    result.save(made_recovery, clip, config.Settings(), tmp_path / "result")
    assert animation.main([str(tmp_path / "result"), str(tmp_path / "clip.mcap"), "--out", str(tmp_path / "out.gif")]) == 0
    with Image.open(tmp_path / "out.gif") as picture:
        assert picture.n_frames == len(clip)
        assert picture.info["loop"] == 0


def test_the_pictures_of_the_documents_are_small() -> None:
    for name in ("animation.gif", "animation_parts.gif"):
        assert (ROOT / "docs" / "figures" / name).stat().st_size < 1.5e6
