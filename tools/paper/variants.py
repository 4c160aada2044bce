"""The runs that the tables compare: each a configuration and what it changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from diffphys_ros.inverse.prepared import LEAST_FRAMES

CONFIG = Path("config/paper.yaml")
VALIDATION_FRAMES = 5  # of the paper's tables 3 and 4, the first ones
QUICK: Mapping[str, str] = {"frames.fit": "12"}  # for a look at the page, not for its figures
QUICK_DEFAULT: Mapping[str, str] = {"fit.time_budget_s": "60"}  # the published schedule's forces are sought one after the other: cut short it has none
QUICK_PAPER: Mapping[str, str] = {"experiment.transition_iterations": "6", "experiment.field_iterations": "3", "experiment.splat_iterations": "100", "experiment.max_splats": "5000"}


@dataclass(frozen=True)
class Variant:
    """A row: `flags` are settings by dotted name, as words; `published` whether config/paper.yaml lies below them."""

    name: str
    table: int
    published: bool = True
    flags: Mapping[str, str] = field(default_factory=dict)
    scored: int | None = None  # frames that count, the first ones; None: all
    quick: bool = True  # whether it is among the rows of a quick run

    def settings(self, *, device: str, quick: bool) -> dict[str, str]:
        """All its flags on a device. A quick run simulates on the coarsest grid, but where the grid is what the row is about."""
        hurried = {**QUICK, **(QUICK_PAPER if self.published else QUICK_DEFAULT), **({"experiment.grid_nodes": "32"} if self.published else {})} if quick else {}
        return {**hurried, **self.flags, "fit.device": device}


def _validation(name: str, table: int, *, quick: bool = True, **flags: str) -> Variant:
    """A row of few frames, of which no fewer can be fitted than LEAST_FRAMES."""
    settings = {"frames.fit": str(max(VALIDATION_FRAMES, LEAST_FRAMES)), **{f"experiment.{key}": value for key, value in flags.items()}}
    return Variant(name, table, flags=settings, scored=VALIDATION_FRAMES, quick=quick)


VARIANTS = (
    Variant("paper", 1),
    Variant("default", 1, published=False),
    Variant("force_only", 2, flags={"fit.hold": "density,damping,young"}),
    Variant("material_only", 2, flags={"fit.hold": "density,damping,force"}),
    _validation("ratio_0.01", 3, downsample_ratio="0.01", per_cell="0"),
    _validation("ratio_0.02", 3, downsample_ratio="0.02", per_cell="0"),
    _validation("grid_32", 4, grid_nodes="32"),
    _validation("grid_64", 4, grid_nodes="64"),
    _validation("grid_128", 4, quick=False, grid_nodes="128"),  # 64 times the particles of a quick run
)
