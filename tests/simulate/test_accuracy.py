"""Bars against beam theory and finite elements: frequencies, deflections and waves converge to the right values."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.bars import (
    SLIM,
    WIDE,
    Bar,
    apparent_by_kind,
    fitted,
    plain,
    static_ratio,
    timoshenko_mode,
    timoshenko_ratio,
    wave_speed_ratio,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def elements():
    return WIDE.modal()


def test_the_reference_frequency_is_that_of_an_euler_beam_where_it_is_slender_and_lower_where_it_is_not():
    slender, stocky = Bar(length=3.0), Bar(length=0.12)
    for bar, low, high in ((slender, 0.998, 1.0), (stocky, 0.8, 0.9)):
        euler = 1.8751041**2 / bar.length**2 * np.sqrt(bar.young * bar.thickness**2 / 12 / bar.density)
        assert low < timoshenko_mode(bar, 2).omega / euler < high


@pytest.mark.parametrize("axis", [1, 2])
def test_the_first_frequency_of_a_cantilever_converges_to_timoshenkos(axis):
    error = [abs(timoshenko_ratio(fitted(SLIM, cells, 2.0), SLIM, axis) - 1) / 2 for cells in (2.7, 4, 6)]
    assert error[0] < 5e-3
    assert error[-1] < 1e-3
    assert all(finer < 0.7 * coarser for coarser, finer in pairwise(error)), error


def test_the_static_deflection_of_a_cantilever_converges_to_timoshenkos():
    error = [abs(static_ratio(fitted(SLIM, cells, 2.0), SLIM, 2) - 1) for cells in (2, 3, 4)]
    assert error[0] < 0.02
    assert error[-1] < 4e-3
    assert all(finer < coarser for coarser, finer in pairwise(error)), error


def test_three_fitted_cells_bend_more_truly_than_six_laid_out_plainly():
    coarse, fine = (abs(timoshenko_ratio(lattice, SLIM, 2) - 1) for lattice in (fitted(SLIM, 3, 1.5), plain(SLIM, 6, 1.5)))
    assert coarse < 0.015
    assert fine > 0.02


def test_a_stretching_pulse_runs_at_the_speed_of_sound_of_a_bar():
    error = [abs(wave_speed_ratio(cells, 2.0) - 1) for cells in (2, 3, 4)]
    assert error[0] < 0.012
    assert error[-1] < 4e-3
    assert all(finer < 0.7 * coarser for coarser, finer in pairwise(error)), error


@pytest.mark.parametrize(("cells", "per_cell"), [(2.7, 2.0), (3, 1.5), (3, 2.0), (4, 1.5)])
def test_a_fitted_grid_bends_and_stretches_within_two_percent_of_finite_elements(elements, cells, per_cell):
    found = apparent_by_kind(fitted(WIDE, cells, per_cell), elements, WIDE)
    assert [found[kind] for kind in ("bend_z", "bend_y", "stretch")] == pytest.approx([1.0] * 3, abs=0.02)


def test_one_particle_per_cell_is_several_percent_off(elements):
    found = apparent_by_kind(fitted(WIDE, 3, 1.0), elements, WIDE)
    assert 1.03 < found["bend_z"] < 1.1


def test_the_clamp_plane_sets_the_stiffness_and_lies_where_bending_is_right(elements):
    bend = [apparent_by_kind(fitted(WIDE, 3, 2.0, offset=offset), elements, WIDE)["bend_z"] for offset in (-0.25, 0.0, 0.25)]
    assert bend[0] < 0.96 < 0.985 < bend[1] < 1.015 < 1.05 < bend[2]


@pytest.mark.parametrize("cells", [3, 4])
def test_twisting_is_slow_by_the_inertia_that_affine_particles_add_to_the_section(elements, cells):
    dx = WIDE.thickness / cells
    polar = (WIDE.width**2 + WIDE.thickness**2) / 12
    found = apparent_by_kind(fitted(WIDE, cells, 2.0), elements, WIDE)
    assert found["twist"] == pytest.approx(polar / (polar + 2 * dx**2 / 4), rel=0.02)
