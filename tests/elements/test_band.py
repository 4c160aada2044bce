"""Claims about banded matrices."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from diffphys_ros.elements.band import Band, solved

PAIRS = np.array([[0, 7], [7, 3], [3, 9], [9, 1], [1, 8], [8, 2], [2, 6], [6, 4], [4, 5]])  # a chain in no order


@pytest.fixture
def chain() -> tuple[Band, np.ndarray, sp.csc_matrix]:
    """Springs of a chain of ten nodes, of which node 0 is held: their band, their matrices (9, 2, 2) and their sum."""
    rows, columns = np.repeat(PAIRS, 2, 1).ravel(), np.tile(PAIRS, (1, 2)).ravel()
    local = np.arange(1.0, 10.0)[:, None, None] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    full = sp.csc_matrix((local.ravel(), (rows, columns)), (10, 10))
    return Band.of(full, np.arange(1, 10), rows, columns), local, full


def test_a_chain_needs_one_diagonal_beside_the_main_one(chain: tuple[Band, np.ndarray, sp.csc_matrix]) -> None:
    band, local, full = chain
    assert band.filled(local).shape == (2, 9)
    own = full[band.order][:, band.order].toarray()
    np.testing.assert_array_equal(band.filled(local)[0], np.diag(own))
    np.testing.assert_array_equal(band.filled(local)[1, :-1], np.diag(own, -1))


def test_what_is_solved_is_the_whole_matrix_over_what_is_free(chain: tuple[Band, np.ndarray, sp.csc_matrix]) -> None:
    band, local, full = chain
    right = np.arange(9.0)
    found = solved(band.filled(local), right)
    np.testing.assert_allclose(full[band.order][:, band.order] @ found, right, atol=1e-12)


def test_a_matrix_need_not_be_positive_definite(chain: tuple[Band, np.ndarray, sp.csc_matrix]) -> None:
    band, local, _ = chain
    local = local * np.where(np.arange(9) % 2, -1, 1)[:, None, None]
    right = np.arange(9.0)
    found = solved(band.filled(local), right)
    own = sp.csc_matrix((local.ravel(), (np.repeat(PAIRS, 2, 1).ravel(), np.tile(PAIRS, (1, 2)).ravel())), (10, 10))[band.order][:, band.order]
    np.testing.assert_allclose(own @ found, right, atol=1e-12)


def test_a_singular_matrix_is_refused(chain: tuple[Band, np.ndarray, sp.csc_matrix]) -> None:
    band, local, _ = chain
    with pytest.raises(np.linalg.LinAlgError):
        solved(band.filled(0 * local), np.ones(9))
