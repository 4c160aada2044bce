"""The paper's equation 3: unknowns -> fields -> simulation -> rendering -> how far that is from the clip."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import torch

from ..config import Experiment
from ..errors import SimulationError
from ..fields import (
    FORCE_FIELDS,
    MATERIAL_FIELDS,
    Believed,
    Bounds,
    Box,
    ForceField,
    ForceSizes,
    Material,
    MaterialField,
    MaterialSizes,
    NodeForce,
    Smoothness,
    pretrain,
)  # fmt: skip
from ..simulate.stability import wave_speed
from .descent import Space
from .forward import reach_of
from .loss import Terms
from .material_prior import on_points
from .prior import Prior
from .problem import Problem
from .stages import Stage
from .unknowns import POISSON_UNIT

SPAN = 30.0  # factor about the moduli that constants ended with, within which E of a field may lie
VARIATION_SD = 0.3  # prior standard deviation of log10 E of a field about those, beside theirs
FORCE = 1e-4  # weight of the mean square force of a field, in its unit


class Model:
    """Values of all unknowns as tensors, and what they cost.

    It begins with constants per part and one vector per frame; `begin_fields` lets fields go on where those ended.
    """

    def __init__(self, problem: Problem, z: np.ndarray | None = None) -> None:
        self.problem = problem
        sizes = {name: place.stop - place.start for name, place in problem.layout.slices.items()}
        self.blocks = {name: torch.nn.Parameter(torch.zeros(size, dtype=torch.float64)) for name, size in sizes.items()}
        self.engine, self.evidence = problem.engines["mpm"], tuple(problem.objective.evidence)
        self.published = problem.settings.experiment.published
        self.material: MaterialField | None = None
        self.force: ForceField | None = None
        self.put(problem.layout.start if z is None else z)

    @property
    def z(self) -> torch.Tensor:
        """The vector of unknowns, (size,)."""
        return torch.cat(list(self.blocks.values()))

    def put(self, z: np.ndarray) -> None:
        """Give all blocks the values of a vector (size,)."""
        Space(list(self.blocks.values())).assign(z)

    def enter(self, stage: Stage) -> None:
        """Be moved by the stage's engine and compared with its evidence; fields begin with the first stage that has them."""
        self.engine, self.evidence = self.problem.engines[stage.engine], stage.evidence
        if stage.fields and self.material is None:
            self.begin_fields()

    def space(self, free: Collection[str]) -> Space:
        """The named blocks and fields as one vector: fields of force first, then blocks, then fields of material."""
        force = list(self.force.parameters()) if self.force is not None and "force_field" in free else []
        material = list(self.material.parameters()) if self.material is not None and "material_field" in free else []
        return Space([*force, *(block for name, block in self.blocks.items() if name in free and block.numel()), *material])

    def begin_fields(self) -> None:
        """Fields, where the settings ask for them, that begin at what the blocks say."""
        fit, experiment = self.problem.settings.fit, self.problem.settings.experiment
        forward = self.problem.forward
        base = _base(self.problem, self.z.detach().numpy())
        bounds = _bounds(self.problem, base)
        generator, place = torch.Generator().manual_seed(experiment.seed), forward.simulator.options
        self.x, self.frames = forward.simulator.x_rest, torch.arange(len(self.problem.prepared.clip) - 1, device=forward.device)
        material, force = sizes(experiment)
        self.material = MATERIAL_FIELDS[fit.material_field](base, bounds, generator=generator, sizes=material).to(**place)
        self.follows = experiment.force_frame != "current"
        self.asked, asked = self._asked()
        box = Box.around(asked if self.follows else _passed(self.problem))
        if experiment.force_frame == "nodes" and fit.force_field == "voxels":
            self.force = NodeForce(box, len(self.frames), self.problem.field_unit, places=asked, generator=generator, sizes=force).to(**place)
        else:
            self.force = FORCE_FIELDS[fit.force_field](box, len(self.frames), self.problem.field_unit, generator=generator, sizes=force).to(**place)
        self.start = Material(*(value.detach() for value in base.at(self.x)))
        if fit.material_field == "triplane":
            pretrain(self.material, self.x, self.start, bounds)
        self.smoothness = Smoothness.of(asked, device=forward.device)
        self.allowed = forward.simulator.tensor(_allowed(self.problem))[:, None, None]
        self.tightness = forward.simulator.tensor(_tightness(self.problem))

    def _asked(self) -> tuple[torch.Tensor, np.ndarray]:
        """Where a force field is asked while that does not move: at rest positions, or at the nodes that it acts on, (K, 3) [m]."""
        forward = self.problem.forward
        if forward.nodes is None:
            return self.x, self.problem.disc.particles.x_rest
        places = forward.nodes.places(self.problem.disc.grid)
        return forward.simulator.tensor(places), places

    def __call__(self) -> Terms:
        """The loss of the unknowns as they are, infinite where the simulation leaves its bounds."""
        forward, objective, z = self.problem.forward, self.problem.objective, self.z
        unknowns = self.problem.layout.unpack(z.to(forward.device, forward.dtype), modes=forward.basis.shape[2])
        material = None if self.material is None else self.material(self.x)
        if self.engine is forward:
            self._carry(material)
        young = unknowns.young[forward.part] if material is None else material.young
        try:
            motion = self.engine.simulate(unknowns, young, None if material is None else material.poisson, self._pushes(), report=objective.watch)
        except SimulationError as error:
            return objective.failed(str(error))
        terms = objective.terms(z, motion, self.evidence)
        if material is not None and motion.field_force is not None:
            acted = motion.field_force if motion.node_force is None else motion.node_force
            extra = self._field_prior(material, acted / self.problem.field_unit).double().cpu()
            terms.parts["fields"] = float(extra.detach())
            terms.total = terms.total + extra
        return terms

    def _pushes(self):  # type: ignore[no-untyped-def]
        """A force field's densities, or the function that gives them where particles are; None without a field."""
        if self.force is None:
            return None
        return self.force(self.asked, self.frames) * self.allowed if self.follows else self._force_at

    def _force_at(self, x: torch.Tensor, frame: int) -> torch.Tensor:
        """Where the particles are at the start of a frame (paper Eq. 9)."""
        assert self.force is not None
        return self.force(x, self.frames[frame : frame + 1])[0] * self.allowed[frame]

    def _field_prior(self, material: Material, force: torch.Tensor) -> torch.Tensor:
        """What `Prior` asks of constants and vectors, of fields: near what those ended with, small and smooth; smooth alone where the loss is
        the published one (A.12)."""
        if self.published:
            return self.problem.settings.experiment.force_smoothness * self.smoothness(force)
        away = (material.young / self.start.young).log().square() @ self.tightness
        ratio = ((material.poisson - self.start.poisson) / POISSON_UNIT).square().mean()
        size = FORCE * force.square().sum(-1).mean() + self.problem.settings.experiment.force_smoothness * self.smoothness(force)
        return 0.5 * (Prior.LOG_YOUNG * (away + ratio) + len(force) * size)

    def _carry(self, material: Material | None) -> None:
        """Lay out the substeps anew where the fastest wave has passed what they carry."""
        forward, layout, p = self.problem.forward, self.problem.layout, self.problem.disc.particles
        least = layout.young_of(self.z.detach().numpy())
        if material is not None:
            young, poisson = (value.detach().double().cpu().numpy() for value in (material.young, material.poisson))
            as_stiff = young * (wave_speed(1.0, poisson, 1.0) / wave_speed(1.0, p.poisson, 1.0)) ** 2
            least = np.array([as_stiff[p.part == k + 1].max(initial=e) for k, e in enumerate(least)])
        forward.ensure_substeps(least)


