"""Label images: object, parts, and both through the clip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.segment import described, label_clip
from diffphys_ros.segment.given import given_mask
from diffphys_ros.segment.label import METHODS, first_labels
from diffphys_ros.segment.motion import motion_mask
from diffphys_ros.segment.parts import numbered, split_parts, whole_pieces
from diffphys_ros.segment.prompt import Mark
from diffphys_ros.types import Clip
from tests.boxes import Box, bar, bar_settings, box_clip, oblique_camera, turned

MOUNT = Box(np.array([-0.04, -0.05, -0.05]), np.array([0.0, 0.05, 0.05]))
FRAMES = 9


def swinging() -> list[np.ndarray]:
    return [turned(0.1 * np.sin(0.9 * k)) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(cuts=(0.08,)), swinging(), oblique_camera(), mount=MOUNT)


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def save(path: Path, image: np.ndarray) -> str:
    cv2.imwrite(str(path), image)
    return str(path)


def test_a_given_object_mask_is_split_and_carried_through_the_clip(clip: Clip, tmp_path: Path) -> None:
    mask = save(tmp_path / "mask.png", np.where(clip.labels[0] > 0, 255, 0).astype(np.uint8))
    labels = label_clip(replace(clip, labels=None), bar_settings(scene__first_mask=mask))
    assert labels.shape == clip.labels.shape
    assert labels.dtype == np.uint8
    for found, true in zip(labels, clip.labels, strict=True):
        assert overlap(found > 0, true > 0) > 0.95
        assert (found == true)[true > 0].mean() > 0.95
    assert (labels[0] == clip.labels[0])[clip.labels[0] > 0].mean() > 0.985


def test_a_frame_that_was_lost_repeats_the_labels_before_it(clip: Clip, tmp_path: Path) -> None:
    mask = save(tmp_path / "mask.png", np.where(clip.labels[0] > 0, 255, 0).astype(np.uint8))
    seen = np.arange(len(clip)) != 4
    labels = label_clip(replace(clip, labels=None, observed=seen), bar_settings(scene__first_mask=mask))
    assert np.array_equal(labels[4], labels[3])


def test_labelling_twice_gives_the_same_bytes(clip: Clip) -> None:
    bare = replace(clip, labels=None)
    assert np.array_equal(label_clip(bare, bar_settings()), label_clip(bare, bar_settings()))


def test_motion_finds_the_object_without_its_still_mount(clip: Clip) -> None:
    mask = motion_mask(clip, bar_settings())
    assert overlap(mask > 0, clip.labels[0] > 0) > 0.93


def test_otsu_finds_an_object_of_several_colours(clip: Clip) -> None:
    mask = METHODS["otsu"](box_clip(bar(cuts=(0.08, 0.16)), [np.eye(4)], oblique_camera()), bar_settings())
    assert overlap(mask > 0, clip.labels[0] > 0) > 0.93


def test_a_model_that_is_told_draws_the_object_in_place_of_flow(clip: Clip, tmp_path: Path) -> None:
    settings = bar_settings(segment__method="flow", segment__model=str(tmp_path / "none"))
    with pytest.raises(InputError, match=r"segment\.model"):
        label_clip(replace(clip, labels=None), settings)
    assert "by the segmentation model" in described(clip, settings, clip.labels)


def test_a_mask_that_an_explicit_method_does_not_look_at_is_said(clip: Clip) -> None:
    words = described(clip, bar_settings(segment__method="flow", scene__first_mask="mask.png"), clip.labels)
    assert "what moves, by optical flow" in words
    assert "2 part(s) by colour; scene.first_mask not looked at" in words
    assert "not looked at" not in described(clip, bar_settings(segment__method="given", scene__first_mask="mask.png"), clip.labels)
    assert not described(clip, bar_settings(scene__first_mask="mask.png"), clip.labels)


def test_a_clip_in_which_nothing_moves_is_refused(clip: Clip) -> None:
    still = replace(clip, frames=np.repeat(clip.frames[:1], 5, 0))
    with pytest.raises(InputError, match=r"% of frame 0 is seen to move.*give scene\.first_mask"):
        motion_mask(still, bar_settings())


def test_a_plain_image_holds_no_object_for_otsu(clip: Clip) -> None:
    plain = replace(clip, frames=np.full_like(clip.frames, 120))
    with pytest.raises(InputError, match="Otsu"):
        METHODS["otsu"](plain, bar_settings())


def test_a_mask_that_somebody_marks_goes_before_every_setting_and_the_mask_topic(clip: Clip, tmp_path: Path) -> None:
    marked, other = np.zeros_like(clip.labels[0]), np.full_like(clip.labels[0], 255)
    marked[clip.labels[0] > 0] = 255
    bare = replace(clip, labels=None, first_labels=other)
    settings = bar_settings(scene__first_mask=save(tmp_path / "mask.png", other), segment__method="motion", segment__max_parts=1)
    assert np.array_equal(label_clip(bare, settings, Mark(labels=marked))[0] > 0, marked > 0)


def test_part_labels_of_a_given_mask_are_kept_with_its_ignored_pixels(clip: Clip, tmp_path: Path) -> None:
    image = clip.labels[0].copy()
    image[:5] = 255
    settings = bar_settings(scene__first_mask=save(tmp_path / "mask.png", image))
    assert np.array_equal(first_labels(given_mask(clip, settings), clip, settings), image)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: m * 0, "empty, needs at least one pixel that is not 0"),
        (lambda m: m[:-1], r"240 x 159 pixels, must be 240 x 160"),
        (lambda m: m * 3, r"part numbers \[3, 6\] must be 1\.\.n without gaps"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(clip: Clip, tmp_path: Path, change, sentence: str) -> None:
    settings = bar_settings(scene__first_mask=save(tmp_path / "mask.png", change(clip.labels[0])))
    with pytest.raises(InputError, match=sentence):
        given_mask(clip, settings)


def test_a_mask_that_is_no_image_is_refused(clip: Clip, tmp_path: Path) -> None:
    (tmp_path / "mask.png").write_text("no image")
    for name in ("mask.png", "missing.png"):
        with pytest.raises(InputError, match="not a readable image"):
            given_mask(clip, bar_settings(scene__first_mask=str(tmp_path / name)))


@pytest.mark.parametrize("cuts", [(), (0.08,), (0.08, 0.16), (0.2,), (0.03,)])
def test_the_number_of_parts_comes_from_the_colours(cuts: tuple[float, ...]) -> None:
    clip = box_clip(bar(cuts=cuts), [np.eye(4)], oblique_camera())
    settings = bar_settings()
    labels = first_labels((clip.labels[0] > 0).astype(np.uint8), clip, settings)
    assert labels.max() == len(cuts) + 1
    assert (labels == clip.labels[0])[clip.labels[0] > 0].mean() > 0.985


def test_no_more_parts_than_allowed_are_made() -> None:
    clip = box_clip(bar(cuts=(0.08, 0.16)), [np.eye(4)], oblique_camera())
    assert split_parts(clip.frames[0], clip.labels[0] > 0, max_parts=1).max() == 1


@pytest.mark.parametrize(("told", "parts"), [({}, 3), ({"scene__poisson_ratio": [0.3]}, 3), ({"scene__density_kg_m3": [500.0, 900.0]}, 2), ({"prior__materials": ["rubber", "foam"]}, 2)])
def test_no_more_parts_are_made_than_are_told_of(told: dict, parts: int) -> None:
    """A camera's noise may show a third colour of an object of two materials."""
    clip = box_clip(bar(cuts=(0.08, 0.16)), [np.eye(4)], oblique_camera())
    assert first_labels((clip.labels[0] > 0).astype(np.uint8), clip, bar_settings(**told)).max() == parts


