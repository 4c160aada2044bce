"""How fine and how long: cells, particles and iterations that end inside the time budget.

The choice rests on fixed rates per device, not on a stop-watch, so that the same clip and settings give the same result on
every run, however busy the machine; a run that takes longer all the same is stopped by clock.py.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np
import torch

from ..config import LONGEST_BUDGET_S, TIME_BUDGET_S, Experiment, Settings
from ..errors import InputError
from ..particles import spacing_of_nodes
from ..simulate import substeps_per_frame
from ..types import Body

# seconds per particle and substep, forward + backward, and per rendered frame; from benchmarks/substep.py, rounded up
RATES = {"cpu": (8e-7, 0.06), "cuda": (2e-9, 0.004)}
LEAST_SUBSTEP_S = {"cpu": 2e-5, "cuda": 5e-5}  # launches, however few the particles
GRIDS = ((6, 2.0), (5, 2.0), (4, 2.0), (4, 1.6), (3, 2.0), (3, 1.6), (2, 2.0), (2, 1.6))  # (cells over the thickness, particles per cell and axis), best first
TRUE_PER_CELL = min(per_cell for _, per_cell in GRIDS)  # particles per cell and axis from which a grid bends truly, far too: they keep their weights (ANCHORED_PER_CELL, simulate/transition.py)
LEAST_SPARSE = 3  # cells that a share of dense points is put on; coarser grids are for clips that are too dear for it
SHOWN_COLUMNS = 4000  # of particles over the silhouette, at most, where nothing is simulated
ENOUGH = 4  # cells that bend as truly as more (docs/measurements/accuracy.md) and twist within what the calibration takes up
QUICK_S = 30.0  # a fit on more cells than that must not take longer
WANTED_ITERATIONS, MOST_ITERATIONS, LEAST_ITERATIONS = 8, 16, 3
STEPS_PER_ITERATION = 1.15  # forward runs of rejected steps included
FIT_SHARE = 0.6  # of the time budget for search and training; the rest is for what comes before and after
SEARCH_SHARE = 0.4  # of that, where fields are trained after the search
FORWARD_SHARE = 0.35  # of forward + backward that forward alone takes
STATE_BYTES, FORCE_BYTES = 96, 12  # of a particle
RENDER_SHARE = 0.3  # of an iteration, at most, spent on images

Grid = tuple[float, float]  # cells over the thickness, particles per cell and axis


@dataclass(frozen=True)
class Plan:
    """What a fit will do."""

    cells: float  # over the thickness
    per_cell: float  # particles per cell and axis
    dx: float  # [m]
    substeps: int  # per frame, at the start
    iterations: int
    image_every: int  # frames between two that enter the image term
    seconds_per_iteration: float  # expected [s]
    seconds_ahead: float  # expected of what is simulated before the first iteration [s]
    memory_bytes: float  # of a rollout and its gradient (docs/simulator.md)
    kept: int = 0  # particles that are left of dense points; 0: they fill a lattice
    refusal: str = ""  # why nothing is simulated, one sentence; empty where it is

    @property
    def simulates(self) -> bool:
        """Whether the solver runs; else the start values are the answer."""
        return not self.refusal

    def seconds(self, iterations: int) -> float:
        """Expected of the search with so many iterations [s]."""
        return self.seconds_ahead + iterations * self.seconds_per_iteration

    def text(self) -> str:
        """One line for people."""
        if self.refusal:
            return self.refusal
        few = f" (fewer than {TRUE_PER_CELL:g} bend several percent off)" if self.per_cell < TRUE_PER_CELL else ""
        return (
            f"{self.cells:.3g} cells over the thickness (dx {1e3 * self.dx:.2f} mm), {self.per_cell:.3g} particles per cell and axis{few}, "
            f"{self.substeps} substeps a frame, {self.iterations} iterations of about {self.seconds_per_iteration:.1f} s, "
            f"every {self.image_every}. frame in the image term, {self.memory_bytes / 2**20:.0f} MB for the motion"
        )


def make_plan(
    body: Body, young: np.ndarray, *, frames: int, period_s: float, settings: Settings, device: str, reach_m: float = 0.0, dense: int = 0, ahead: float = 0.0
) -> Plan:
    """The finest grid on which the wanted iterations fit into the search's share of the time budget, into QUICK_S where it is finer than
    ENOUGH; the cheapest one where none does. A plan that simulates nothing where even that is too dear, in time, substeps or memory.

    Args:
        body: the filled solid.
        young: per part [Pa], shape (n,).
        frames: to simulate.
        period_s: between frames [s].
        settings: `particles.*`, `fit.*` and `experiment.*`.
        device: cpu or cuda:0.
        reach_m: how far the body moves [m], for a grid of experiment.grid_nodes.
        dense: points of which experiment.downsample_ratio keeps a share.
        ahead: simulations of so many times the clip, without gradient, that come before the first iteration.

    Raises:
        InputError: a grid that was asked for cannot be had, or the kept particles are too few for any.
    """
    grids = _grids(body, settings, reach_m, dense)
    plans = [_plan_on(grid, body, young, frames, period_s, settings, device, ahead) for grid in grids]
    if not settings.experiment.simulates:
        return _without_simulation(min(plans, key=lambda p: p.substeps), body, "experiment.schedule is linear")
    possible = [p for p in plans if not _forbidden(p, young, settings, device)]
    if not possible:
        cheapest = min(plans, key=lambda p: p.substeps)
        why = _forbidden(cheapest, young, settings, device)
        if _asked(settings):
            raise InputError(f"particles: {why}; leave experiment.cells, experiment.grid_nodes and experiment.downsample_ratio out for a grid that can be had")
        return _without_simulation(cheapest, body, why)
    budget_s, wanted = search_budget_s(settings, device), settings.fit.iterations or WANTED_ITERATIONS
    plan = _finest(possible, wanted, budget_s, QUICK_S if not _asked(settings) else budget_s)
    plan = replace(plan, kept=round(settings.experiment.downsample_ratio * dense))
    if settings.fit.iterations:
        return plan
    if plan.seconds(LEAST_ITERATIONS) > budget_s and not _asked(settings):
        why = f"{plan.cells:.3g} cells over the thickness with {plan.substeps} substeps a frame take about {plan.seconds(LEAST_ITERATIONS):.0f} s, the time budget leaves {budget_s:.2g} s"
        return _without_simulation(plan, body, why)
    return _with_iterations(plan, budget_s)


def _without_simulation(plan: Plan, body: Body, why: str) -> Plan:
    """The start values as the answer, on particles that only show it: no more than SHOWN_COLUMNS over the silhouette."""
    dx = max(plan.dx, plan.per_cell * (body.silhouette_m2 / SHOWN_COLUMNS) ** 0.5)
    return replace(plan, dx=dx, cells=_thickness(body) / dx, iterations=0, refusal=f"not simulated: {why}")


def _finest(plans: list[Plan], wanted: int, budget_s: float, quick_s: float) -> Plan:
    """The first plan that ends in time, with more cells than ENOUGH in `quick_s` [s]; the quickest where none does."""
    fitting = [p for p in plans if p.seconds(wanted) <= (budget_s if p.cells <= ENOUGH else min(budget_s, quick_s))]
    return fitting[0] if fitting else min(plans, key=lambda p: p.seconds(wanted))


def _asked(settings: Settings) -> bool:
    """Whether a person chose the grid."""
    experiment = settings.experiment
    return settings.experiment.cells > 0 or experiment.grid_nodes is not None or experiment.downsample_ratio > 0


def _forbidden(plan: Plan, young: np.ndarray, settings: Settings, device: str) -> str:
    """What of the machine or the settings rules a plan out, in words; empty where nothing does."""
    grid = f"{plan.cells:.3g} cells over the thickness with {plan.per_cell:.3g} particles per cell and axis need"
    if plan.substeps > settings.experiment.max_substeps:
        return f"{grid} {plan.substeps} substeps a frame at E = {young.max():.3g} Pa, {settings.experiment.max_substeps} are the most"
    memory = _memory(device)
    if plan.memory_bytes > memory:
        return f"{grid} {plan.memory_bytes / 2**30:.1f} GiB, the device has {memory / 2**30:.1f}"
    return ""


def _memory(device: str) -> float:
    """Of the device [B]; no bound where it is not there to be asked."""
    if device.startswith("cuda"):
        return float(torch.cuda.get_device_properties(device).total_memory) if torch.cuda.is_available() else np.inf
    return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")


def time_budget_s(settings: Settings, device: str) -> float:
    """What a whole clip may take [s], from reading to files."""
    return settings.fit.time_budget_s or TIME_BUDGET_S[_kind(device)]


def longest_budget_s(settings: Settings, device: str) -> float:
    """The same where fields have to carry the video: as told, and longer where nobody told it."""
    return settings.fit.time_budget_s or LONGEST_BUDGET_S[_kind(device)]


def search_budget_s(settings: Settings, device: str) -> float:
    """What of it the search over constants and vectors may take [s]; where fields are wanted, they have a share of their own."""
    return FIT_SHARE * time_budget_s(settings, device) * (SEARCH_SHARE if fields_wanted(settings) else 1.0)


def _kind(device: str) -> str:
    return "cuda" if device.startswith("cuda") else "cpu"


def fields_wanted(settings: Settings) -> bool:
    """Whether the settings ask for fields beyond constants per part and vectors per frame."""
    return settings.fit.material_field != "part" or settings.fit.force_field != "frame"


def _with_iterations(plan: Plan, budget_s: float) -> Plan:
    count = int(np.clip((budget_s - plan.seconds_ahead) / plan.seconds_per_iteration, LEAST_ITERATIONS, MOST_ITERATIONS))
    return replace(plan, iterations=count)


def _grids(body: Body, settings: Settings, reach_m: float, dense: int) -> list[Grid]:
    """What may be chosen from, best first."""
    cells, experiment = float(settings.experiment.cells), settings.experiment
    if experiment.grid_nodes:
        if cells:
            raise InputError(f"experiment.cells {cells:g} and experiment.grid_nodes {experiment.grid_nodes} are both given; leave one of them out")
        cells = _thickness(body) / spacing_of_nodes(body, experiment.grid_nodes, reach_m)
    if experiment.downsample_ratio:
        return _sparse_grids(body, experiment, cells, dense)
    return list(dict.fromkeys((cells or c, experiment.per_cell or p) for c, p in GRIDS))


def _sparse_grids(body: Body, experiment: Experiment, cells: float, dense: int) -> list[Grid]:
    """Those on which the kept share of `dense` points is at least one particle per cell, those on which it is enough first."""
    ratio, kept = experiment.downsample_ratio, round(experiment.downsample_ratio * dense)
    if experiment.per_cell:
        raise InputError(f"experiment.per_cell {experiment.per_cell:g} and experiment.downsample_ratio {ratio:g} are both given; leave one of them out")
    found = [(c, _thickness(body) / c * (kept / body.volume_m3) ** (1 / 3)) for c in dict.fromkeys(cells or c for c, _ in GRIDS if c >= LEAST_SPARSE)]
    if found[-1][1] < 1:
        coarsest = found[-1][0]
        need = int(np.ceil(body.volume_m3 * (coarsest / _thickness(body)) ** 3))
        cure = f"raise it to {1.01 * need / dense:.2g} or lower {'experiment.grid_nodes' if experiment.grid_nodes else 'experiment.cells'}"
        raise InputError(
            f"experiment.downsample_ratio {ratio:g}: keeps {kept} of {dense} points, must keep at least one in each of the {need} cells that the body "
            f"fills at {coarsest:.3g} cells over its thickness; {cure if need <= dense else 'raise experiment.max_splats'}"
        )
    return sorted((grid for grid in found if grid[1] >= 1), key=lambda grid: grid[1] < TRUE_PER_CELL)


def _thickness(body: Body) -> float:
    return float(body.sides_m[2])


def _plan_on(grid: Grid, body: Body, young: np.ndarray, frames: int, period_s: float, settings: Settings, device: str, ahead: float) -> Plan:
    cells, per_cell = grid
    dx = _thickness(body) / cells
    substeps = substeps_per_frame(young, body.poisson, body.density, dx=dx, period_s=period_s)
    count = body.volume_m3 / (dx / per_cell) ** 3
    kind = _kind(device)
    rate, render_s = RATES[kind]
    simulate_s = frames * substeps * (count * rate + LEAST_SUBSTEP_S[kind])
    every = settings.experiment.image_every or int(np.clip(np.ceil(frames * render_s / (RENDER_SHARE * simulate_s)), 1, max(1, frames // 6)))
    seconds = STEPS_PER_ITERATION * (simulate_s + frames / every * render_s)
    memory = STATE_BYTES * count * (2 * frames + 2 * substeps**0.5 + 7) + FORCE_BYTES * count * frames
    return Plan(cells, per_cell, dx, substeps, settings.fit.iterations or WANTED_ITERATIONS, every, seconds, ahead * FORWARD_SHARE * simulate_s, memory)
