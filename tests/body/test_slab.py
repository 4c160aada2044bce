"""The solid built from one view has the size and place of the true one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.body import build_body
from diffphys_ros.body.edges import coverage
from diffphys_ros.body.solid import _behind_clamp, _gone_on, local_half_width
from diffphys_ros.body.view import front_level, height_noise, view_of
from diffphys_ros.config import Settings
from diffphys_ros.depth import surface_depth
from diffphys_ros.errors import InputError
from diffphys_ros.types import Body, Camera, Clip
from tests.boxes import Box, bar, bar_settings, box_clip, camera_at, oblique_camera, turned

PIXEL_M = 0.0016  # of the oblique camera on the bar


def solid(clip: Clip, settings: Settings) -> Body:
    return build_body(clip, surface_depth(clip, settings)[0], settings)


def places(clip: Clip) -> np.ndarray:
    """Where the pixels of frame 0 lie in the world [m], (H, W, 3)."""
    assert clip.depth is not None
    pixels = np.stack(np.meshgrid(np.arange(clip.camera.width), np.arange(clip.camera.height)), -1).astype(float)
    return clip.camera.backproject(pixels, clip.depth[0].astype(float))


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(cuts=(0.08,)), [np.eye(4)], oblique_camera())


@pytest.fixture(scope="module")
def usual(clip: Clip) -> Body:
    """Of the bar as it is told."""
    return solid(clip, bar_settings())


def edges(body: Body) -> np.ndarray:
    """Low and high x and y of the silhouette [m], (2, 2): half of the cross-section's area lies inside them at each side."""
    x, y = body.inside.sum(0), body.inside.sum(1)
    width, length = np.median(y[y > 0]), np.median(x[x > 0])
    middle = body.origin[1] + body.pitch_m * (np.arange(len(x)) @ x) / x.sum()
    return np.array([[0.0, middle - width * body.pitch_m / 2], [length * body.pitch_m, middle + width * body.pitch_m / 2]])


@pytest.mark.parametrize("depth", [True, False])
def test_volume_and_extents_are_true_to_a_third_of_a_pixel(clip: Clip, depth: bool) -> None:
    body = solid(clip if depth else replace(clip, depth=None), bar_settings())
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.012)
    assert np.abs(edges(body) - [[0, -0.03], [0.24, 0.03]]).max() < 0.35 * PIXEL_M


