"""A mask's border in order, and pieces of a closed row."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.mask_border import border, runs


def test_the_border_is_that_of_the_largest_piece_step_by_step_counterclockwise() -> None:
    mask = np.zeros((20, 30), bool)
    mask[3:9, 4:14] = mask[15, 20] = True
    found = border(mask)
    assert len(found) == 2 * (6 + 10) - 4
    assert (np.abs(np.diff(np.vstack([found, found[:1]]), axis=0)).max(1) == 1).all()
    u, v = found.T.astype(float)
    assert (u * np.roll(v, -1) - np.roll(u, -1) * v).sum() < 0, "of a v that points down"


@pytest.mark.parametrize(("flags", "pieces"), [("110011", [[4, 5, 0, 1]]), ("011010", [[1, 2], [4]]), ("000", []), ("111", [[0, 1, 2]])])
def test_pieces_of_a_closed_row_go_on_over_its_end(flags: str, pieces: list[list[int]]) -> None:
    found = [run.tolist() for run in runs(np.array([f == "1" for f in flags]))]
    assert sorted(found) == sorted(pieces)
