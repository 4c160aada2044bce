"""Force densities on a lattice of their own."""

from __future__ import annotations

import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.simulate import ForceLattice
from diffphys_ros.types import Grid

from .bodies import block, full, masses, simulator

PERIOD_S = 1 / 60
BODY = {"cells": (4, 3, 2), "dx": 0.02, "per_cell": 1.5, "clamped": False, "margin": 4, "jitter": 0.2}


def make(size: tuple[int, int, int] | None, grid: Grid) -> ForceLattice:
    return ForceLattice(grid, size, dtype=torch.float64, device="cpu")


def sim_of(**options: object):
    return simulator(block(**BODY), substeps=20, period_s=PERIOD_S, anchored=True, **options)


def after(sim, force: torch.Tensor):
    return sim.frame(sim.rest(), full(sim, 2e4), full(sim, 0.3), force, 0.0)


def test_a_trilinear_field_is_read_exactly():
    _, grid = block(**BODY)
    lattice = make((3, 4, 2), grid)
    spans = (
        [torch.linspace(0, 1, n, dtype=torch.float64) for n in lattice.size],
        [torch.linspace(0, 1, n, dtype=torch.float64) for n in grid.size],
    )
    coarse, fine = (torch.stack(torch.meshgrid(*axes, indexing="ij"), -1) for axes in spans)
    field = lambda x: torch.stack([x.prod(-1), 1 - x[..., 0], x[..., 1] * x[..., 2]], -1)  # noqa: E731
    torch.testing.assert_close(lattice.on_nodes(field(coarse)), field(fine), rtol=0, atol=1e-14)


def test_its_resolution_is_its_own_and_at_most_16_where_none_is_asked_for():
    _, grid = block((30, 5, 3), dx=0.02)
    assert make(None, grid).size == (16, 12, 10)
    assert make((2, 3, 4), grid).size == (2, 3, 4)
    with pytest.raises(InputError, match="from 2 to those of the grid"):
        make((2, 3, 40), grid)


def test_a_uniform_lattice_force_acts_as_a_uniform_particle_force():
    density = torch.tensor([30.0, -200.0, 90.0], dtype=torch.float64)
    on_lattice, on_particles = sim_of(force_on="lattice", force_lattice=(3, 2, 4)), sim_of()
    ours = after(on_lattice, density.expand(3, 2, 4, 3))
    theirs = after(on_particles, density.expand(on_particles.x_rest.shape))
    gained = (masses(on_lattice)[:, None] * ours.v).sum(0)
    torch.testing.assert_close(gained, density * on_lattice.volume.sum() * PERIOD_S, rtol=1e-12, atol=0)
    torch.testing.assert_close(ours.x, theirs.x, rtol=0, atol=1e-12)


def test_lattice_forces_are_nodal_forces_read_trilinearly_and_their_gradient_comes_back():
    sim, nodal = sim_of(force_on="lattice", force_lattice=(3, 2, 4)), sim_of(force_on="nodes")
    force = 500 * torch.randn(3, 2, 4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert torch.equal(after(sim, force).data, after(nodal, sim.force_lattice.on_nodes(force)).data)
    weight = torch.randn(len(sim.volume), 24, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    loss = lambda f: (after(sim, f).data * weight).sum()  # noqa: E731
    force.requires_grad_()
    (gradient,) = torch.autograd.grad(loss(force), force)
    step = 1e-4 * force.detach()
    with torch.no_grad():
        difference = float(loss(force + step) - loss(force - step)) / 2
    assert float((gradient * step).sum()) == pytest.approx(difference, rel=1e-6)


def test_a_rollout_takes_one_lattice_a_frame_and_refuses_another_shape():
    sim = sim_of(force_on="lattice", force_lattice=(2, 2, 2))
    path = sim.rollout(sim.rest(), full(sim, 2e4), full(sim, 0.3), torch.ones(2, 2, 2, 2, 3).double(), 0.0)
    torch.testing.assert_close(path.v[-1].mean(0), torch.full((3,), 2 * PERIOD_S / 1000.0).double(), rtol=1e-6, atol=0)
    with pytest.raises(InputError, match=r"must end in \(2, 2, 2, 3\)"):
        after(sim, torch.ones(3, 2, 2, 3).double())
