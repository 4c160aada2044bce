"""What is said in the picture means what the same thing said in metres means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.body import build_body
from diffphys_ros.body.leaving import BEYOND, FOUND
from diffphys_ros.config import build, layered, leaves, parse_text
from diffphys_ros.depth import placed, surface_depth
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import prepare
from diffphys_ros.segment import label_clip
from diffphys_ros.types import Body, Camera, Clip
from tests.boxes import bar, box_clip, camera_at, turned

ROLL = np.deg2rad(25.0)  # by which the phone was held askew
CORNERS = np.array([[0.0, -0.025, -0.03], [0.0, -0.025, 0.03], [0.24, -0.025, 0.03]])  # of the bar's front


def rolled(camera: Camera, angle: float) -> Camera:
    """The camera turned about its optical axis."""
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ turned(angle, axis=2)[:3, :3]
    return replace(camera, world_from_camera=pose)


CAMERA = rolled(camera_at((0.12, -0.6, 0.0), (0.12, 0, 0), width=240, height=200), ROLL)


def pixels(points: np.ndarray) -> list[float]:
    return [round(float(v), 2) for v in CAMERA.project(points)[0].ravel()]


@pytest.fixture(scope="module")
def phone() -> Clip:
    """A video: no depth, no pose, the camera's own frame is the world."""
    clip = box_clip(bar(), [np.eye(4)] * 2, CAMERA, depth=False)
    return replace(clip, camera=replace(CAMERA, world_from_camera=np.eye(4), frame_id="camera", world_frame_id="camera"))


SAID = {
    "scene.thickness_m": 0.05,
    "scene.mass_kg": 0.36,
    "scene.clamp_px": pixels(CORNERS[:2]),
    "scene.length_px": pixels(CORNERS[1:]),
    "scene.size_m": 0.24,
    "scene.down_px": (np.diff(np.reshape(pixels(CORNERS[1::-1]), (2, 2)), axis=0)[0]).tolist(),
}


def solid(clip: Clip, values: dict[str, object]) -> Body:
    settings = build(values)
    clip = placed(clip, settings)
    return build_body(clip, surface_depth(clip, settings)[0], settings)


def test_clamp_length_and_gravity_in_pixels_give_the_body_in_metres(phone: Clip) -> None:
    body = solid(phone, SAID)
    assert body.clamped
    assert body.sides_m == pytest.approx([0.24, 0.06, 0.05], rel=0.02)
    assert body.mass_kg == pytest.approx(0.36)
    in_camera = CAMERA.world_from_camera[:3, :3].T
    np.testing.assert_allclose(body.world_from_body[:3, 0], in_camera @ [1, 0, 0], atol=2e-3)  # out of a clamp that is oblique in the picture
    np.testing.assert_allclose(body.world_from_body[:3, :3] @ body.gravity, in_camera @ [0, 0, -9.80665], atol=0.05)
    np.testing.assert_allclose(body.world_from_body[:3, 3], in_camera @ (-CAMERA.position), atol=3e-3)
    assert body.sources["clamp"].startswith("clamp_px")


def test_a_clamp_line_may_be_the_edge_of_the_picture_and_what_lies_beyond_one_is_no_part_of_the_body(phone: Clip) -> None:
    camera = camera_at((0.12, -0.6, 0.0), (0.12, 0, 0))
    straight = box_clip(bar(), [np.eye(4)] * 2, camera, depth=False)
    u = round(float(camera.project(np.array([0.04, -0.025, 0.0]))[0][0]))
    cut = replace(straight, frames=straight.frames[:, :, u:], labels=straight.labels[:, :, u:], camera=replace(camera, width=240 - u, pixel_from_camera=camera.pixel_from_camera - [[0, 0, u], [0, 0, 0], [0, 0, 0]]))
    known = {"scene.thickness_m": 0.05, "scene.length_px": [[0, 10], [camera.focal_px * 0.2 / 0.575, 10]], "scene.size_m": 0.2}
    at_edge = solid(cut, known | {"scene.clamp_px": [[0, 0], [0, 160]]})
    within = solid(straight, known | {"scene.clamp_px": [[u, 0], [u, 160]]})
    assert at_edge.clamped
    for body in (at_edge, within):
        assert body.sides_m == pytest.approx([0.2, 0.06, 0.05], rel=0.02)
    mask = label_clip(replace(straight, first_labels=straight.labels[0], labels=None), build(known | {"scene.clamp_px": [[u, 0], [u, 160]]}))
    assert not mask[:, :, : u - 2].any()
    assert mask[:, :, u + 2 :].any()


def test_how_surely_a_clamp_is_known_depends_on_who_says_where_it_is() -> None:
    """A person's hand, the end that was found to stay, or the border of the picture, beyond which it may lie."""
    camera = camera_at((0.12, -0.6, 0.0), (0.12, 0, 0))
    straight = replace(box_clip(bar(), [np.eye(4), turned(0.05), turned(-0.05)], camera), depth=None)
    u = round(float(camera.project(np.array([0.0, -0.025, 0.0]))[0][0]))
    cut = replace(straight, frames=straight.frames[:, :, u + 20 :], labels=straight.labels[:, :, u + 20 :], camera=replace(camera, width=220 - u))
    known = {"scene.thickness_m": 0.05, "scene.size_m": 0.24}
    found, drawn, beyond = solid(straight, known), solid(straight, known | {"scene.clamp_px": [[u, 40], [u, 120]]}), solid(cut, known)
    pixel_m = 0.24 / np.ptp(np.flatnonzero(straight.labels[0].any(0)))
    assert drawn.clamp_sd_m == pytest.approx(pixel_m, rel=0.1)
    assert found.clamp_sd_m == pytest.approx(FOUND * np.hypot(0.24, 0.06), rel=0.1)
    assert beyond.clamp_sd_m == pytest.approx(BEYOND * np.hypot(*beyond.sides_m[:2]), rel=0.1)
    assert "the held face lies within 1.0 px of it" in drawn.sources["clamp"]


