"""Segment Anything and SAM 2 in the files that transformers writes, with random weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.pretrained import model_of
from diffphys_ros.segment import label_clip
from diffphys_ros.segment.label import METHODS
from diffphys_ros.segment.motion import motion_mask
from diffphys_ros.segment.prompt import Prompt
from diffphys_ros.segment.sam import ARCHITECTURES, SETTING, offered
from diffphys_ros.types import Clip
from tests.boxes import bar_settings, box_clip, oblique_camera, turned
from tests.segment.test_label import MOUNT, bar

checkpoints = pytest.importorskip("tests.checkpoints", reason="transformers is not installed; pip install '.[models]'")
pytestmark = pytest.mark.slow  # imports transformers
FRAME = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (48, 80, 3), dtype=np.uint8), (0, 0), 2)
PROMPT = Prompt(np.array([10.0, 5.0, 60.0, 40.0]), np.array([30.0, 20.0]))


@pytest.fixture(scope="module", params=["sam", "sam2"])
def make(request):
    return getattr(checkpoints, request.param)


@pytest.fixture(scope="module")
def clip() -> Clip:
    made = box_clip(bar(), [turned(0.1 * np.sin(0.9 * k)) for k in range(6)], oblique_camera(), mount=MOUNT)
    return replace(made, labels=None)


def test_the_masks_of_sam_are_those_of_the_librarys_own_processor(tmp_path: Path) -> None:
    name = checkpoints.sam(tmp_path)
    model, config = model_of(name, ARCHITECTURES, setting=SETTING, device="cpu")
    side = {"height": checkpoints.SIDE, "width": checkpoints.SIDE}
    images = checkpoints.transformers.SamImageProcessorPil(size={"longest_edge": checkpoints.SIDE}, pad_size=side)
    processor = checkpoints.transformers.SamProcessor(images)
    inputs = processor(FRAME, input_points=[[PROMPT.point.tolist()]], input_boxes=[[PROMPT.box.tolist()]], return_tensors="pt")
    with torch.no_grad():
        output = model(**{k: v for k, v in inputs.items() if k not in ("original_sizes", "reshaped_input_sizes")}, multimask_output=True)
    expected = images.post_process_masks(output.pred_masks, inputs["original_sizes"], inputs["reshaped_input_sizes"], pad_size=side)[0][0].numpy()
    masks, quality = offered(model, config, FRAME, PROMPT)
    assert 0.01 < expected.mean() < 0.99
    assert (masks == expected).mean() > 0.97  # two ways of resizing
    assert np.allclose(quality, output.iou_scores[0, 0], atol=0.02)


def test_masks_have_the_frames_size_and_follow_the_prompt(make, tmp_path: Path) -> None:
    model, config = model_of(make(tmp_path), ARCHITECTURES, setting=SETTING, device="cpu")
    here, _ = offered(model, config, FRAME, PROMPT)
    there, _ = offered(model, config, FRAME, Prompt(np.array([50.0, 20.0, 79.0, 47.0]), None))
    assert here.shape == (3, *FRAME.shape[:2])
    assert not np.array_equal(here, there)
    again, _ = offered(model, config, FRAME, PROMPT)
    assert np.array_equal(here, again)


def test_a_mask_ends_at_the_given_box(make, tmp_path: Path, clip: Clip) -> None:
    settings = bar_settings(segment__model=make(tmp_path, everything=True), segment__box_px=[20, 30, 99, 69])
    mask = METHODS["sam"](clip, settings) > 0
    expected = np.zeros_like(mask)
    expected[30:70, 20:100] = True
    assert np.array_equal(mask, expected)


def test_without_a_prompt_what_moves_is_the_prompt(make, tmp_path: Path, clip: Clip) -> None:
    mask = METHODS["sam"](clip, bar_settings(segment__model=make(tmp_path, everything=True))) > 0
    v, u = np.nonzero(motion_mask(clip, bar_settings()))
    box = np.zeros_like(mask)
    box[v.min() : v.max() + 1, u.min() : u.max() + 1] = True
    assert np.array_equal(mask, box)


def test_a_model_in_the_settings_is_used_without_being_asked_for(tmp_path: Path, clip: Clip) -> None:
    settings = bar_settings(segment__model=checkpoints.sam(tmp_path, everything=True), segment__box_px=[20, 30, 99, 69], segment__max_parts=1)
    assert (label_clip(clip, settings)[0] > 0).sum() == 40 * 80


def test_sam_without_a_checkpoint_is_refused(clip: Clip) -> None:
    with pytest.raises(InputError, match=r"segment\.model is not set"):
        METHODS["sam"](clip, bar_settings(segment__method="sam"))


def test_a_network_of_another_kind_is_refused(tmp_path: Path, clip: Clip) -> None:
    with pytest.raises(InputError, match=r"type 'dpt', must be one of sam"):
        METHODS["sam"](clip, bar_settings(segment__model=checkpoints.dpt(tmp_path)))


def test_a_mask_that_covers_the_whole_image_is_refused(tmp_path: Path, clip: Clip) -> None:
    settings = bar_settings(segment__model=checkpoints.sam(tmp_path, everything=True), segment__point_px=[10, 10])
    with pytest.raises(InputError, match=r"marks 100\.00 % of frame 0"):
        METHODS["sam"](clip, settings)
