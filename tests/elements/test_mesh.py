"""Meshes of filled bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from diffphys_ros.elements.mesh import element_size, solid_mesh, triangulate
from diffphys_ros.elements.outline import boundary_loops, smooth_loop
from diffphys_ros.errors import InputError
from tests.made_bar import HEIGHT, LENGTH, bar


def volumes(mesh) -> np.ndarray:
    corner = mesh.vertices[mesh.tets]
    return np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6


def leaf():
    """A stalk with an ellipse on it, thick in the middle."""
    body = bar(length=0.3, height=0.16, edges=())
    x, y = (body.origin[i] + np.arange(n) * body.pitch_m for i, n in enumerate(body.inside.shape))
    stalk, blade = (np.abs(y) < 0.02)[None] & (x < 0.12)[:, None], ((x[:, None] - 0.2) / 0.1) ** 2 + (y[None] / 0.08) ** 2 < 1
    part = np.where(x[:, None] > 0.11, 2, 1).astype(np.uint8) * np.ones_like(blade, np.uint8)
    thickness = 0.01 + 0.02 * (1 - (y[None] / 0.08) ** 2) * np.ones_like(blade)
    return replace(body, inside=stalk | blade, part=part, half_thickness=thickness, density=np.full(2, 500.0), poisson=np.full(2, 0.3))


def test_a_bar_is_filled_to_a_tenth_of_a_percent_and_every_tetrahedron_has_positive_volume():
    body = bar()
    volume = volumes(solid_mesh(body))
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(body.volume_m3, rel=1e-3)


def test_a_curved_body_of_varying_thickness_is_filled_within_one_percent():
    body = leaf()
    mesh = solid_mesh(body)
    assert volumes(mesh).min() > 0
    assert volumes(mesh).sum() == pytest.approx(body.volume_m3, rel=1e-2)


def test_parts_meet_on_triangle_sides():
    body = bar()
    mesh = solid_mesh(body)
    share = volumes(mesh)[mesh.part == 1].sum() / body.volume_m3
    assert share == pytest.approx(1 / 3, abs=2e-3)


def test_the_clamped_face_lies_exactly_on_the_plane():
    mesh = solid_mesh(bar())
    face = mesh.vertices[np.abs(mesh.vertices[:, 0]) < 1e-12]
    assert np.ptp(face[:, 1]) == pytest.approx(HEIGHT, rel=1e-2)


def test_the_clamped_face_is_as_wide_as_a_ragged_body_shows_it():
    """Whatever its sides are like next to it: the sharpest turn of such an outline may lie beyond the face."""
    body = bar()
    rows = np.arange(body.inside.shape[1])
    for seed in range(40):
        uneven = gaussian_filter1d(np.random.default_rng(seed).normal(size=(2, len(body.inside))), 2, axis=1)
        low, high = np.rint(3 * np.abs(uneven) / np.abs(uneven).max())[..., None]
        ragged = replace(body, inside=(rows >= low) & (rows < len(rows) - high))
        vertices = solid_mesh(ragged).vertices
        assert np.ptp(vertices[np.abs(vertices[:, 0]) < 1e-12, 1]) == pytest.approx(ragged.inside[0].sum() * body.pitch_m, rel=2e-2)


def test_two_held_faces_have_two_ends_each_and_a_gap_of_few_cells_none():
    body = bar()
    inside = body.inside.copy()
    inside[:40, 40:60], inside[:2, 20] = False, False
    vertices = solid_mesh(replace(body, inside=inside)).vertices
    held = np.unique(vertices[np.abs(vertices[:, 0]) < 1e-12, 1].round(4))
    for low, high in ((-0.05, -0.01), (0.01, 0.05)):
        face = held[(held > low - 1e-3) & (held < high + 1e-3)]
        assert np.ptp(face) == pytest.approx(high - low, abs=1.5e-3)
        assert np.diff(face).min() > 0.5 * element_size(body)


def test_triangles_are_well_shaped():
    body = leaf()
    points, triangles = triangulate(body, element_size(body))
    corner = points[triangles]
    area = 0.5 * np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1]))
    sides = np.linalg.norm(corner - np.roll(corner, 1, 1), axis=2)
    quality = 4 * np.sqrt(3) * area / (sides**2).sum(1)  # 1 for equal sides
    assert np.median(quality) > 0.85
    assert quality.min() > 0.2


def test_an_outline_keeps_corners_and_smooths_staircases():
    x, y = np.mgrid[:200, :120]
    tilted = np.abs(0.94 * (x - 100) + 0.34 * (y - 60)) + np.abs(-0.34 * (x - 100) + 0.94 * (y - 60)) < 50
    loop = boundary_loops(tilted)[0]
    assert len(boundary_loops(tilted)) == 1
    pieces = smooth_loop(loop, 10.0)
    assert len(pieces) == 4
    polygon = np.vstack([p[:-1] for p in pieces])
    a, b = polygon, np.roll(polygon, -1, 0)
    area = 0.5 * np.abs((a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]).sum())
    assert area == pytest.approx(tilted.sum(), rel=5e-3)


def test_an_empty_silhouette_is_refused_with_a_sentence():
    body = bar()
    with pytest.raises(InputError, match="silhouette"):
        element_size(replace(body, inside=np.zeros_like(body.inside)))


def test_length_of_the_mesh_is_that_of_the_bar():
    assert solid_mesh(bar()).vertices[:, 0].max() == pytest.approx(LENGTH, rel=2e-3)
