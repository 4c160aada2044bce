"""A plain plate that comes nearer: its outline moves outwards in perspective."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

from diffphys_ros.inverse.observed import TrackTarget
from diffphys_ros.outline import follow_outline
from diffphys_ros.outline.edges import coloured_outline, outline_of
from diffphys_ros.types import Camera, Clip, Tracks
from tests.made_bar import bar

FOCAL, SIZE, DEPTH_M = 400.0, (320, 240), 0.8
PLATE_M = np.array([[0.05, -0.10], [0.25, -0.10], [0.25, 0.10], [0.05, 0.10]])  # right of the optical axis
NEARER_M = np.array([0.0, 0.008, 0.016, 0.008, 0.0, -0.008, -0.016, -0.008])
SHARP = 16  # bits of a pixel's fraction are 4


def camera(turned: bool = False) -> Camera:
    pose = np.eye(4)
    if turned:
        pose[:3, :3] = cv2.Rodrigues(np.array([0.3, -0.2, 0.5]))[0]
        pose[:3, 3] = [0.1, 0.2, -0.3]
    return Camera(np.array([[FOCAL, 0, 130.0], [0, 1.1 * FOCAL if turned else FOCAL, 119.5], [0, 0, 1]]), pose, *SIZE)


def plate(nearer_m: float) -> np.ndarray:
    """Picture of a bright plate across the optical axis, that much nearer, its edges blurred by a pixel."""
    finer = 4
    image = np.full((SIZE[1] * finer, SIZE[0] * finer), 40, np.uint8)
    corners = PLATE_M * FOCAL / (DEPTH_M - nearer_m) + (130.0, 119.5)
    cv2.fillPoly(image, [np.rint(((corners + 0.5) * finer - 0.5) * SHARP).astype(np.int32)], 200, shift=4)
    return cv2.GaussianBlur(cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 1.0)


@pytest.fixture(scope="module")
def clip() -> Clip:
    frames = np.repeat(np.stack([plate(m) for m in NEARER_M])[..., None], 3, 3)
    labels = (frames[..., 0] > 120).astype(np.uint8)
    return Clip(frames, 0, 1 / 30, camera(), labels=labels)


@pytest.fixture(scope="module")
def tracks(clip: Clip) -> Tracks:
    return follow_outline(clip, np.where(clip.labels[0] > 0, DEPTH_M, 0.0).astype(np.float32))


def test_a_gradient_is_how_a_pixel_moves_along_its_normal() -> None:
    rng = np.random.default_rng(0)
    points = camera(turned=True).backproject(rng.uniform(0, 200, (5, 2)), rng.uniform(0.5, 2, 5))
    normals = rng.normal(size=(5, 2))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    step = 1e-6 * rng.normal(size=(5, 3))
    pixels = [camera(turned=True).project(points + sign * step)[0] for sign in (1, -1)]
    gradients = camera(turned=True).gradients(points, normals)
    np.testing.assert_allclose((gradients * step).sum(1), ((pixels[0] - pixels[1]) / 2 * normals).sum(1), rtol=1e-6)
    np.testing.assert_allclose(camera(turned=True).normals_in_picture(7.0 * gradients), normals, atol=1e-12)


def test_what_comes_nearer_is_seen_along_the_normals_of_an_outline(tracks: Tracks) -> None:
    """Its left and right sides lie 4 and 17 degrees off the axis, so that they move outwards by a fourteenth and a third of it."""
    assert tracks.normals is not None
    seen = ((tracks.points - tracks.points[:1]) * tracks.normals).sum(-1)
    true = -NEARER_M[:, None] * tracks.normals[:, 2]
    assert np.sqrt((true**2).mean()) > 1e-3
    assert np.sqrt(((seen - true) ** 2).mean()) < 0.1 * np.sqrt((true**2).mean())


def test_a_motion_is_compared_with_what_the_outline_shows_of_it(tracks: Tracks) -> None:
    target = TrackTarget.of(tracks, bar(), camera(), dtype=torch.float64, device="cpu")
    moved = torch.as_tensor(-NEARER_M[:, None, None] * np.array([0.0, 0.0, 1.0])).expand(-1, tracks.pixels.shape[1], 3)
    assert target.loss(moved) < 0.01 * target.loss(0 * moved)


def test_no_point_is_followed_where_two_colours_of_the_object_meet_its_edge() -> None:
    """Sliding along itself the edge would bring the other colour there, for which the level is wrong."""
    frame = np.full((120, 200, 3), 120, np.uint8)
    frame[40:80, 30:100], frame[40:80, 100:170] = (200, 110, 40), (60, 90, 190)
    frame = cv2.GaussianBlur(frame, (0, 0), 1.0)
    mask = np.zeros(frame.shape[:2], bool)
    mask[40:80, 30:170] = True
    found = coloured_outline(frame, mask, 5.0)
    seam = np.abs(found.pixels[:, 0] - 100) < 5
    assert seam.sum() >= 4
    assert not found.contrast[seam].any()
    away = (np.abs(found.pixels[:, 0] - 100) > 15) & (found.to_corner_px > 12)
    assert np.abs(found.contrast[away]).min() > 50


def test_an_edge_is_found_beside_faces_that_are_brighter_and_darker_than_the_scene() -> None:
    """Level and sense of each point are its own: a face in the shade is left on the other way."""
    grey = np.full((120, 200), 120, np.float32)
    grey[40:80, 30:100], grey[40:80, 100:170] = 200, 60
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
    mask = np.zeros(grey.shape, bool)
    mask[40:80, 30:170] = True
    found = outline_of(grey, mask, 5.0)
    level = (found.to_corner_px > 12) & (np.abs(found.normals[:, 1]) > 0.9) & (np.abs(found.pixels[:, 0] - 100) > 15)
    assert level.sum() > 25
    np.testing.assert_allclose(np.abs(found.pixels[level, 1] - 59.5), 20.0, atol=0.1)
