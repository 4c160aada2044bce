"""One fit: grid, unknowns, what the motion is compared with, and the loss's curvature at the start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.ndimage import binary_dilation

from ..config import Settings
from ..devices import usable
from ..errors import InputError
from ..particles import DensePoints, bind, dense_points
from ..start.along import Stiff, along_of
from ..types import Splats, StartValues
from .carried import CarriedGaussians
from .curvature import track_hessian
from .engines import Engine, engines
from .evidence import EVIDENCE, Told
from .evidence.pixels import static_background
from .floor import floor_planes
from .forward import Discretisation, ForwardModel, discretise, reach_of
from .law import law_to_fit
from .linear import footprint_load
from .linear_model import UNKNOWN_TO_MODES
from .loss import Objective
from .observed import TrackTarget, acceleration_scale, displacement_scale, liveliest_acceleration
from .placement import in_body_pose
from .prepared import Prepared
from .prior import Prior
from .resolution import Plan, make_plan
from .unknowns import Layout, checked_hold

MISSING = 0.1  # share of the motion missed by linear modes from which their forced frames are taken with a margin
MARGIN = 2  # frames on either side
INITIAL_MODES, RIGID_MODES = 4, 6  # modal coordinates of an unknown initial motion, and those that move a body as a whole, which nothing holds
SHIFTS = np.linspace(-0.5, 0.5, 11)  # of log E, tried where the start values may lie in a wrong valley
RIDGE = 1e-6  # curvature of the loss that is taken for certain in every direction: what nobody sees stays as it is


@dataclass
class Problem:
    """Everything that one fit needs."""

    prepared: Prepared
    settings: Settings
    plan: Plan
    disc: Discretisation
    layout: Layout
    field_unit: float  # of a force field [N/m^3]
    target: TrackTarget
    forward: ForwardModel
    renderer: CarriedGaussians | None
    engines: Mapping[str, Engine]
    objective: Objective
    hessian: np.ndarray

    @property
    def metric(self) -> np.ndarray:
        """Inverse of the loss's curvature in the blocks that are not held, (k, k)."""
        index = self.layout.index(self.layout.free)
        return np.asarray(np.linalg.inv(self.hessian[np.ix_(index, index)]))


def pose_problem(
    prepared: Prepared, splats: Splats | None, settings: Settings, *, behind: np.ndarray | None = None, dtype: torch.dtype = torch.float32, start_scale: float = 1.0
) -> Problem:
    """Grid, unknowns, loss and its curvature; `dtype` of the simulation. behind uint8 (H, W, 3): the scene without the object, None: it is read from the
    clip. The solver begins `start_scale` times off the start values."""
    clip, body, device = prepared.clip, prepared.body, usable(settings.fit.device)
    dense = _dense(prepared, splats) if settings.experiment.downsample_ratio else None
    plan = make_plan(
        body,
        prepared.start.young,
        frames=len(clip) - 1,
        period_s=clip.period_s,
        settings=settings,
        device=device,
        reach_m=reach_of(prepared),
        dense=0 if dense is None else len(dense.x),
        ahead=simulated_ahead(prepared),
    )
    disc = discretise(prepared, plan, device=device, dense=dense)
    renderer = None if splats is None else _renderer(prepared, disc, splats, behind, settings.experiment.splat_edge_px, device)
    return problem_on(prepared, settings, plan, disc, renderer, dtype=dtype, start_scale=start_scale)


def problem_on(
    prepared: Prepared, settings: Settings, plan: Plan, disc: Discretisation, renderer: CarriedGaussians | None, *, dtype: torch.dtype, start_scale: float = 1.0
) -> Problem:
    """The problem on a grid that there is already, whatever the start values are."""
    clip, body, device = prepared.clip, prepared.body, usable(settings.fit.device)
    start = scaled_start(with_wider_support(prepared.start), start_scale / disc.apparent)
    initial_modes = 0 if settings.scene.at_rest else min(INITIAL_MODES if body.clamped else RIGID_MODES, prepared.modal.modes)
    force_unit = acceleration_scale(prepared.tracks, clip.period_s) * float(body.density.mean())
    held = checked_hold(settings.fit.hold) | (UNKNOWN_TO_MODES if not settings.experiment.simulates else frozenset())
    layout = Layout.of(start, body, force_unit=force_unit * _concentration(prepared), initial_modes=initial_modes, motion_unit=_motion_unit(prepared), held=held)
    target = TrackTarget.of(prepared.tracks, body, clip.camera, dtype=dtype, device=device)
    planes = floor_planes(body, disc.particles, settings.scene, prepared.clip.camera, dx=plan.dx)
    forward = ForwardModel(prepared, disc, layout, device=device, dtype=dtype, law=law_to_fit(settings), planes=planes, simulates=plan.simulates, nodal=_nodal(settings))
    binding = bind(target.rest_points, disc.particles.x_rest)
    told = Told(prepared, settings.experiment, forward.simulator.x_rest, forward.simulator.tensor(disc.particles.volume), target, binding, renderer, plan.image_every)
    evidence = {kind: term for kind, made in EVIDENCE.items() if (term := made(told)) is not None}
    precision = None if prepared.zones is None else prepared.zones.log_young_precision
    stiff = Stiff.of(along_of(body), prepared.modal, has_depth=prepared.tracks.has_depth)
    prior = Prior.of(layout, start, start_scale=start_scale, ways=stiff.ways, precision=precision, tracked=settings.experiment.track_weight > 0)
    weights = settings.experiment
    per_motion = weights.track_weight + (weights.image_weight + weights.depth_weight if "pixels" in evidence else 0.0)
    hessian = per_motion * track_hessian(prepared, layout, target, initial_modes=initial_modes) + prior.hessian + RIDGE * np.eye(layout.size)
    return Problem(prepared, settings, plan, disc, layout, _field_unit(prepared, settings, force_unit), target, forward, renderer, engines(forward), Objective(evidence, prior, target, binding), hessian)


