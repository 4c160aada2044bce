"""Parts by Segment Anything: which masks count, and what a network in the files that transformers writes offers, with random weights."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.pretrained import model_of
from diffphys_ros.segment import label, sam_parts
from diffphys_ros.segment.prompt import Prompt
from diffphys_ros.segment.sam import ARCHITECTURES, SETTING, offered, offered_at
from diffphys_ros.segment.sam_parts import divided_by, points_on
from tests.boxes import bar_settings, box_clip, oblique_camera, turned
from tests.segment.test_label import MOUNT, bar

FRAME = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (48, 80, 3), dtype=np.uint8), (0, 0), 2)
OBJECT = np.zeros((60, 100), bool)
OBJECT[10:50, 10:90] = True


def region(u0: int, u1: int, v0: int = 10, v1: int = 50) -> np.ndarray:
    made = np.zeros_like(OBJECT)
    made[v0:v1, u0:u1] = True
    return made


def test_the_best_masks_that_are_parts_divide_the_object() -> None:
    masks = np.stack([OBJECT, region(10, 30), region(11, 31), region(60, 89), region(40, 44, 20, 24), region(0, 100, 0, 60)])
    parts = divided_by(masks, [0.99, 0.9, 0.89, 0.8, 0.95, 0.97], OBJECT, max_parts=3)
    assert parts is not None
    assert np.array_equal(parts > 0, OBJECT)
    assert [len(np.unique(parts[20:40, u])) for u in (20, 45, 75)] == [1, 1, 1]
    assert len({parts[30, u] for u in (20, 45, 75)}) == 3
    assert (parts == parts[30, 75]).sum() == 30 * 40  # with the seam of a pixel beside it


def test_no_more_parts_than_allowed_are_made_by_masks() -> None:
    masks = np.stack([region(10, 30), region(30, 50), region(50, 70)])
    parts = divided_by(masks, [0.9, 0.85, 0.8], OBJECT, max_parts=2)
    assert parts is not None
    assert parts.max() == 2


@pytest.mark.parametrize("masks", [[OBJECT], [region(10, 12)], [region(0, 100, 0, 60)], [region(10, 30)]], ids=["the whole", "a sliver", "beyond", "unsure"])
def test_masks_that_are_no_parts_leave_the_object_whole(masks: list[np.ndarray]) -> None:
    assert divided_by(np.stack(masks), [0.5 if masks[0].sum() == region(10, 30).sum() else 0.9], OBJECT, max_parts=3) is None


def test_points_lie_all_over_the_object_and_on_it() -> None:
    thin = np.zeros((60, 100), bool)
    thin[30, 10:90] = True
    for mask in (OBJECT, thin, region(50, 51, 30, 31)):
        points = points_on(mask).astype(int)
        assert mask[points[:, 1], points[:, 0]].all()
    assert len(points_on(OBJECT)) == 8 * 4


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sam", "sam2"])
def test_points_that_are_asked_at_once_get_the_masks_that_each_gets_by_itself(tmp_path: Path, kind: str) -> None:
    checkpoints = pytest.importorskip("tests.checkpoints", reason="transformers is not installed; pip install '.[models]'")
    model, config = model_of(getattr(checkpoints, kind)(tmp_path), ARCHITECTURES, setting=SETTING, device="cpu")
    points = np.array([[30.0, 20.0], [60.0, 40.0]])
    masks, quality = offered_at(model, config, FRAME, points)
    for point, of_point, expected in zip(points, masks, quality, strict=True):
        alone, sure = offered(model, config, FRAME, Prompt(None, point))
        assert (of_point == alone).mean() > 0.99
        np.testing.assert_allclose(expected, sure, atol=1e-4)
    assert not np.array_equal(masks[0], masks[1])


@pytest.mark.slow
def test_a_network_that_marks_the_whole_image_leaves_the_parts_to_colour(tmp_path: Path) -> None:
    checkpoints = pytest.importorskip("tests.checkpoints", reason="transformers is not installed; pip install '.[models]'")
    settings = bar_settings(segment__model=checkpoints.sam(tmp_path, everything=True))
    assert sam_parts.sam_parts(FRAME, OBJECT[:48, :80], settings) is None


@pytest.mark.parametrize(("published", "parts"), [(True, 2), (False, 1)])
def test_the_model_tells_the_parts_in_the_published_configuration_alone(monkeypatch: pytest.MonkeyPatch, published: bool, parts: int) -> None:
    clip = box_clip(bar(), [turned(0.1 * np.sin(0.9 * k)) for k in range(6)], oblique_camera(), mount=MOUNT)
    mask = (clip.labels[0] > 0).astype(np.uint8)
    u = np.nonzero(mask)[1]
    half = (mask > 0) & (np.arange(mask.shape[1]) < np.median(u))
    monkeypatch.setattr(sam_parts, "model_of", lambda *_, **__: (None, None))
    monkeypatch.setattr(sam_parts, "offered_at", lambda *_: (half[None, None], np.array([[0.9]])))
    schedule = {"experiment__schedule": "paper"} if published else {}
    labels = label.first_labels(mask, clip, bar_settings(segment__model="a/model", **schedule))
    assert len(np.setdiff1d(np.unique(labels), (0, 255))) == parts
