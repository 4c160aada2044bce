"""A floor that a person told of enters the simulation."""

import dataclasses

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import solve
from diffphys_ros.inverse.floor import floor_planes
from diffphys_ros.particles import fill

from .conftest import make_body, make_tracks
from .test_solve import drive

DX = 0.03


def scene(floor_z_m):
    return build({"scene.floor_z_m": floor_z_m, "scene.floor_friction": 0.3}).scene


def test_points_at_the_floors_height_lie_on_its_plane_in_the_body_frame():
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn * np.linalg.det(turn), (0.1, -0.3, 0.7)
    body = dataclasses.replace(make_body(), world_from_body=pose)
    (plane,) = floor_planes(body, fill(body, DX, 1.5), scene(0.2), dx=DX)
    on_floor = np.random.default_rng(1).normal(size=(5, 3))
    on_floor[:, 2] = 0.2
    np.testing.assert_allclose(body.to_body(on_floor) @ plane.normal, plane.offset_m, atol=1e-12)
    assert (body.to_body(on_floor + np.array([0, 0, 0.1])) @ plane.normal > plane.offset_m).all(), "the normal points up"
    assert (plane.kind, plane.friction) == ("separate", 0.3)


def test_no_floor_is_assumed_and_one_inside_the_object_is_refused():
    body = make_body()
    particles = fill(body, DX, 1.5)
    assert floor_planes(body, particles, build({}).scene, dx=DX) == ()
    with pytest.raises(InputError, match=r"scene.floor_z_m 0 m: the object reaches 0.0\d+ m below it"):
        floor_planes(body, particles, scene(0.0), dx=DX)


def test_a_fit_does_not_follow_tracks_through_a_floor(prepared):
    """A gust presses the bar down: with a floor in the way no force brings the simulation there."""
    start = dataclasses.replace(prepared.start, force=prepared.start.force[:, [0, 2, 1]] * [1, 1, -1])
    pressed = dataclasses.replace(prepared, start=start, tracks=make_tracks(prepared.body, prepared.modal, start))
    missed = []
    for floor_z_m in (None, -0.051):
        scene_and_few = {"scene.at_rest": True, "scene.floor_z_m": floor_z_m, "particles.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 2}
        *_, recovery = drive(solve(pressed, None, build(scene_and_few)))
        missed.append(recovery.metrics["track_rms_refined_m"])
    free, stopped = missed
    assert free < 4e-4
    assert stopped > 8e-4
