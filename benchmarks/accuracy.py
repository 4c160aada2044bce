"""How right the simulator is, in one command: python benchmarks/accuracy.py [--figures docs/figures]

Clamped bars against Timoshenko's beam and quadratic finite elements, by cells over the thickness, particles per cell and axis,
offset of the clamp plane, and kind of motion. Minutes on one core. Values are E_apparent / E: squared ratios of frequencies.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import torch
from bars import KINDS, SLIM, WIDE, apparent_by_kind, fitted, plain, sparse, static_ratio, timoshenko_ratio, wave_speed_ratio
from table import Row, record, row

RESOLUTIONS = (2.7, 4, 6, 8)  # cells over the thickness
STATIC_RESOLUTIONS = (2, 3, 4, 6)  # double precision takes its time
PER_CELL = 2.0
GRIDS = tuple((cells, per_cell) for cells in (2.7, 3, 4, 6) for per_cell in (1.0, 1.5, 2.0))
SPARSE = tuple((cells, per_cell) for cells in (3, 4) for per_cell in (1.0, 1.5, 2.0, 3.0))
SPARSE_STATIC = (1.0, 2.0)
OFFSETS = (-0.5, -0.25, 0.0, 0.25, 0.5)  # of the held plane from where fit_grid puts it, in cells; positive: inside the body
LINES = {"plain": plain, "fitted": fitted}

Table = dict[str, dict[float, float]]  # line -> abscissa -> ratio


def frequencies() -> Table:
    """First bending frequency, squared, over Timoshenko's."""
    return {name: {cells: timoshenko_ratio(lay(SLIM, cells, PER_CELL), SLIM, 2) for cells in RESOLUTIONS} for name, lay in LINES.items()}


def deflections() -> Table:
    """Timoshenko's static tip deflection over the simulated one."""
    return {name: {cells: static_ratio(lay(SLIM, cells, PER_CELL), SLIM, 2) for cells in STATIC_RESOLUTIONS} for name, lay in LINES.items()}


def orders(line: dict[float, float]) -> list[float]:
    """Observed order of convergence between neighbouring resolutions."""
    return [math.log(abs(a - 1) / abs(b - 1)) / math.log(fine / coarse) for (coarse, a), (fine, b) in pairwise(line.items())]


def by_kind(lattices: dict[str, Callable[[], object]]) -> dict[str, dict[str, float]]:
    """Against finite elements, for each kind of motion."""
    elements = WIDE.modal()
    return {name: apparent_by_kind(lattice(), elements, WIDE) for name, lattice in lattices.items()}  # type: ignore[arg-type]


def show(title: str, lines: dict[str, list[float]], columns: list[str]) -> None:
    """A table for people."""
    print(f"\n{title}\n{'':24s}" + "".join(f"{c:>10s}" for c in columns))
    for name, values in lines.items():
        print(f"{name:24s}" + "".join(f"{v:10.4f}" for v in values))


def beam_rows(title: str, name: str, table: Table) -> list[Row]:
    """Print a table with its observed orders; its rows."""
    resolutions = list(next(iter(table.values())))
    show(title, {k: list(line.values()) for k, line in table.items()}, [f"{c:g} cells" for c in resolutions])
    show("observed order", {k: orders(line) for k, line in table.items()}, [f"{a:g}-{b:g}" for a, b in pairwise(resolutions)])
    return [row(f"{name}_{k}_{c:g}c", v, "E/E", device="cpu") for k, line in table.items() for c, v in line.items()]


def kind_rows(title: str, name: str, table: dict[str, dict[str, float]]) -> list[Row]:
    """Print a table over kinds of motion; its rows."""
    show(title, {k: [line[kind] for kind in KINDS] for k, line in table.items()}, list(KINDS))
    return [row(f"{name}_{kind}_{k.replace(' ', '_')}", line[kind], "E/E", device="cpu") for k, line in table.items() for kind in KINDS]


def main() -> None:
    """Measure on one core of this machine."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=Path, help="folder for the plots of docs/measurements/accuracy.md")
    figures = parser.parse_args().figures
    torch.set_num_threads(1)
    frequency, deflection = frequencies(), deflections()
    grids = by_kind({f"{c:g}c {p:g}ppc": lambda c=c, p=p: fitted(WIDE, c, p) for c, p in GRIDS})
    offsets = by_kind({f"3c {o:+g}": lambda o=o: fitted(WIDE, 3, PER_CELL, offset=o) for o in OFFSETS})
    thinned = by_kind({f"{c:g}c {p:g}ppc": lambda c=c, p=p: sparse(WIDE, c, p) for c, p in SPARSE})
    rows = beam_rows("first bending frequency, squared, over Timoshenko's", "timoshenko_frequency", frequency)
    rows += beam_rows("static deflection: Timoshenko's over the simulated one", "timoshenko_deflection", deflection)
    rows += kind_rows("against finite elements, by cells and particles per cell and axis", "apparent", grids)
    rows += kind_rows("down-sampled particles, against finite elements", "sparse", thinned)
    rows += [row(f"sparse_deflection_{p:g}ppc", static_ratio(sparse(SLIM, 3, p), SLIM, 2), "E/E", device="cpu") for p in SPARSE_STATIC]
    rows += kind_rows("against finite elements, by offset of the clamp plane in cells", "apparent", offsets)
    rows += [row(f"bar_wave_speed_{c}c", wave_speed_ratio(c, PER_CELL), "c/c", device="cpu") for c in (2, 3, 4)]
    print()
    record(rows)
    if figures:
        from accuracy_figures import draw

        draw(figures, frequency=frequency, deflection=deflection, grids=grids, offsets={o: offsets[f"3c {o:+g}"] for o in OFFSETS})


if __name__ == "__main__":
    main()
