"""Young's modulus by part: its error, and what was stated of it."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from .truth import Arrays


def score_young(truth: Arrays, nearest: np.ndarray, recovery: Arrays) -> dict[str, object]:
    """Figures by the truth's parts, of the median over points off the interface; `nearest` (N,) is the truth vertex of each point.

    young_log10_sd: the stated standard deviation of log10 E; young_lower_log10: log10(least modulus / true) of a part that is not
    identified, below 0 where the bound is true; specific_log10_error and specific_log10_sd: the same for E / density, which
    motion tells without a mass. None where most of a part's points hold no such number (a few of a neighbour's lie beyond the border), and for
    all of them where the files do not hold it.
    """
    young = recovery["young"]
    off, part = ~truth["interface"][nearest], truth["vertex_part"][nearest]
    true = [float(e) for e in truth["part_E"]]

    def medians(values: np.ndarray) -> list[float | None]:
        return [_median(values[off & (part == k)]) for k in range(len(true))]

    def stated(name: str) -> list[float | None]:
        return medians(np.where(np.isfinite(young), recovery[name], np.nan))

    log_young = medians(np.log10(young))
    error = _less(log_young, np.log10(true))
    ratios = [abs(a - b) for a, b in combinations([e for e in error if e is not None], 2)]
    figures: dict[str, object] = {
        "young_log10_error": error,
        "young_ratio_error": max(ratios, default=None),
        "young_pa": [None if m is None else 10**m for m in log_young],
        "young_true_pa": true,
    }
    if "log10_young_sd" in recovery:
        figures["young_log10_sd"] = stated("log10_young_sd")
    if "young_lower" in recovery:
        figures["young_lower_log10"] = _less(medians(np.log10(recovery["young_lower"])), np.log10(true))
    if "density" in recovery and "log10_specific_sd" in recovery and "part_rho" in truth:
        specific = medians(np.log10(young / recovery["density"]))
        figures["specific_log10_error"] = _less(specific, np.log10(true / truth["part_rho"]))
        figures["specific_log10_sd"] = stated("log10_specific_sd")
    return figures


def _less(found: list[float | None], true: np.ndarray) -> list[float | None]:
    return [None if f is None else f - float(t) for f, t in zip(found, true, strict=True)]


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if 2 * len(known) > len(values) else None