def sizes(experiment: Experiment) -> tuple[MaterialSizes, ForceSizes]:
    """How fine fields are."""
    e = experiment
    material = MaterialSizes(e.material_nodes, e.material_channels, e.decoder_width)
    return material, ForceSizes(e.force_voxels, e.force_plane_nodes, e.force_channels, e.decoder_width)


def _base(problem: Problem, z: np.ndarray) -> Believed:
    """The search's moduli on the particles; inside a part the prior's pattern, where there is one that varies there."""
    p, prepared = problem.disc.particles, problem.prepared
    young, poisson = problem.layout.young_of(z)[p.part - 1], problem.layout.poisson_of(z)[p.part - 1]
    if prepared.prior is not None:
        pattern, _ = on_points(prepared.prior, prepared.body, prepared.clip.camera, p.x_rest)
        log_pattern = np.log(pattern)
        volume = np.bincount(p.part, p.volume)
        mean = np.bincount(p.part, p.volume * log_pattern) / np.maximum(volume, 1e-300)
        young = young * np.exp(np.clip(log_pattern - mean[p.part], -np.log(SPAN), np.log(SPAN)))
    return Believed(p.x_rest, young, poisson)


def _bounds(problem: Problem, base: Believed) -> Bounds:
    """SPAN about the moduli, no higher than experiment.max_substeps carry."""
    young, carried = base.young, problem.forward.simulator.max_young(problem.settings.experiment.max_substeps)
    return Bounds(float(young.min()) / SPAN, max(min(float(young.max()) * SPAN, carried), 1.001 * float(young.max())), log=True)


def _passed(problem: Problem) -> np.ndarray:
    """Points (K, 3) [m] that bound where the body was seen to go: at rest, and moved as far as any track to every side."""
    x, reach = problem.disc.particles.x_rest, reach_of(problem.prepared)
    return np.concatenate([x - reach, x + reach])


def _allowed(problem: Problem) -> np.ndarray:
    """1 in the frames (T - 1,) that may carry a force, 0 in those that are known to be free."""
    return np.isin(np.arange(len(problem.prepared.clip) - 1), problem.layout.forced).astype(float)


def _tightness(problem: Problem) -> np.ndarray:
    """Weights (P,) of squared log E: each part's mean, over its prior variance. Without zones the start values' own spread holds
    only if the part is one material, which is what a field doubts."""
    p, start = problem.disc.particles, problem.prepared.start
    doubt = VARIATION_SD if problem.prepared.zones is None else 0.0
    variance = np.log(10) ** 2 * (start.log10_young_sd[p.part - 1] ** 2 + doubt**2)
    return 1 / (variance * np.bincount(p.part)[p.part])