def test_every_part_is_one_piece_although_spots_have_the_other_parts_colour() -> None:
    clip = box_clip(bar(cuts=(0.12,)), [np.eye(4)], oblique_camera())
    frame = clip.frames[0].copy()
    left, right = frame[clip.labels[0] == 1].mean(0), frame[clip.labels[0] == 2].mean(0)
    for k in range(8):
        u, v = np.argwhere(clip.labels[0] == 1 + k % 2)[137 * (k + 3)][::-1]
        cv2.circle(frame, (int(u), int(v)), 4, (right if k % 2 == 0 else left).tolist(), -1)
    parts = numbered(split_parts(frame, clip.labels[0] > 0, max_parts=3), np.array([0.0, 80.0]))
    assert parts.max() == 2
    for part in (1, 2):
        assert cv2.connectedComponents((parts == part).astype(np.uint8))[0] == 2
    assert (parts == clip.labels[0])[clip.labels[0] > 0].mean() > 0.98


def test_islands_join_what_surrounds_them() -> None:
    parts = np.ones((40, 60), np.uint8)
    parts[:, 30:] = 2
    expected = parts.copy()
    parts[10:13, 10:13], parts[20:22, 50:52] = 2, 1
    assert np.array_equal(whole_pieces(parts), expected)


def test_parts_are_numbered_from_the_clamp_or_by_size() -> None:
    parts = np.zeros((20, 60), np.uint8)
    parts[:, :10], parts[:, 10:25], parts[:, 25:60] = 3, 1, 2
    assert np.array_equal(numbered(parts, np.array([59.0, 10.0]))[0, [0, 15, 40]], [3, 2, 1])
    assert np.array_equal(numbered(parts, None)[0, [0, 15, 40]], [3, 2, 1])
    assert np.array_equal(numbered(parts, np.array([0.0, 10.0]))[0, [0, 15, 40]], [1, 2, 3])


