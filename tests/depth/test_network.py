"""Depth networks in the files that transformers writes, with random weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.depth import surface_depth
from diffphys_ros.depth.network import predict
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip
from tests.boxes import bar, bar_settings, box_clip, oblique_camera

checkpoints = pytest.importorskip("tests.checkpoints", reason="transformers is not installed; pip install '.[models]'")
pytestmark = pytest.mark.slow  # imports transformers


@pytest.fixture(scope="module")
def clip() -> Clip:
    return replace(box_clip(bar(), [np.eye(4)], oblique_camera()), depth=None)


@pytest.fixture(scope="module", params=["dpt", "depth_anything"])
def relative(request, tmp_path_factory) -> str:
    folder = tmp_path_factory.mktemp(request.param)
    return checkpoints.dpt(folder) if request.param == "dpt" else checkpoints.depth_anything(folder, metric=False)


def test_a_prediction_is_that_of_the_libraries_own_pipeline(relative: str, clip: Clip) -> None:
    from PIL import Image

    pipeline = checkpoints.transformers.pipeline("depth-estimation", model=relative)
    expected = pipeline(Image.fromarray(clip.frames[0]))["predicted_depth"].numpy()
    found, metric = predict(relative, clip.frames[0], "cpu")
    assert not metric
    assert found.shape == clip.frames.shape[1:3]
    assert np.ptp(expected) > 1e-3
    assert np.allclose(found, expected.squeeze(), atol=1e-4 * np.abs(expected).max())


def test_a_network_gives_depth_on_the_object_alone_and_says_what_fixed_its_scale(relative: str, clip: Clip) -> None:
    depth, source = surface_depth(clip, bar_settings(depth__model=relative))
    assert np.array_equal(depth > 0, clip.labels[0] > 0)
    assert source.surface.startswith("network")
    assert "clamp_box_m" in source.scale
    _, unknown = surface_depth(clip, bar_settings(depth__model=relative, scene__clamp_box_m=None))
    assert "unknown" in unknown.scale


def test_a_metric_network_says_so(tmp_path: Path, clip: Clip) -> None:
    name = checkpoints.depth_anything(tmp_path, metric=True)
    found, metric = predict(name, clip.frames[0], "cpu")
    assert metric
    assert found.max() > 2  # a fraction of the 20 m of the checkpoint's range, not of 1
    depth, source = surface_depth(clip, bar_settings(depth__model=name, scene__clamp_box_m=None))
    assert np.array_equal(depth > 0, clip.labels[0] > 0)
    assert "unchecked" in source.scale


def test_a_checkpoint_of_pickles_is_refused(tmp_path: Path, clip: Clip) -> None:
    import torch

    name = checkpoints.dpt(tmp_path)
    (tmp_path / "model.safetensors").unlink()
    torch.save({}, tmp_path / "pytorch_model.bin")
    with pytest.raises(InputError, match=r"depth\.model.*no usable checkpoint"):
        surface_depth(clip, bar_settings(depth__model=name))


@pytest.mark.parametrize("name", ["missing", "."])
def test_a_folder_without_a_checkpoint_is_refused(tmp_path: Path, clip: Clip, name: str) -> None:
    with pytest.raises(InputError, match=r"depth\.model.*config\.json and model\.safetensors"):
        surface_depth(clip, bar_settings(depth__model=str(tmp_path / name)))
