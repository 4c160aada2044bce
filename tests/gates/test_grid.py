"""A grid of two cells with one particle each is an eighth too stiff. Two cells bend as truly as more once that is measured, so the bounds
on the stiffness are those of finer grids."""

from __future__ import annotations

import numpy as np

from .conftest import ROUGH, Recover

TOO_COARSE = ("--experiment.cells", "2", "--experiment.per_cell", "1")
YOUNG = 0.0135  # of log10 E
OFF = 0.04  # of log10 E, by which the grid is off at least


def test_a_coarse_grid_finds_the_true_stiffness(recovered: Recover) -> None:
    answer = recovered("bar", *TOO_COARSE, *ROUGH)
    assert np.abs(answer.log10_young_error).max() < YOUNG
    assert np.log10(answer.metrics["apparent_stiffness"]) > OFF, "this grid is true by itself: the gate shows nothing"
    assert answer.metrics["refined"]
