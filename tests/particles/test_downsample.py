"""A share of dense points stands for the body as the whole did."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.particles import bind, dense_points, downsample
from diffphys_ros.particles.downsample import k_means
from diffphys_ros.types import Body
from tests.particles.test_fill import made_body

DX = 0.004


def front_of(body: Body, count: int = 600) -> np.ndarray:
    """Points all over the front face [m], body frame."""
    rng = np.random.default_rng(0)
    cell = np.argwhere(body.inside)[rng.choice(int(body.inside.sum()), count)]
    xy = body.origin + body.pitch_m * (cell + rng.uniform(-0.5, 0.5, cell.shape))
    return np.concatenate([xy, body.half_thickness[cell[:, 0], cell[:, 1], None]], 1)


@pytest.mark.parametrize("count", [40, 400, 2000])
@pytest.mark.parametrize("ragged", [False, True])
def test_volume_and_mass_of_every_part_are_kept_exactly(ragged: bool, count: int) -> None:
    body = made_body(ragged=ragged)
    particles = downsample(body, dense_points(body, front_of(body)), count, DX)
    own = particles.own
    for part in (1, 2):
        cells = body.inside & (body.part == part)
        true = 2 * body.half_thickness[cells].sum() * body.pitch_m**2
        at = own[particles.part[own] == part]
        assert particles.volume[at].sum() == pytest.approx(true, rel=1e-9)
        assert particles.mass[at].sum() == pytest.approx(true * body.density[part - 1], rel=1e-9)
    assert particles.volume.min() > 0
    assert len(own) == pytest.approx(count, rel=0.01, abs=2)


def test_the_middle_of_the_body_stays_where_it_is() -> None:
    body = made_body(ragged=True)
    dense = dense_points(body, front_of(body))
    particles = downsample(body, dense, 300, DX)
    own = particles.own
    kept = np.average(particles.x_rest[own], axis=0, weights=particles.volume[own])
    assert np.allclose(kept, np.average(dense.x, axis=0, weights=dense.volume), atol=1e-12)
    assert np.abs(kept[2]) < 2e-4  # the Gaussians all lie on one side


def test_the_interior_is_as_dense_as_the_surface() -> None:
    body = made_body()
    sparse, fine = (len(dense_points(body, front_of(body, n)).x) - n for n in (200, 800))
    assert fine / sparse == pytest.approx(8, rel=0.15)


def test_a_gaussian_away_from_the_body_is_left_out() -> None:
    body = made_body()
    surface = front_of(body)
    stray = np.concatenate([surface, [[0.03, 0.0, 0.1]]])
    assert len(dense_points(body, stray).x) == pytest.approx(len(dense_points(body, surface).x), abs=30)
    assert dense_points(body, stray).x[:, 2].max() < 0.01


def test_every_kept_particle_is_nearer_to_its_own_points_than_to_any_others() -> None:
    x = np.random.default_rng(1).uniform(size=(2000, 3))
    cluster = k_means(x, 30)
    centre = np.stack([x[cluster == k].mean(0) for k in range(30)])
    nearest = np.linalg.norm(x[:, None] - centre, axis=-1).argmin(1)
    assert (nearest == cluster).mean() > 0.95
    spread = np.linalg.norm(x - centre[cluster], axis=1)
    assert np.sqrt((spread**2).mean()) < 1.1 * 30 ** (-1 / 3) / 2  # of cubes of that volume


def test_ghosts_mirror_the_root_and_only_it() -> None:
    body = made_body()
    particles = downsample(body, dense_points(body, front_of(body)), 3000, DX)
    x = particles.x_rest
    assert ((x[:, 0] < 0) == particles.ghost).all()
    root = x[~particles.ghost & (x[:, 0] < DX / 2)]
    assert len(root) == particles.ghost.sum() > 0
    assert np.allclose(np.sort(root[:, 0]), np.sort(-x[particles.ghost, 0]))
    free = dataclasses.replace(body, clamped=False)
    assert not downsample(free, dense_points(free, front_of(free)), 300, DX).ghost.any()


def test_downsampling_twice_gives_the_same_bytes() -> None:
    body = made_body(ragged=True)
    a, b = (downsample(body, dense_points(body, front_of(body)), 200, DX) for _ in range(2))
    assert all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))


def test_gaussians_ride_on_sparse_particles_without_error_in_a_linear_motion() -> None:
    body = made_body(ragged=True)
    surface = front_of(body)
    particles = downsample(body, dense_points(body, surface), 150, DX)
    turn = np.array([[1.0, 0.2, -0.1], [-0.3, 0.9, 0.2], [0.1, 0.0, 1.1]])
    moved = bind(surface, particles.x_rest).apply(particles.x_rest @ turn.T)
    assert np.abs(moved - surface @ turn.T).max() < 1e-8


def test_no_gaussians_are_refused() -> None:
    with pytest.raises(InputError, match=r"experiment.downsample_ratio: there are 0 Gaussians .* set it to 0"):
        dense_points(made_body(), np.zeros((0, 3)))
