"""What each thing that is told buys: rows of the same clips by what a run knew, judged by what it published."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from calibration_clips import KINDS

NO_MASS, NO_LENGTH = "relative: nobody told a mass", "relative: nobody told a length"  # how the words of a result's scale begin
BEYOND = 3.0  # stated deviations: what was published is wrong there, and confident

Row = dict[str, Any]


class Told(NamedTuple):
    """One published number of stiffness: the error of its log10, and what was stated."""

    error: float
    sd: float

    @property
    def z(self) -> float:
        """Error in stated deviations."""
        return abs(self.error) / self.sd


def told_by(row: Row) -> list[Told]:
    """E of each part, E/density where no mass is known, and where no length is the ratio of each part to the one that is known best."""
    if row["state"] != "done":
        return []
    scale = str(row.get("scale", ""))
    what = "specific" if scale.startswith(NO_MASS) else "young"
    pairs = zip(row.get(f"{what}_log10_error") or [], row.get(f"{what}_log10_sd") or [], strict=True)
    found = [Told(float(error), float(sd)) for error, sd in pairs if error is not None and sd]
    if not scale.startswith(NO_LENGTH) or not found:
        return found
    best = min(found, key=lambda one: one.sd)
    return [Told(one.error - best.error, float(np.hypot(one.sd, best.sd))) for one in found if one is not best]


def table(rows: Sequence[Row], kinds: Sequence[str]) -> list[list[str]]:
    """Lines of the table: a figure, and its cell for each kind."""
    of_kind = {kind: [row for row in rows if row["kind"] == kind] for kind in kinds}
    lines = [["", *(KINDS[kind].words for kind in kinds)], ["---"] * (len(kinds) + 1)]
    return lines + [[name, *(figure(of_kind[kind]) if of_kind[kind] else "-" for kind in kinds)] for name, figure in FIGURES.items()]


def _all(rows: Sequence[Row]) -> list[Told]:
    return [one for row in rows for one in told_by(row)]


def _identified(rows: Sequence[Row]) -> str:
    return f"{sum(len([e for e in row.get('young_log10_error') or [] if e is not None]) for row in rows)} of {sum(row['materials'] for row in rows)}"


def _scale(rows: Sequence[Row]) -> str:
    names = {NO_MASS: "E/density", NO_LENGTH: "ratios", "absolute": "E"}
    seen = [name for row in rows for begin, name in names.items() if str(row.get("scale", "")).startswith(begin)]
    return max(set(seen), key=seen.count) if seen else "-"


def _percentiles(of: Callable[[Sequence[Row]], Iterator[float]], form: str, *percent: float) -> Callable[[Sequence[Row]], str]:
    def figure(rows: Sequence[Row]) -> str:
        values = list(of(rows))
        return ", ".join(f"{np.percentile(values, p):{form}}" for p in percent) if values else "-"

    return figure


def _counted(count: Callable[[Told], bool]) -> Callable[[Sequence[Row]], str]:
    return lambda rows: f"{sum(map(count, _all(rows)))} of {len(_all(rows))}"


def _errors(rows: Sequence[Row]) -> Iterator[float]:
    return (abs(one.error) for one in _all(rows))


def _sds(rows: Sequence[Row]) -> Iterator[float]:
    return (one.sd for one in _all(rows))


def _frequencies(rows: Sequence[Row]) -> Iterator[float]:
    """Errors of the leading frequency over it."""
    return (abs(row["observed_hz"] / row["hz"] - 1) for row in rows if row.get("observed_hz") and row.get("hz"))


def _cosines(rows: Sequence[Row]) -> Iterator[float]:
    return (row["net_force_cosine"] for row in rows if row.get("force_identified") and row.get("net_force_cosine") is not None)


FIGURES: dict[str, Callable[[Sequence[Row]], str]] = {
    "clips": lambda rows: str(len(rows)),
    "runs that end without a result": lambda rows: str(sum(row["state"] != "done" for row in rows)),
    "stiffness is told as": _scale,
    "parts that are identified": _identified,
    "size of the error of its log10: median, 90 %": _percentiles(_errors, ".3f", 50, 90),
    "stated sd, median": _percentiles(_sds, ".3f", 50),
    "inside 2 sd": _counted(lambda one: one.z <= 2),
    "confident and wrong: beyond 3 sd": _counted(lambda one: one.z > BEYOND),
    "leading frequency, error over it: median": _percentiles(_frequencies, ".1%", 50),
    "forces that are identified": lambda rows: f"{sum(bool(row.get('force_identified')) for row in rows)} of {len(rows)}",
    "their cosine, median": _percentiles(_cosines, ".3f", 50),
}