def test_where_no_clamp_is_told_an_object_that_leaves_the_picture_or_meets_what_is_still_is_held_there_and_that_is_said() -> None:
    camera = camera_at((0.12, -0.6, 0.0), (0.12, 0, 0))
    straight = box_clip(bar(), [np.eye(4), turned(0.05), turned(-0.05)], camera)
    u = round(float(camera.project(np.array([0.04, -0.025, 0.0]))[0][0]))
    seen = replace(camera, width=240 - u, pixel_from_camera=camera.pixel_from_camera - [[0, 0, u], [0, 0, 0], [0, 0, 0]])
    cut = replace(straight, frames=straight.frames[:, :, u:], labels=straight.labels[:, :, u:], depth=straight.depth[:, :, u:], camera=seen)
    known = {"scene.thickness_m": 0.05, "scene.mass_kg": 0.36}
    held, free = solid(replace(cut, depth=None), known), solid(cut, known)
    assert held.clamped
    assert "leaves the picture at its left edge" in held.sources["clamp"]
    assert np.abs(held.world_from_body[:3, 0]) == pytest.approx([1, 0, 0], abs=0.01)
    assert not free.clamped, "with depth it stays as it was"
    assert free.sources["clamp"].startswith("taken as free, though the object leaves the picture at its left edge")
    whole = solid(replace(straight, depth=None), known)
    assert whole.clamped
    assert whole.sources["clamp"].startswith("not told: the object meets what is still")
    assert np.abs(whole.world_from_body[:3, 0]) == pytest.approx([1, 0, 0], abs=0.02)
    assert whole.sides_m[0] / whole.sides_m[1] == pytest.approx(4, rel=0.03)
    fallen = replace(straight, depth=None, labels=np.stack([np.roll(labels, 3 * k, 0) for k, labels in enumerate(straight.labels)]))
    assert "clamp" not in solid(fallen, known).sources
    gone = replace(cut, depth=None, labels=np.where(np.arange(3)[:, None, None] > 0, np.roll(cut.labels, 20, 2), cut.labels))
    gone.labels[1:, :, :20] = 0
    assert not solid(gone, known).clamped, "it left the picture's edge later"


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"scene.clamp_px": [[0, 0], [241, 0]]}, r"scene.clamp_px \[0.0, 0.0, 241.0, 0.0\] lies outside of the picture, u must be in 0 .. 240"),
        ({"scene.length_px": [[0, 0], [0, 201]]}, "scene.length_px .* v in 0 .. 200"),
        ({"scene.size_m": None}, "scene.length_px marks a length that nobody tells; give it in metres as scene.size_m"),
        ({"scene.clamp_px": pixels(CORNERS[:2] + np.array([0.11, 0, 0]))}, "only 5[0-9] % of the visible object lies beyond"),
        ({"scene.clamp_px": [[0, 0], [0, 200]]}, "the nearest point of the object is 0.1[0-9]+ m away"),
        ({"scene.rest_frame": 2}, "scene.rest_frame is 2, must be one of the clip's frames 0 .. 1"),
    ],
)
def test_what_the_picture_does_not_hold_is_refused(phone: Clip, changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        solid(phone, SAID | changed)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"scene.clamp_px": [[0, 0], [9, 0]], "scene.clamp_box_m": [0, 0, 0, 1, 1, 1]}, "scene.clamp_box_m and scene.clamp_px are both given"),
        ({"scene.floor_px": [[0, 0], [9, 0]], "scene.floor_z_m": 0.0}, "scene.floor_z_m and scene.floor_px are both given"),
        ({"scene.down_px": [0, 1], "scene.gravity_m_s2": [0, 0, -9.81]}, "scene.gravity_m_s2 and scene.down_px are both given"),
        ({"scene.length_px": [[5, 5], [5, 5]]}, "scene.length_px is .*, its points must be at least 2 px apart"),
        ({"scene.down_px": [0, 0]}, "scene.down_px is .*, must have a direction"),
        ({"scene.clamp_px": [[5, 5], [5, 5, 7]]}, "scene.clamp_px has 2 numbers, needs 4"),
    ],
)
def test_contradictions_are_refused_with_a_sentence(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        build(values)


def test_points_are_written_as_pairs_or_one_after_the_other(tmp_path) -> None:
    (tmp_path / "given.yaml").write_text("scene:\n  clamp_px: [[1, 2], [30, 4]]\n  length_px:\n  - [1, 2]\n  - [30, 4]\n")
    scene = layered([tmp_path / "given.yaml"]).scene
    leaf = leaves()["scene.clamp_px"]
    words = [leaf.checked(parse_text(leaf, text), "command line") for text in ("[[1, 2], [30, 4]]", "1,2,30,4")]
    assert scene.clamp_px == scene.length_px == words[0] == words[1] == [1.0, 2.0, 30.0, 4.0]


def test_a_rest_frame_that_nothing_is_built_at_is_refused_and_frame_0_is_not(phone: Clip) -> None:
    eight = replace(phone, frames=np.repeat(phone.frames[:1], 8, 0), labels=None)
    with pytest.raises(InputError, match=r"scene.rest_frame is 5, but points are followed from frame 0"):
        list(prepare(eight, build({"scene.rest_frame": 5})))
    assert next(prepare(eight, build({"scene.rest_frame": 0}))).stage == "segment"
