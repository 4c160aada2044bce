"""Symmetric matrices of one pattern with their entries near the diagonal: much faster to fill and to solve than general sparse ones, many times over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_banded, solveh_banded
from scipy.sparse.csgraph import reverse_cuthill_mckee


@dataclass(frozen=True)
class Band:
    """Where the entries of elements' matrices go in a band over some degrees of freedom, ordered after Cuthill and McKee (1969)."""

    order: np.ndarray  # the degrees of freedom, row by row, (D,)
    taken: np.ndarray  # of the elements' entries, all in a row: those on the diagonal and below it, (K,)
    slots: np.ndarray  # their places in the band, row after row, (K,)
    width: int  # of the band: diagonals, with the main one

    @classmethod
    def of(cls, pattern: sp.csc_matrix, chosen: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Band:
        """Of a symmetric pattern (S, S) whose `chosen` degrees of freedom (D,) count; rows and columns are those of the elements' entries."""
        full = sp.csr_matrix((np.ones(len(pattern.data)), pattern.indices, pattern.indptr), pattern.shape)
        order = chosen[reverse_cuthill_mckee(full[chosen][:, chosen], symmetric_mode=True)]
        place = np.full(pattern.shape[0], -1)
        place[order] = np.arange(len(order))
        i, j = place[rows], place[columns]
        taken = np.flatnonzero((j >= 0) & (i >= j))
        below = i[taken] - j[taken]
        return cls(order, taken, below * len(order) + j[taken], int(below.max(initial=0)) + 1)

    def filled(self, local: np.ndarray) -> np.ndarray:
        """The band (width, D), lower form, of elements' symmetric matrices, whose entries are summed."""
        size = len(self.order)
        return np.bincount(self.slots, local.ravel()[self.taken], self.width * size).reshape(self.width, size)


def solved(band: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x (D,) of A x = right, A of a band (width, D). Raises numpy.linalg.LinAlgError where A is singular."""
    try:
        return np.asarray(solveh_banded(band, right, lower=True, check_finite=False))
    except np.linalg.LinAlgError:  # not positive definite: crushed elements
        beyond = len(band) - 1
        above = [np.concatenate([np.zeros(k), row[: len(row) - k]]) for k, row in reversed(list(enumerate(band))) if k]
        return np.asarray(solve_banded((beyond, beyond), np.concatenate([above, band]) if above else band, right, check_finite=False))