def _nodal(settings: Settings) -> bool:
    """Whether forces act on the grid's nodes. Raises InputError where the schedule begins with forces that act on particles."""
    experiment = settings.experiment
    if experiment.force_frame == "nodes" and not experiment.published:
        raise InputError(f"experiment.force_frame is nodes with experiment.schedule {experiment.schedule}; choose the schedule paper, or rest or current")
    return experiment.force_frame == "nodes"


def _field_unit(prepared: Prepared, settings: Settings, force_unit: float) -> float:
    """Of a force field [N/m^3]. Where fields alone move the body from rest it must do the worst: bring it in a frame to where the liveliest one has
    it, and hold it bent as far as is seen, for which a stiff body that moves slowly needs far more than its accelerations say."""
    if not settings.experiment.published:
        return force_unit
    tracks, density = prepared.tracks, float(prepared.body.density.mean())
    bent = (2 * np.pi * float(prepared.start.frequencies_hz[0])) ** 2 * displacement_scale(tracks)
    return density * float(np.hypot(liveliest_acceleration(tracks, prepared.clip.period_s), bent))


def _concentration(prepared: Prepared) -> float:
    """How many times that of a uniform force the amplitude under the footprint has to be, to move the body as far."""
    return float(np.linalg.norm(prepared.modal.footprint_load()) / np.linalg.norm(footprint_load(prepared)))


def _renderer(prepared: Prepared, disc: Discretisation, splats: Splats, behind: np.ndarray | None, edge_px: int, device: str) -> CarriedGaussians:
    clip, particles = prepared.clip, disc.particles.x_rest
    behind = static_background(clip, edge_px=edge_px) if behind is None else behind
    places = in_body_pose(prepared.tracks, splats.mean.astype(float))
    return CarriedGaussians.of(splats, particles, clip.camera, behind, world_from_particles=prepared.body.world_from_body, places=places, device=device)


def simulated_ahead(prepared: Prepared) -> float:
    """How many times the clip, without gradient, is simulated before the search: a period to calibrate the grid, and the trials of other
    moduli where the start values may lie in a wrong valley."""
    clip, start = prepared.clip, prepared.start
    period = 1 / (max(float(start.frequencies_hz[0]), 1e-3) * (len(clip) - 1) * clip.period_s)
    return period + (len(SHIFTS) if start.track_cost > MISSING**2 else 0)


def with_wider_support(start: StartValues) -> StartValues:
    """Start values with a margin of frames that may carry a force as well, where linear modes, which the forced frames were read from, miss
    much of the motion."""
    if start.track_cost <= MISSING**2 or not start.forced.any():
        return start
    return replace(start, forced=binary_dilation(start.forced, iterations=MARGIN))


def scaled_start(start: StartValues, factor: float) -> StartValues:
    """Start values with Young's modulus multiplied by a factor; all else as it was."""
    return start if factor == 1.0 else replace(start, young=start.young * factor)


def _dense(prepared: Prepared, splats: Splats | None) -> DensePoints:
    """What experiment.downsample_ratio is a share of."""
    surface = np.zeros((0, 3)) if splats is None else in_body_pose(prepared.tracks, splats.mean.astype(float))
    return dense_points(prepared.body, prepared.body.to_body(surface))


def _motion_unit(prepared: Prepared) -> np.ndarray:
    """Units of initial modal coordinates and rates, (2, r): those that move the tracks by as much as they were seen to move."""
    tracks, modal = prepared.tracks, prepared.modal
    moved = float(np.sqrt(((tracks.points - tracks.points[:1])[tracks.valid] ** 2).sum(-1).mean()))
    shape = modal.evaluate(prepared.body.to_body(tracks.points[0]))[0]
    size = np.sqrt((shape**2).sum(1).mean(0))
    omega = 2 * np.pi * np.maximum(modal.frequencies(prepared.start.young), 0.1)
    return np.stack([moved / size, moved * omega / size])