@pytest.mark.parametrize("shorter", [1, 2])
def test_prongs_that_are_equally_far_are_numbered_from_left_to_right(shorter: int) -> None:
    """Whichever is a pixel or two nearer: who tells a density of each must know which is which."""
    for left, right in ((0, shorter), (shorter, 0)):
        parts = np.zeros((80, 60), np.uint8)
        parts[40:80, 25:35], parts[30:40, 5:55] = 3, 3
        parts[: 30 + left, 5:15], parts[: 30 + right, 45:55] = 2, 1
        named = numbered(parts, np.array([30.0, 79.0]))
        assert [named[70, 30], named[5, 10], named[5, 50]] == [1, 2, 3]


def test_a_prong_that_begins_farther_out_comes_after_though_it_is_to_the_left() -> None:
    parts = np.zeros((80, 60), np.uint8)
    parts[40:80, 25:35], parts[30:40, 5:55], parts[15:30, 5:15] = 3, 3, 3
    parts[:15, 5:15], parts[:30, 45:55] = 2, 1
    named = numbered(parts, np.array([30.0, 79.0]))
    assert [named[70, 30], named[5, 50], named[5, 10]] == [1, 2, 3]


def test_parts_that_no_way_leads_to_come_last_the_nearer_before_the_farther_though_that_is_to_the_left() -> None:
    parts = np.zeros((80, 60), np.uint8)
    parts[60:, 20:40], parts[:10, :10], parts[40:50, 50:] = 3, 1, 2
    named = numbered(parts, np.array([30.0, 79.0]))
    assert [named[70, 30], named[45, 55], named[5, 5]] == [1, 2, 3]


def test_parts_in_a_row_are_numbered_outwards_however_short_they_are() -> None:
    parts = np.zeros((10, 100), np.uint8)
    parts[:, 60:], parts[:, 57:60], parts[:, :57] = 1, 3, 2
    assert numbered(parts, np.array([99.0, 5.0]))[5, [80, 58, 20]].tolist() == [1, 2, 3]


def test_the_tip_of_a_hook_comes_after_its_bend_although_it_hangs_nearer_to_the_clamp() -> None:
    stem, bend, tip = 1, 3, 2
    parts = np.zeros((60, 50), np.uint8)
    parts[:50, 30:40], parts[50:, 10:40], parts[20:50, 10:20] = stem, bend, tip
    named = numbered(parts, np.array([35.0, 0.0]))
    assert [named[5, 35], named[55, 25], named[30, 15]] == [1, 2, 3]


def test_a_piece_of_the_mask_that_hangs_together_with_nothing_is_numbered_last() -> None:
    parts = np.zeros((20, 60), np.uint8)
    parts[:, :10], parts[:, 12:20], parts[0, 9:60], parts[10:, 40:] = 2, 3, 2, 1
    assert np.array_equal(numbered(parts, np.array([0.0, 10.0]))[15, [5, 15, 50]], [1, 2, 3])


@pytest.mark.parametrize(("name", "parts"), [("beam_gust", 1), ("beam_two_part", 2), ("plant_poke", 2)])
def test_the_parts_of_a_truth_scene_are_found(name: str, parts: int, scenes: Path) -> None:
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.config import layered

    settings = layered([scenes / name / "given.yaml"])
    clip = read_clip(scenes / name / "clip.mcap", settings)
    labels = label_clip(clip, settings)
    assert labels[0].max() == parts
    with np.load(scenes / name / "truth.npz") as truth:
        shape = truth["mask_shape"]
        mask = np.unpackbits(truth["mask"])[: int(np.prod(shape))].reshape(shape).astype(bool)
    assert min(overlap(labels[k] > 0, mask[k]) for k in range(0, len(mask), 6)) > 0.97
