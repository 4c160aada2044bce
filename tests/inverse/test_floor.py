"""A floor that a person told of enters the simulation."""

import dataclasses

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import solve
from diffphys_ros.inverse.floor import floor_planes
from diffphys_ros.particles import fill

from .conftest import make_body, make_camera, make_tracks
from .test_solve import drive

DX, CAMERA = 0.03, make_camera()


def scene(floor_z_m):
    return build({"scene.floor_z_m": floor_z_m, "scene.floor_friction": 0.3}).scene


def test_points_at_the_floors_height_lie_on_its_plane_in_the_body_frame():
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn * np.linalg.det(turn), (0.1, -0.3, 0.7)
    body = dataclasses.replace(make_body(), world_from_body=pose)
    (plane,) = floor_planes(body, fill(body, DX, 1.5), scene(0.2), CAMERA, dx=DX)
    on_floor = np.random.default_rng(1).normal(size=(5, 3))
    on_floor[:, 2] = 0.2
    np.testing.assert_allclose(body.to_body(on_floor) @ plane.normal, plane.offset_m, atol=1e-12)
    assert (body.to_body(on_floor + np.array([0, 0, 0.1])) @ plane.normal > plane.offset_m).all(), "the normal points up"
    assert (plane.kind, plane.friction) == ("separate", 0.3)


def test_no_floor_is_assumed_and_one_inside_the_object_is_refused():
    body = make_body()
    particles = fill(body, DX, 1.5)
    assert floor_planes(body, particles, build({}).scene, CAMERA, dx=DX) == ()
    with pytest.raises(InputError, match=r"scene.floor_z_m 0 m: the object reaches 0.0\d+ m below it"):
        floor_planes(body, particles, scene(0.0), CAMERA, dx=DX)


def test_a_floor_drawn_in_the_picture_is_the_one_told_in_metres():
    """Seen along y by a camera whose picture is tilted: the line of the floor is drawn where the plane z = -0.07 m is seen at the body."""
    roll = np.deg2rad(20.0)
    camera = dataclasses.replace(make_camera(), world_from_camera=np.eye(4), width=640, height=480)
    camera.world_from_camera[:3, :3] = np.stack([[np.cos(roll), 0, np.sin(roll)], [np.sin(roll), 0, -np.cos(roll)], [0, 1, 0]], -1)
    camera.world_from_camera[:3, 3] = (0.15, -1.0, 0.0)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([[1, 0, 0], [0, 0, 1], [0, -1, 0]], -1)  # x along the bar, z towards the camera
    body = dataclasses.replace(make_body(), world_from_body=pose)
    particles = fill(body, DX, 1.5)
    line = camera.project(np.array([[0.0, 0.0, -0.07], [0.2, 0.0, -0.07]]))[0].ravel().tolist()
    (told,) = floor_planes(body, particles, scene(-0.07), camera, dx=DX)
    (drawn,) = floor_planes(body, particles, build({"scene.floor_px": line, "scene.floor_friction": 0.3}).scene, camera, dx=DX)
    np.testing.assert_allclose(drawn.normal, told.normal, atol=1e-9)
    assert drawn.offset_m == pytest.approx(told.offset_m)
    assert drawn.friction == told.friction
    through = camera.project(np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]]))[0].ravel().tolist()
    with pytest.raises(InputError, match=r"scene.floor_px .*: the object reaches 0.0\d+ m below it"):
        floor_planes(body, particles, build({"scene.floor_px": through}).scene, camera, dx=DX)


def test_a_fit_does_not_follow_tracks_through_a_floor(prepared):
    """A gust presses the bar down: with a floor in the way no force brings the simulation there."""
    start = dataclasses.replace(prepared.start, force=prepared.start.force[:, [0, 2, 1]] * [1, 1, -1])
    pressed = dataclasses.replace(prepared, start=start, tracks=make_tracks(prepared.body, prepared.modal, start))
    missed = []
    for floor_z_m in (None, -0.051):
        scene_and_few = {"scene.at_rest": True, "scene.floor_z_m": floor_z_m, "experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 2}
        *_, recovery = drive(solve(pressed, None, build(scene_and_few)))
        missed.append(recovery.metrics["track_rms_refined_m"])
    free, stopped = missed
    assert free < 4e-4
    assert stopped > 8e-4
