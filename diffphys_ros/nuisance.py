"""Functions of time that are in whatever is observed, by factors that nobody knows: what they explain as well counts the less for or against anything else. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Nuisance:
    """Weighs what is observed, in standard deviations of its noise, as if such functions were part of the noise (generalised least squares: Aitken 1935)."""

    columns: np.ndarray  # orthonormal functions of time, (K, m)
    kept: np.ndarray  # share of them that is left, (m,)

    @classmethod
    def of(cls, functions: np.ndarray) -> Nuisance:
        """Of functions of time (K, n), each as large as its factor of one standard deviation makes it, over the noise."""
        columns, size, _ = np.linalg.svd(functions, full_matrices=False)
        return cls(columns, 1 / np.sqrt(1 + size**2))

    def weighed(self, over_time: np.ndarray) -> np.ndarray:
        """Numbers (K, ...) with noise alike in all frames instead."""
        share = (1 - self.kept)[:, None] * self.columns.T
        return np.asarray(over_time - np.tensordot(self.columns, np.tensordot(share, over_time, 1), 1))
