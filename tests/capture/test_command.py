"""Claims about `diffphys capture`, and about recovering from what it wrote."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.__main__ import main
from diffphys_ros.bags.read import read_clip
from diffphys_ros.body import build_body
from diffphys_ros.capture import load
from diffphys_ros.config import build
from diffphys_ros.depth import registered, surface_depth
from diffphys_ros.segment import label_clip

from . import room
from .conftest import Made

FLAGS = ["--topics.mask", "/mask", "--capture.max_gaussians", "0", "--capture.lens", "pinhole"]


def test_the_command_writes_a_capture_and_says_where(made: Made, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(made.out / "sfm", tmp_path / "out.part" / "sfm")
    assert main(["capture", str(made.images), "--clip", str(made.clip), "--out", str(tmp_path / "out"), *FLAGS]) == 0
    assert f"capture in {tmp_path / 'out'}" in capfd.readouterr().out
    assert len(load(tmp_path / "out").names) == 10


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{tmp}/none", "--out", "{tmp}/out"], "no such file or folder"),
        (["{images}", "--clip", "{tmp}/none.mcap", "--out", "{tmp}/out"], "no such file or folder"),
        (["{images}", "--out", "/proc/none/out"], "choose a folder that can be written"),
        (["{images}", "--out", "{tmp}/out", "--capture.lens", "fisheye"], "must be one of opencv, pinhole"),
        (["{images}", "--clip", "{clip}", "--out", "{tmp}/out", "--topics.mask", "/mask", "--capture.max_side_px", "200", "--capture.same_camera", "true"], "the pictures have 200x150 px"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(words: list[str], said: str, made: Made, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    places = {"tmp": tmp_path, "images": made.images, "clip": made.clip}
    assert main(["capture", *(w.format(**places) for w in words)]) == 2
    error = capfd.readouterr().err.strip().splitlines()[-1]
    assert said in error
    assert not (tmp_path / "out").exists()


def test_a_video_without_depth_gets_the_bodys_place_and_size_from_the_capture(made: Made) -> None:
    """The box is 0.2 x 0.08 m as seen along y, 0.06 m deep; the thickness is told."""
    known = {"topics.depth": "none", "topics.mask": "/mask", "depth.capture": str(made.out), "scene.thickness_m": 0.06, "scene.thickness_axis": [0.0, 1.0, 0.0]}
    settings = build(known)
    clip = registered(read_clip(made.clip, settings), settings)
    clip = clip.with_labels(label_clip(clip, settings))
    depth, source = surface_depth(clip, settings)
    body = build_body(clip, depth, settings)
    assert source.scale.startswith("depth topic")
    assert body.volume_m3 == pytest.approx(0.2 * 0.08 * 0.06, rel=0.1)
    assert np.allclose(body.world_from_body[:3, 3][1], 0.0, atol=0.004)
    assert room.HIGH[2] == 0.08
