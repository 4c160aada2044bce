"""The runs that the tables compare: each a configuration and what it changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

CONFIG = Path("config/paper.yaml")
VALIDATION_FRAMES = 5  # of the paper's tables 3 and 4
QUICK: Mapping[str, str] = {"frames.fit": "12", "fit.time_budget_s": "60"}  # for a look at the page, not for its figures
QUICK_PAPER: Mapping[str, str] = {"experiment.transition_iterations": "4", "experiment.field_iterations": "3", "experiment.splat_iterations": "100"}


@dataclass(frozen=True)
class Variant:
    """A row: `flags` are settings by dotted name, as words; `published` whether config/paper.yaml lies below them."""

    name: str
    table: int
    published: bool = True
    flags: Mapping[str, str] = field(default_factory=dict)

    def settings(self, *, device: str, quick: bool) -> dict[str, str]:
        """All its flags on a device. A quick run simulates on the coarsest grid, but where the grid is what the row is about."""
        hurried = {**QUICK, **(QUICK_PAPER if self.published else {}), **({"experiment.grid_nodes": "32"} if self.published else {})} if quick else {}
        return {**hurried, **self.flags, "fit.device": device}


def _validation(**flags: str) -> dict[str, str]:
    return {"frames.fit": str(VALIDATION_FRAMES), **{f"experiment.{name}": value for name, value in flags.items()}}


VARIANTS = (
    Variant("paper", 1),
    Variant("default", 1, published=False),
    Variant("force_only", 2, flags={"fit.hold": "density,damping,young"}),
    Variant("material_only", 2, flags={"fit.hold": "density,damping,force"}),
    Variant("ratio_0.01", 3, flags=_validation(downsample_ratio="0.01", per_cell="0")),
    Variant("ratio_0.02", 3, flags=_validation(downsample_ratio="0.02", per_cell="0")),
    Variant("grid_32", 4, flags=_validation(grid_nodes="32")),
    Variant("grid_64", 4, flags=_validation(grid_nodes="64")),
    Variant("grid_128", 4, flags=_validation(grid_nodes="128")),
)