def test_the_body_frame_leaves_the_clamp_and_looks_at_the_camera(usual: Body) -> None:
    assert usual.clamped
    assert usual.clamp_sd_m == 0, "a box leaves no doubt"
    assert np.allclose(usual.world_from_body[:3, :3].T, [[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert np.linalg.det(usual.world_from_body[:3, :3]) == pytest.approx(1)
    assert np.allclose(usual.world_from_body[:3, 3], 0, atol=4e-4)
    assert np.allclose(usual.half_thickness[usual.inside].max(), 0.025)


def test_the_clamped_plane_is_5_mm_inside_the_face_through_which_the_body_leaves(clip: Clip) -> None:
    deep = bar_settings(scene__clamp_box_m=[-0.05, -0.03, -0.035, 0.025, 0.03, 0.035])
    body = solid(clip, deep)
    assert body.world_from_body[0, 3] == pytest.approx(0.02)
    assert body.inside.any(1).sum() * body.pitch_m == pytest.approx(0.22, abs=0.5 * PIXEL_M)


def test_a_root_hidden_behind_its_mount_is_continued_to_the_clamp() -> None:
    mount = Box(np.array([-0.06, -0.06, -0.06]), np.array([0.0, 0.06, 0.06]))
    camera = camera_at((-0.2, -0.4, 0.05), (0.08, 0, 0))
    clip = box_clip(bar(), [np.eye(4)], camera, mount=mount)
    visible = np.flatnonzero(clip.labels[0].any(0))[0] - camera.project(np.array([0.0, -0.025, 0]))[0][0]
    assert visible > 5
    body = solid(clip, bar_settings())
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.015)
    assert body.inside[0].any()


def test_a_root_behind_its_mount_is_continued_to_the_clamp_without_depth() -> None:
    mount = Box(np.array([-0.06, -0.06, -0.06]), np.array([0.0, 0.06, 0.06]))
    clip = box_clip(bar(), [np.eye(4)], camera_at((-0.2, -0.4, 0.05), (0.08, 0, 0)), mount=mount, depth=False)
    assert solid(clip, bar_settings()).volume_m3 == pytest.approx(bar().volume, rel=0.015)


@pytest.mark.parametrize("sag_m", [-0.04, 0.04])
def test_the_hollow_side_of_a_bent_root_is_not_filled_where_no_depth_tells_what_hides_it(sag_m: float) -> None:
    """A bar that sags turns one of its sides to the clamp: behind it the scene is seen, not a mount."""
    body = solid(sagging(oblique_camera(), sag_m), bar_settings())
    width, at = body.inside.sum(1) * body.pitch_m, body.origin[0] + body.pitch_m * np.arange(len(body.inside))
    assert np.median(width[(at > 0.01) & (at < 0.05)]) == pytest.approx(0.06, abs=0.5 * PIXEL_M)
    assert np.median(width[(at > 0.06) & (at < 0.1)]) == pytest.approx(0.061, abs=0.6 * PIXEL_M)


def test_what_is_seen_beside_a_stem_under_the_shoulders_of_its_leaf_is_no_hidden_root() -> None:
    """The clamp's box is wider than the stem."""
    stem, leaf = (cuboid(*sides) for sides in (((0, 0.07), (-0.02, 0.02)), ((0.07, 0.24), (-0.06, 0.06))))
    body = solid(painted(oblique_camera(), [stem, leaf]), bar_settings())
    width, at = body.inside.sum(1) * body.pitch_m, body.origin[0] + body.pitch_m * np.arange(len(body.inside))
    assert np.median(width[(at > 0.01) & (at < 0.06)]) == pytest.approx(0.04, abs=0.5 * PIXEL_M)


def cuboid(x: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    """Corners (8, 3) of a box as deep as the bar."""
    return np.array([[along, side, up] for along in x for side in (-0.025, 0.025) for up in z])


def sagging(camera: Camera, sag_m: float) -> Clip:
    """A clip of one frame, without depth, of the bar bent downwards as a cantilever is by a load on its end."""
    x = np.linspace(0, 0.24, 60)
    centre = np.stack([x, 0 * x, -sag_m * (1.5 * (x / 0.24) ** 2 - 0.5 * (x / 0.24) ** 3)], -1)
    corners = centre[:, None] + cuboid((0, 0), (-0.03, 0.03))[:4]
    return painted(camera, list(np.concatenate([corners[:-1], corners[1:]], 1)))


def painted(camera: Camera, pieces: list[np.ndarray]) -> Clip:
    """A clip of one frame, without depth, of convex pieces, by their corners (n, 3), of one brightness."""
    fine = np.zeros((8 * camera.height, 8 * camera.width), np.float32)
    for corners in pieces:
        pixels = np.rint((camera.project(corners)[0] + 0.5) * 8).astype(np.int32)
        cv2.fillConvexPoly(fine, cv2.convexHull(pixels), 1.0)
    share = fine.reshape(camera.height, 8, camera.width, 8).mean((1, 3))
    frame = np.rint(60 + 140 * share[..., None] * np.ones(3)).astype(np.uint8)
    return Clip(frame[None], 1_000_000_000, 1 / 30, camera, labels=(share[None] > 0.5).astype(np.uint8), source="painted")


def test_a_mask_that_takes_in_the_edge_of_a_nearer_mount_does_not_make_the_body_thinner() -> None:
    mount = Box(np.array([-0.06, -0.03, -0.06]), np.array([0.005, 0.03, 0.06]))
    clip = box_clip(bar(), [np.eye(4)], camera_at((0.12, -0.45, 0.0), (0.12, 0, 0)), mount=mount)
    assert clip.labels is not None
    assert clip.depth is not None
    place = places(clip)
    edge = (clip.labels[0] == 0) & (np.abs(place[..., 0]) < 0.005) & (np.abs(place[..., 2]) < 0.03) & (place[..., 1] < 0)
    assert edge.sum() > 0.01 * clip.labels[0].sum()
    body = solid(clip.with_labels(np.where(edge, 1, clip.labels[0])[None].astype(np.uint8)), bar_settings())
    assert body.half_thickness[body.inside].max() == pytest.approx(0.025, rel=1e-6)
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.025)


@pytest.mark.parametrize("beside", [True, False])
def test_sides_whose_depth_is_lost_are_no_part_of_the_front(clip: Clip, usual: Body, beside: bool) -> None:
    """As a stereo camera loses it where depth steps; `beside`: of the scene next to the body as well."""
    assert clip.labels is not None
    assert clip.depth is not None
    mask = clip.labels[0] > 0
    lost = mask & (places(clip)[..., 1] > -0.022)
    assert lost.sum() > 0.1 * mask.sum()
    lost |= beside & ~mask & (cv2.dilate(mask.astype(np.uint8), np.ones((13, 13), np.uint8)) > 0)
    body = solid(replace(clip, depth=np.where(lost, 0, clip.depth).astype(np.float32)), bar_settings())
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.015)
    assert edges(body) == pytest.approx(edges(usual), abs=PIXEL_M / 2)


def test_a_side_is_not_cut_off_where_what_may_hide_its_back_is_nearer(clip: Clip, usual: Body) -> None:
    assert clip.labels is not None
    assert clip.depth is not None
    mask = clip.labels[0] > 0
    lost = mask & (places(clip)[..., 1] > -0.022)
    depth = np.where(mask, np.where(lost, 0, clip.depth), 0.5 * clip.depth[0][mask].min()).astype(np.float32)
    body = solid(replace(clip, depth=depth), bar_settings())
    assert np.ptp(edges(body)[:, 1]) > np.ptp(edges(usual)[:, 1]) + 2 * PIXEL_M


def test_an_end_whose_back_the_mount_hides_is_not_cut_off_where_depth_is_lost() -> None:
    """Seen from beyond the clamp, by a stereo camera whose other eye does not see past the mount: the nearest depth that was measured is the wall's."""
    mount = Box(np.array([-0.06, -0.025, -0.035]), np.array([0.0, 0.025, 0.035]))
    clip = box_clip(bar(), [np.eye(4)], camera_at((-0.25, -0.4, 0.05), (0.08, 0, 0)), mount=mount)
    assert clip.depth is not None
    place = places(clip)
    lost = (place[..., 0] < 0.06) & (place[..., 1] < 0.03)
    usual, body = (solid(each, bar_settings()) for each in (clip, replace(clip, depth=np.where(lost, 0, clip.depth).astype(np.float32))))
    assert usual.volume_m3 == pytest.approx(bar().volume, rel=0.03)
    assert body.inside[: round(0.02 / body.pitch_m)].sum(1).min() * body.pitch_m > 0.058
    assert body.volume_m3 == pytest.approx(usual.volume_m3, rel=0.015)


def test_what_lies_three_pixels_before_the_clamped_face_is_still_hidden_by_what_holds_it(clip: Clip) -> None:
    view = view_of(clip, surface_depth(clip, bar_settings())[0], clip.labels[0] > 0, bar_settings().scene)
    x = np.array([-3, 0, 2.8, 3.2, 6]) * view.footprint_m
    at = view.pose[:3, 3] + x[:, None, None] * view.pose[:3, 0] + view.front * view.pose[:3, 2]
    np.testing.assert_array_equal(_behind_clamp(view, view.camera.project(at)[0])[:, 0], [True, True, True, False, False])


def test_a_surface_of_which_no_depth_was_measured_is_a_body_all_the_same(clip: Clip, usual: Body) -> None:
    """Its depth comes from elsewhere; the camera's is of the scene alone."""
    assert clip.labels is not None
    assert clip.depth is not None
    around = np.where(clip.labels > 0, 0, clip.depth).astype(np.float32)
    body = build_body(replace(clip, depth=around), surface_depth(clip, bar_settings())[0], bar_settings())
    assert body.volume_m3 == pytest.approx(usual.volume_m3, rel=0.01)


def test_a_curved_front_goes_on_from_where_it_was_measured() -> None:
    height = 0.01 * np.linspace(-1, 1, 100)[:, None] ** 2 * np.ones(40)
    told = np.arange(100)[:, None] * np.ones(40) < 94
    assert np.abs(_gone_on(np.where(told, height, 1.0), told) - height).max() < 2.5e-3  # six cells of its own slope; the nearest plane is 8 mm off


def test_an_end_that_is_too_near_for_the_depth_camera_is_as_wide_as_the_picture_shows_it(clip: Clip, usual: Body) -> None:
    """What is filled in there is off by more than a pixel sees."""
    assert clip.labels is not None
    assert clip.depth is not None
    mask = clip.labels[0] > 0
    near = places(clip)[..., 0] < 0.06
    wrong = np.where(mask & near, 0.012 * np.sin(np.arange(clip.camera.height) / 3)[:, None], 0)
    body = build_body(replace(clip, depth=np.where(near, 0, clip.depth).astype(np.float32)), surface_depth(clip, bar_settings())[0] + wrong.astype(np.float32), bar_settings())
    width = body.inside.sum(1) * body.pitch_m
    assert np.abs(width[: round(0.05 / body.pitch_m)] - 0.06).max() < PIXEL_M
    assert body.volume_m3 == pytest.approx(usual.volume_m3, rel=0.01)


def test_what_is_filled_in_is_not_where_the_front_is_highest(clip: Clip, usual: Body) -> None:
    assert clip.labels is not None
    assert clip.depth is not None
    end = (clip.labels[0] > 0) & (places(clip)[..., 0] > 0.18)
    filled = surface_depth(clip, bar_settings())[0] - np.where(end, 0.003, 0).astype(np.float32)
    body = build_body(replace(clip, depth=np.where(end, 0, clip.depth).astype(np.float32)), filled, bar_settings())
    assert body.half_thickness.max() == pytest.approx(0.025, rel=1e-6)
    assert np.median(body.half_thickness[body.inside]) == pytest.approx(0.025, rel=1e-6)
    assert body.world_from_body[:3, 3] == pytest.approx(usual.world_from_body[:3, 3], abs=2e-4)


def test_an_object_that_ends_short_of_the_clamp_is_continued_to_it_and_says_so(clip: Clip, usual: Body) -> None:
    gap = 6 * PIXEL_M
    body = solid(clip, bar_settings(scene__clamp_box_m=[-0.05, -0.03, -0.035, 0.005 - gap, 0.03, 0.035]))
    assert body.inside[0].any()
    assert body.volume_m3 == pytest.approx(bar().volume * (0.24 + gap) / 0.24, rel=0.015)
    assert f"{1e3 * gap:.0f}" in body.sources["clamp"].split(" mm before")[0].split("ends ")[1] or "9." in body.sources["clamp"]
    assert "clamp" not in usual.sources


def test_an_end_that_is_ragged_is_continued_to_the_clamp_in_all_its_width(clip: Clip, usual: Body) -> None:
    """Eroded by a mask that sees little motion there: else a line as wide as its foremost tooth would hold the body."""
    labels = clip.labels.copy()
    columns = np.flatnonzero((labels[0] > 0).any(0))
    rows = np.arange(labels.shape[1])
    for first in range(columns[0], columns[0] + 12):
        labels[:, (rows % 8 > 1) | (first < columns[0] + 6), first] = 0
    body = solid(clip.with_labels(labels), bar_settings())
    assert body.inside[0].sum() > 0.9 * usual.inside[0].sum()


def test_a_clamp_box_beside_the_object_is_refused(clip: Clip) -> None:
    with pytest.raises(InputError, match="clamp_box_m"):
        solid(clip, bar_settings(scene__clamp_box_m=[-0.05, -0.03, 0.045, -0.01, 0.03, 0.055]))


def test_a_clamp_box_away_from_the_object_is_refused(clip: Clip) -> None:
    away = bar_settings(scene__clamp_box_m=[-0.305, -0.03, -0.035, -0.295, 0.03, 0.035])
    with pytest.raises(InputError, match=r"clamp_box_m.*nearest point of the object is 0\.29\d m away.*move the box"):
        solid(clip, away)


@pytest.mark.parametrize("box", [[-10, -10, -10, 10, 10, 10], [-0.1, -0.05, -0.05, 0.3, 0.05, 0.05]])
def test_a_clamp_box_that_holds_the_object_is_refused(clip: Clip, box: list[float]) -> None:
    with pytest.raises(InputError, match=r"clamp_box_m.*% of the visible object lies beyond its clamped plane, must be at least 25 %; draw the box around the held end"):
        solid(clip, bar_settings(scene__clamp_box_m=box))


def test_a_clamp_box_with_swapped_corners_is_refused(clip: Clip) -> None:
    with pytest.raises(InputError, match="each maximum must exceed its minimum"):
        solid(clip, bar_settings(scene__clamp_box_m=[0.005, -0.03, -0.035, -0.005, 0.03, 0.035]))


def test_a_thickness_axis_that_the_camera_looks_past_is_refused(clip: Clip) -> None:
    with pytest.raises(InputError, match=r"thickness_axis.*line of sight"):
        solid(clip, bar_settings(scene__thickness_axis=[1.0, 0.0, 0.0]))


@pytest.mark.parametrize("length", [1e308, 1e-320, 1.7e308])
def test_how_long_the_thickness_axis_is_does_not_matter(clip: Clip, usual: Body, length: float) -> None:
    other = solid(clip, bar_settings(scene__thickness_axis=[0.0, length, 0.0]))
    np.testing.assert_array_equal(other.world_from_body, usual.world_from_body)
    assert bar_settings(scene__thickness_axis=[length, -length, length]).scene.thickness_unit == pytest.approx([3**-0.5, -(3**-0.5), 3**-0.5])


def test_parts_lie_where_their_pixels_lie(usual: Body) -> None:
    x = np.linspace(0.002, 0.238, 60)
    points = np.stack([x, 0 * x], -1)
    assert np.array_equal(usual.part_at(points)[np.abs(x - 0.08) > 0.002], np.where(x < 0.08, 1, 2)[np.abs(x - 0.08) > 0.002])


def test_mass_fixes_density_and_says_so(usual: Body) -> None:
    assert usual.density * usual.volume_m3 == pytest.approx(0.36)
    assert usual.sources["density"] == "mass_kg over the filled volume"


@pytest.mark.parametrize(("mass_kg", "density"), [(1e-6, "0.00"), (1e5, "1.")])
def test_a_mass_that_no_solid_of_this_size_has_is_doubted_in_the_notes(clip: Clip, mass_kg: float, density: str) -> None:
    said = solid(clip, bar_settings(scene__mass_kg=mass_kg)).sources["density"]
    assert said.startswith("mass_kg over the filled volume, which makes " + density)
    assert "kg/m^3 where solids have 1 .. 30000: check mass_kg" in said


def test_densities_per_part_are_scaled_to_the_mass(clip: Clip) -> None:
    body = solid(clip, bar_settings(scene__density_kg_m3=[300.0, 900.0]))
    assert body.density[1] / body.density[0] == pytest.approx(3)
    mass = (body.density[body.part - 1] * 2 * body.half_thickness).sum() * body.pitch_m**2
    assert mass == pytest.approx(0.36, rel=1e-6)


def test_an_assumed_density_is_stated(clip: Clip) -> None:
    body = solid(clip, bar_settings(scene__mass_kg=None))
    assert (body.density == 1000).all()
    assert body.sources["density"].startswith("assumed")


def test_a_density_list_of_another_length_than_the_parts_is_refused(clip: Clip) -> None:
    with pytest.raises(InputError, match=r"density_kg_m3 has 3 values, must be 1 or 2"):
        solid(clip, bar_settings(scene__density_kg_m3=[1.0, 2.0, 3.0]))


def test_gravity_is_given_in_the_body_frame(clip: Clip) -> None:
    body = solid(clip, bar_settings(scene__gravity_m_s2=[1.0, 2.0, -9.81]))
    assert np.allclose(body.gravity, [1.0, -9.81, -2.0])


def test_without_thickness_the_width_of_the_silhouette_is_taken(clip: Clip) -> None:
    body = solid(clip, bar_settings(scene__thickness_m=None))
    x, y = (body.inside.shape[0] // 2, body.inside.shape[1] // 2)
    assert body.half_thickness[x, y] == pytest.approx(0.03, abs=PIXEL_M)
    assert "width" in body.sources["thickness"]


def test_a_stem_much_thinner_than_its_leaf_belongs_to_the_body(clip: Clip) -> None:
    labels = clip.labels.copy()
    rows, columns = (np.flatnonzero((labels[0] > 0).any(axis)) for axis in (1, 0))
    middle, half = int(np.mean(rows)), len(columns) // 2
    labels[:, : middle - 1, columns[half] :] = labels[:, middle + 2 :, columns[half] :] = 0
    body = solid(replace(clip, labels=labels), bar_settings(scene__thickness_m=None))
    assert len(rows) > 30  # pixels, against the three of the stem
    length = np.flatnonzero(body.inside.any(1))
    assert len(length) * body.pitch_m == pytest.approx(0.235, abs=0.01)  # not half of it


def holed(clip: Clip, side: int) -> Clip:
    """The clip with a square hole through the middle of its object, and the scene behind seen there."""
    labels, frames = clip.labels.copy(), clip.frames.copy()
    rows, columns = (np.flatnonzero((labels[0] > 0).any(axis)) for axis in (1, 0))
    hole = (slice(None), *(slice(int(np.mean(line)) - side // 2, int(np.mean(line)) - side // 2 + side) for line in (rows, columns)))
    labels[hole], frames[hole] = 0, frames[:, :1, :1]
    return replace(clip, labels=labels, frames=frames, depth=None)


def test_a_sheet_is_thin_and_keeps_the_gaps_between_its_strands(clip: Clip) -> None:
    thick, sheet = (solid(holed(clip, 9), bar_settings(scene__thickness_m=None, experiment__sheet_share=share)) for share in (0.0, 0.02))
    assert 2 * sheet.half_thickness.max() == pytest.approx(0.02 * sheet.sides_m[0], rel=0.02)
    assert "sheet" in sheet.sources["thickness"]
    missing = (thick.inside & ~sheet.inside).sum() * sheet.pitch_m**2
    assert missing == pytest.approx((9 * PIXEL_M) ** 2, rel=0.3)
    speck = solid(holed(clip, 2), bar_settings(scene__thickness_m=None, experiment__sheet_share=0.02))
    assert speck.silhouette_m2 == pytest.approx(sheet.silhouette_m2 + missing, rel=0.01)


def test_a_sheet_whose_surface_recedes_is_as_thick_and_as_wide_as_one_that_does_not(clip: Clip) -> None:
    depth = clip.depth + 0.1 * (clip.depth > 0) * np.linspace(0, 1, clip.camera.width, dtype=np.float32)  # many times its thickness
    level, tilted = (
        solid(replace(clip, depth=values), bar_settings(scene__thickness_m=None, scene__clamp_box_m=None, experiment__sheet_share=0.02)) for values in (clip.depth, depth)
    )
    assert np.median(tilted.half_thickness[tilted.inside]) == pytest.approx(np.median(level.half_thickness[level.inside]), rel=0.1)
    assert tilted.silhouette_m2 > 0.9 * level.silhouette_m2


def test_a_told_thickness_is_that_of_a_sheet_too(clip: Clip) -> None:
    told, plain = (solid(clip, bar_settings(experiment__sheet_share=share)) for share in (0.02, 0.0))
    np.testing.assert_array_equal(told.half_thickness, plain.half_thickness)
    assert told.sources == plain.sources


def test_without_a_clamp_the_body_starts_at_its_lower_edge(clip: Clip) -> None:
    body = solid(clip, bar_settings(scene__clamp_box_m=None, scene__gravity_m_s2=[0.0, 0.0, -9.81]))
    assert not body.clamped
    assert np.allclose(body.world_from_body[:3, 0], [0, 0, 1])
    assert body.to_body(np.array([0.1, 0.0, -0.03]))[0] == pytest.approx(0, abs=PIXEL_M)
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.02)


def test_a_camera_without_a_pose_still_gives_a_body() -> None:
    camera = camera_at((0.12, -0.5, 0.0), (0.12, 0, 0))
    clip = box_clip(bar(), [np.eye(4)], camera)
    local = replace(clip, camera=Camera(camera.pixel_from_camera, np.eye(4), camera.width, camera.height, "camera", "camera"))
    body = solid(local, bar_settings(scene__clamp_box_m=None, scene__thickness_axis=None))
    assert body.volume_m3 == pytest.approx(bar().volume, rel=0.02)


def test_the_local_width_of_a_step_is_that_of_each_side() -> None:
    inside = np.zeros((200, 80), bool)
    inside[20:100, 10:70], inside[100:180, 30:50] = True, True
    width = local_half_width(inside)
    assert width[60, 40] == pytest.approx(30, abs=1.5)
    assert width[170, 40] == pytest.approx(10, abs=1.5)


def test_edge_pixels_are_shared_between_object_and_background() -> None:
    edge = 40.3
    cover = np.clip(edge - (np.arange(80) - 0.5), 0, 1)
    frame = (cover[:, None] * np.array([200.0, 40, 30]) + (1 - cover[:, None]) * np.array([80.0, 90, 100]))[None].repeat(30, 0)
    mask = (np.arange(80) < edge)[None].repeat(30, 0)
    soft = coverage(np.round(frame).astype(np.uint8), mask)
    assert np.abs(soft.sum(1) - cover.sum()).max() < 0.12
    assert np.abs(mask.sum(1) - cover.sum()).max() > 0.15


@pytest.mark.parametrize("name", ["beam_gust", "beam_two_part", "plant_poke"])
def test_the_volume_of_a_truth_scene_is_met_within_one_percent(name: str, scenes: Path) -> None:
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.config import layered
    from diffphys_ros.segment.given import given_mask

    settings = layered([scenes / name / "given.yaml"])
    clip = read_clip(scenes / name / "clip.mcap", settings)
    body = solid(clip.with_labels(given_mask(clip, settings)[None].repeat(len(clip), 0)), settings)
    with np.load(scenes / name / "truth.npz") as truth:
        assert body.volume_m3 == pytest.approx(truth["vertex_volume"].sum(), rel=0.01)
        length = body.pitch_m * (np.flatnonzero(body.inside.any(1))[-1] + 1)
        assert length == pytest.approx(body.to_body(truth["positions"][0])[:, 0].max(), abs=2.5 * body.pitch_m)  # a pixel is 3 cells


@pytest.mark.parametrize("degrees", [1.0, 4.0])
def test_a_front_that_recedes_thins_the_body_by_as_much_from_where_it_is_highest(degrees: float) -> None:
    slope = np.tan(np.deg2rad(degrees))
    body = solid(box_clip(bar(), [turned(np.deg2rad(degrees), 2)], oblique_camera()), bar_settings())
    x = body.origin[0] + body.pitch_m * np.arange(len(body.inside))
    middle = body.inside.shape[1] // 2
    for at in (0.06, 0.12, 0.2):
        assert np.median(body.half_thickness[np.abs(x - at) < 0.01, middle]) == pytest.approx(0.025 - slope * at, abs=6e-4)


def test_a_front_that_recedes_goes_on_receding_where_no_depth_is_measured() -> None:
    clip = box_clip(bar(), [turned(np.deg2rad(4.0), 2)], oblique_camera())
    assert clip.depth is not None
    hole = (places(clip)[..., 0] > 0.09) & (places(clip)[..., 0] < 0.15)
    body = solid(replace(clip, depth=np.where(hole, 0, clip.depth).astype(np.float32)), bar_settings())
    x = body.origin[0] + body.pitch_m * np.arange(len(body.inside))
    middle = body.inside.shape[1] // 2
    for at in (0.1, 0.12, 0.14):
        assert np.median(body.half_thickness[np.abs(x - at) < 0.003, middle]) == pytest.approx(0.025 - np.tan(np.deg2rad(4.0)) * at, abs=6e-4)


def test_the_noise_of_a_tilted_curved_surface_is_that_of_its_heights() -> None:
    v, u = np.mgrid[:80, :100]
    smooth = 0.001 * u + 2e-5 * (v - 40.0) ** 2
    mask = (u > 10) & (u < 90)
    noisy = smooth + np.random.default_rng(0).normal(0, 5e-4, u.shape)
    assert height_noise(noisy, mask) == pytest.approx(5e-4, rel=0.1)
    assert height_noise(smooth, mask) < 1e-9
    assert height_noise(smooth, (u == 10) & (v < 8)) == 0.0


def test_the_front_is_where_the_surface_is_highest_whatever_specks_rise_before_it() -> None:
    u = np.mgrid[:60, :90][1]
    mask = np.ones(u.shape, bool)
    specks = np.random.default_rng(1).uniform(size=u.shape) < 0.02
    noise = np.random.default_rng(2).normal(0, 2e-4, u.shape)
    for surface in (np.zeros(u.shape), -2e-4 * u):
        height = surface + noise + np.where(specks, 0.05, 0.0)
        assert front_level(height, mask, 2e-4) == pytest.approx(0.0, abs=7e-4)


def test_a_part_without_cells_is_refused_by_its_number_where_somebody_told_the_parts(clip: Clip) -> None:
    labels = clip.labels.copy()
    labels[:, labels[0] > 0] += 1  # no pixel is left to part 1
    for told in (bar_settings(scene__density_kg_m3=[900.0, 1000.0, 1100.0]), bar_settings(scene__first_mask="drawn.png")):
        with pytest.raises(InputError, match=r"part 1 of 3 covers no cell of the object"):
            build_body(clip.with_labels(labels), surface_depth(clip, bar_settings())[0], told)


def test_a_colour_without_cells_is_no_part_where_nobody_tells_the_parts(clip: Clip, usual: Body) -> None:
    labels = clip.labels.copy()
    labels[:, labels[0] > 0] += 1
    body = build_body(clip.with_labels(labels), surface_depth(clip, bar_settings())[0], bar_settings())
    assert body.parts == 2
    np.testing.assert_array_equal(body.part[body.inside], usual.part[body.inside])
    assert body.sources["colours"] == "1 that cover(s) no cell of the object is no part"


def test_front_sides_and_mass_are_those_of_the_solid(usual: Body) -> None:
    body = replace(usual, density=np.array([800.0, 1200.0]))
    front, (low, high) = body.front, edges(body)
    np.testing.assert_allclose(body.sides_m[:2], high - low, atol=3 * body.pitch_m)
    assert front.volume.sum() == pytest.approx(body.volume_m3)
    assert front.points[:, 2].max() == pytest.approx(body.sides_m[2] / 2)
    np.testing.assert_array_equal(body.part_at(front.points), front.part)
    assert body.mass_kg == pytest.approx(body.density @ [front.volume[front.part == k].sum() for k in (1, 2)])


def test_parts_given_on_the_front_reach_to_the_nearest_unknown(usual: Body) -> None:
    x = usual.front.points[:, 0]
    number = np.where(x < 0.03, 2, np.where(x > 0.06, 1, 0))
    other = usual.with_parts(number, np.array([900.0, 1000.0]), np.array([0.3, 0.4]))
    far = np.abs(x - 0.045) > 2 * usual.pitch_m
    np.testing.assert_array_equal(other.front.part[far], np.where(x < 0.045, 2, 1)[far])
    np.testing.assert_array_equal(other.inside, usual.inside)
