"""Particles fill the body exactly, on a lattice that fits clamp, mid-plane and grid."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.particles import fill, fit_grid, held_by
from diffphys_ros.types import Body

PITCH = 0.5e-3


def made_body(*, clamped: bool = True, ragged: bool = False) -> Body:
    """A bar of 60 x 20 x 16 mm; `ragged`: with a slanted tip and a back that thins out."""
    x, y = np.meshgrid((np.arange(130) + 0.5) * PITCH, (np.arange(60) - 29.5) * PITCH, indexing="ij")
    inside = (x < 0.06) & (np.abs(y) < 0.01)
    half = np.full(x.shape, 0.008)
    if ragged:
        inside &= x + 0.7 * y < 0.055
        half = 0.008 - 0.004 * x / 0.06
    return Body(
        world_from_body=np.eye(4),
        inside=inside,
        origin=np.array([x[0, 0], y[0, 0]]),
        pitch_m=PITCH,
        half_thickness=np.where(inside, half, 0),
        part=np.where(x < 0.021, 1, 2).astype(np.uint8),
        density=np.array([500.0, 900.0]),
        poisson=np.array([0.3, 0.4]),
        gravity=np.zeros(3),
        clamped=clamped,
    )


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize(("dx", "per_cell"), [(0.004, 1.0), (0.004, 1.5), (0.0053, 2.0), (0.0071, 1.0)])
def test_particles_sum_to_the_volume_of_the_body(ragged: bool, dx: float, per_cell: float) -> None:
    body = made_body(ragged=ragged)
    particles = fill(body, dx, per_cell)
    assert particles.volume[particles.own].sum() == pytest.approx(body.volume_m3, rel=1e-9)
    assert particles.volume.min() > 0


def test_first_moments_are_those_of_the_body() -> None:
    body = made_body(ragged=True)
    particles = fill(body, 0.005, 1.5)
    x, v = particles.x_rest[particles.own], particles.volume[particles.own]
    cells = body.origin + PITCH * np.argwhere(body.inside)
    weight = body.half_thickness[body.inside]
    assert np.allclose((v @ x)[:2] / v.sum(), weight @ cells / weight.sum(), atol=2e-4)
    assert (v @ x)[2] == pytest.approx(0, abs=1e-12)


def test_lattice_planes_lie_on_the_clamp_and_layers_about_the_mid_plane() -> None:
    particles = fill(replace(made_body(), part=np.ones((130, 60), np.uint8), density=np.array([500.0]), poisson=np.array([0.3])), 0.004, 2.0)
    x = particles.x_rest
    assert np.allclose(np.unique(np.round((x[:, 0] / 0.002) % 1, 6)), 0.5)
    assert np.allclose(np.unique(np.round(x[:, 2], 9)), (np.arange(8) - 3.5) * 0.002 / np.sqrt(1 - 1 / 64))
    assert (particles.ghost == (x[:, 0] < 0)).all()
    assert x[:, 0].min() == pytest.approx(-0.001)


@pytest.mark.parametrize("per_cell", [1.0, 1.5, 2.0, 2.3])
def test_second_moments_of_every_slice_of_a_bar_are_the_solids(per_cell: float) -> None:
    particles = fill(made_body(), 0.005, per_cell)
    x, v = particles.x_rest, particles.volume
    slice_of = np.rint(x[:, 0] / (0.005 / per_cell) - 0.5)
    for at in (slice_of == k for k in range(int(slice_of.max()))):  # the last is cut short
        assert np.average(x[at, 1] ** 2, weights=v[at]) == pytest.approx(0.02**2 / 12, rel=1e-3)  # the raster's edges
        assert np.average(x[at, 2] ** 2, weights=v[at]) == pytest.approx(0.016**2 / 12, rel=1e-9)


def test_second_moments_of_a_ragged_body_are_those_of_its_columns() -> None:
    body = made_body(ragged=True)
    particles = fill(body, 0.005, 1.5)
    x, v = particles.x_rest[particles.own], particles.volume[particles.own]
    cells, half = body.origin + PITCH * np.argwhere(body.inside), body.half_thickness[body.inside]
    assert np.average(x[:, 1] ** 2, weights=v) == pytest.approx(np.average(cells[:, 1] ** 2, weights=half), rel=0.01)
    assert np.average(x[:, 2] ** 2, weights=v) == pytest.approx(np.average(half**2 / 3, weights=half), rel=0.01)


@pytest.mark.parametrize("per_cell", [1.0, 1.5, 2.0])
def test_every_part_keeps_its_volume_and_its_middle(per_cell: float) -> None:
    body = made_body(ragged=True)
    particles = fill(body, 0.005, per_cell)
    own = particles.own
    for part in (1, 2):
        cells = body.inside & (body.part == part)
        weight = 2 * body.half_thickness[cells] * PITCH**2
        at = own[particles.part[own] == part]
        assert particles.volume[at].sum() == pytest.approx(weight.sum(), rel=1e-9)
        middle = np.average(body.origin[0] + PITCH * np.nonzero(cells)[0], weights=weight)
        assert np.average(particles.x_rest[at, 0], weights=particles.volume[at]) == pytest.approx(middle, abs=1.5e-4)


def test_no_ghosts_without_a_clamp() -> None:
    assert not fill(made_body(clamped=False), 0.004, 1.0).ghost.any()


def test_slivers_do_not_become_particles() -> None:
    particles = fill(made_body(ragged=True), 0.005, 1.0)
    assert particles.volume.min() > 0.2 * np.median(particles.volume)


def test_parts_and_their_constants_follow_the_raster() -> None:
    body = made_body()
    particles = fill(body, 0.004, 1.5)
    assert np.array_equal(particles.part, np.where(particles.x_rest[:, 0] < 0.021, 1, 2))
    assert np.array_equal(particles.density, body.density[particles.part - 1])
    assert np.array_equal(particles.poisson, body.poisson[particles.part - 1])


def test_particles_are_sorted_in_grid_order() -> None:
    dx = 0.004
    cell = np.floor(fill(made_body(), dx, 2.0).x_rest / dx + 1e-9).astype(int)
    key = (cell[:, 0] * 1000 + cell[:, 1]) * 1000 + cell[:, 2]
    assert (np.diff(key) >= 0).all()


def test_filling_twice_gives_the_same_bytes() -> None:
    a, b = fill(made_body(ragged=True), 0.005, 1.5), fill(made_body(ragged=True), 0.005, 1.5)
    assert all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))


@pytest.mark.parametrize(("dx", "per_cell"), [(0.0, 1.0), (0.004, -1.0)])
def test_a_spacing_that_is_not_positive_is_refused(dx: float, per_cell: float) -> None:
    with pytest.raises(InputError, match=r"dx is .* must be positive"):
        fill(made_body(), dx, per_cell)


@pytest.mark.parametrize("clamped", [True, False])
@pytest.mark.parametrize("dx", [0.004, 0.0053])
def test_moving_particles_keep_their_stencil_inside_the_grid(clamped: bool, dx: float) -> None:
    particles = fill(made_body(clamped=clamped), dx, 1.5)
    reach = 0.013
    grid = fit_grid(particles, dx=dx, reach_m=reach, clamped=clamped)
    for sign in (-1, 1):
        moved = particles.x_rest + sign * reach * (~particles.ghost & (particles.x_rest[:, 0] > reach))[:, None]
        node = np.floor((moved - grid.origin) / dx - 0.5).astype(int)
        assert (node >= 0).all()
        assert (node + 2 < grid.size).all()


def test_the_held_plane_of_nodes_lies_a_sixth_of_a_cell_beyond_the_clamped_face() -> None:
    particles = fill(made_body(), 0.0053, 1.0)
    grid = fit_grid(particles, dx=0.0053, reach_m=0.01, clamped=True)
    assert grid.origin[0] + grid.dx * grid.clamp_index == pytest.approx(0.0053 / 6, abs=1e-12)
    assert fit_grid(particles, dx=0.0053, reach_m=0.01, clamped=False).clamp_index == -1


def test_surfaces_across_the_thickness_lie_on_nodes_where_cells_fit() -> None:
    particles = fill(made_body(), 0.004, 1.0)
    grid = fit_grid(particles, dx=0.004, reach_m=0.0, clamped=True)
    nodes = grid.origin[2] + grid.dx * np.arange(grid.size[2])
    assert np.abs(nodes - 0.008).min() == pytest.approx(0, abs=1e-9)
    assert np.allclose(nodes, -nodes[::-1])


def test_a_larger_reach_costs_nodes_only_where_the_body_moves() -> None:
    particles = fill(made_body(), 0.004, 1.0)
    small, large = (fit_grid(particles, dx=0.004, reach_m=r, clamped=True) for r in (0.004, 0.02))
    assert large.clamp_index == small.clamp_index
    assert large.size[0] - small.size[0] == 4
    assert large.size[1] - small.size[1] == 8


@pytest.mark.parametrize("per_cell", [1.0, 1.5, 2.0, 3.0])
def test_a_particle_is_held_where_held_nodes_have_more_than_half_of_its_weight(per_cell: float) -> None:
    particles = fill(made_body(), 0.004, per_cell)
    grid = fit_grid(particles, dx=0.004, reach_m=0.01, clamped=True)
    distance = np.abs((particles.x_rest[:, :1] - grid.origin[0]) / grid.dx - np.arange(grid.size[0]))
    spline = np.where(distance < 0.5, 0.75 - distance**2, 0.5 * np.maximum(1.5 - distance, 0) ** 2)
    assert np.allclose(spline.sum(1), 1)
    held = held_by(grid, particles.x_rest)
    assert np.array_equal(held, spline[:, : grid.clamp_index + 1].sum(1) > 0.5)
    assert held[particles.ghost].all()
    assert held[particles.own].any()


def test_nothing_is_held_without_a_clamp() -> None:
    particles = fill(made_body(clamped=False), 0.004, 1.5)
    assert not held_by(fit_grid(particles, dx=0.004, reach_m=0.01, clamped=False), particles.x_rest).any()
