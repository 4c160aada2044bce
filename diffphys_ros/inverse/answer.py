"""From the end of a search to the Recovery: fields on the body's own particles, world frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ..damping import Damping
from ..metrics.image import psnr_frozen_frame, psnr_masked, ssim_masked
from ..particles import held_by
from ..types import Clip, ModalProblem, MpmProblem, Recovery, object_mask
from .carried import CarriedGaussians
from .forward import Discretisation, ForwardModel, Motion
from .linear import footprint_load, linear_motion
from .loss import Terms
from .material_prior import describe_prior
from .placement import offset_of_first
from .posterior import Confidence
from .prepared import Prepared


@dataclass(frozen=True)
class Core:
    """Physics and motion, body frame, on all particles."""

    young: np.ndarray  # corrected [Pa], (P,)
    poisson: np.ndarray  # (P,)
    density: np.ndarray  # [kg/m^3], (P,)
    displacement: np.ndarray  # from frame 0 [m], (T, P, 3)
    F: np.ndarray  # since frame 0, (T, P, 3, 3)
    force: np.ndarray  # amplitude of the family [N/m^3], (T, 3)
    field_force: np.ndarray | None  # on top of it [N/m^3], (T - 1, P, 3)
    velocity0: np.ndarray  # [m/s], (P, 3)
    damping: Damping[float]
    simulation: MpmProblem | ModalProblem  # that gave the displacement

    @property
    def refined(self) -> bool:
        """Whether the material points made the motion."""
        return isinstance(self.simulation, MpmProblem)


def simulated_answer(forward: ForwardModel, terms: Terms) -> Core:
    """The refined unknowns and the simulated motion."""
    disc, motion = forward.disc, terms.motion
    assert motion is not None
    unknowns = motion.unknowns

    def array(tensor: torch.Tensor) -> np.ndarray:
        return as_simulated(tensor).astype(float)

    return Core(
        array(motion.young) * disc.apparent,
        disc.particles.poisson if motion.poisson is forward.poisson else array(motion.poisson),
        disc.particles.density if motion.density is None else array(motion.density),
        array(motion.displacement),
        array(motion.F),
        np.zeros_like(array(unknowns.force)) if motion.node_force is not None else array(unknowns.force),
        None if motion.field_force is None else array(motion.field_force),
        array(motion.start.v),
        unknowns.damping.numbers(),
        mpm_problem(forward, motion),
    )


def mpm_problem(forward: ForwardModel, motion: Motion) -> MpmProblem:
    """What the simulator was given for this motion, in its own scalar type: converted no further, so that it can be had again."""
    p, start, damping, planes = forward.disc.particles, motion.start, forward.damping, forward.planes
    values = {
        "young": motion.young,
        "poisson": motion.poisson,
        "position": start.x,
        "velocity": start.v,
        "velocity_gradient": start.C,
        "deformation_gradient": start.F,
        "force": motion.unknowns.force if motion.node_force is None else torch.zeros_like(motion.unknowns.force),
        "force_weight": forward.weights,
        "damping_shapes": damping.shapes,
        "damping_gradients": damping.gradients,
        "damping_frequencies": damping.angular_frequencies,
        "damping_own": damping.own,
    } | ({} if damping.retuning is None else {"retuning": damping.retuning})
    return MpmProblem(
        ghost=p.ghost,
        rest=p.x_rest,
        volume=p.volume,
        density=p.density if motion.density is None else as_simulated(motion.density).astype(float),
        **{name: as_simulated(value) for name, value in values.items()},
        law=forward.law,
        plane_normal=np.array([plane.normal for plane in planes], float).reshape(-1, 3),
        plane_offset=np.array([plane.offset_m for plane in planes], float),
        plane_friction=np.array([plane.friction for plane in planes], float),
        plane_kind=np.array([plane.kind for plane in planes], str),
        field_force=None if motion.field_force is None or motion.node_force is not None else as_simulated(motion.field_force),
        node=None if forward.nodes is None else forward.nodes.number.cpu().numpy(),
        node_force=None if motion.node_force is None else as_simulated(motion.node_force),
    )


def as_simulated(tensor: torch.Tensor) -> np.ndarray:
    """The values of a tensor, in its scalar type."""
    return tensor.detach().cpu().contiguous().numpy()


def linear_answer(prepared: Prepared, disc: Discretisation) -> Core:
    """The start values and their linear motion."""
    start = prepared.start
    displacement, F = linear_motion(prepared, disc.basis, disc.basis_gradient)
    velocity0, p = disc.basis @ start.initial_velocity, disc.particles
    young = start.young[p.part - 1]
    return Core(young, p.poisson, p.density, displacement, F, start.force, None, velocity0, start.damping, modal_problem(prepared, disc))


def modal_problem(prepared: Prepared, disc: Discretisation) -> ModalProblem:
    """What the start values' linear motion follows from."""
    start, modal, own = prepared.start, prepared.modal, disc.particles.own
    return ModalProblem(
        rest=disc.particles.x_rest[own],
        young=start.young[disc.particles.part[own] - 1],
        basis=disc.basis[own],
        elastic=modal.elastic(start.young),
        geometric=modal.geometric,
        retuning=modal.retuning,
        load=footprint_load(prepared),
        force=start.force,
        initial_displacement=start.initial_displacement,
        initial_velocity=start.initial_velocity,
    )


def assemble(
    prepared: Prepared,
    disc: Discretisation,
    core: Core,
    renderer: CarriedGaussians | None,
    *,
    confidence: Confidence,
    substeps: int,
    metrics: dict[str, object],
) -> Recovery:
    """The Recovery with rendered frames and image metrics."""
    body, start, p, own = prepared.body, prepared.start, disc.particles, disc.particles.own
    weight = start.footprint.weights(p.x_rest[own])
    force = body.rotate_to_world(core.force)[:, None] * weight[None, :, None]
    if core.field_force is not None:
        force[:-1] += body.rotate_to_world(core.field_force[:, own])
    rest = body.to_world(p.x_rest[own])
    placed = offset_of_first(prepared.tracks, rest)
    trajectory = body.to_world(p.x_rest[own] + core.displacement[:, own]) + placed
    frames = None if renderer is None else renderer.clip(p.x_rest + core.displacement, core.F)
    part = p.part[own] - 1
    return Recovery(
        points=rest + placed,
        volume=p.volume[own],
        part=p.part[own],
        young=core.young[own],
        log10_young_sd=confidence.log10_young_sd[part],
        poisson=core.poisson[own],
        density=core.density[own],
        poisson_sd=start.material.poisson_sd[part],
        density_sd=core.density[own] * start.material.density_log_sd[part],
        young_lower=confidence.young_lower[part],
        log10_specific_sd=confidence.log10_specific_sd(start.material)[part],
        force=force.astype(np.float32),
        net_force_sd=np.full((len(force), 3), np.nan),
        net_force_peak=np.nan,
        net_force_peak_sd=np.nan,
        trajectory=trajectory.astype(np.float32),
        clamped=held_by(disc.grid, p.x_rest[own]),
        frames=frames,
        world_from_body=body.world_from_body,
        gravity=body.gravity,
        simulation=core.simulation,
        apparent_stiffness=disc.apparent,
        grid=disc.grid,
        period_s=prepared.clip.period_s,
        substeps=substeps,
        damping=core.damping,
        initial_velocity=body.rotate_to_world(core.velocity0[own]),
        identified=confidence.identified,
        reasons=confidence.reasons,
        metrics=metrics | {"observed_hz": start.observed_hz.tolist()} | _force_metrics(confidence) | {f"{name}_source": text for name, text in body.sources.items()} | image_metrics(prepared, frames),
        notes=notes(prepared, confidence),
        force_identified=confidence.force_identified,
        force_reason=confidence.force_reason,
    )


def image_metrics(prepared: Prepared, frames: np.ndarray | None) -> dict[str, object]:
    """Masked PSNR and SSIM over the run's own object mask of each frame, beside the frozen first frame's."""
    clip = prepared.clip
    if frames is None or clip.labels is None:
        return {}
    later = [k for k in shown_frames(clip) if k > 0]
    frozen = [ssim_masked(clip.frames[0], clip.frames[k], object_mask(clip.labels[k])) for k in later]
    return {
        **nearness(clip, frames),
        "psnr_masked_frozen_frame": float(np.mean(psnr_frozen_frame(clip.frames, clip.labels)[[k - 1 for k in later]])),
        "ssim_masked_frozen_frame": float(np.mean(frozen)),
    }


def nearness(clip: Clip, frames: np.ndarray) -> dict[str, float]:
    """Masked PSNR and SSIM of rendered frames (T, H, W, 3), means over those that were received and show the object."""
    assert clip.labels is not None
    labels, shown = clip.labels, shown_frames(clip)
    measures = {"psnr_masked": psnr_masked, "ssim_masked": ssim_masked}
    return {name: float(np.mean([measure(frames[k], clip.frames[k], object_mask(labels[k])) for k in shown])) for name, measure in measures.items()}


def shown_frames(clip: Clip) -> np.ndarray:
    """Numbers of the frames that were received and show the object."""
    assert clip.labels is not None
    return np.flatnonzero(clip.seen & [object_mask(labels).any() for labels in clip.labels])


def _force_metrics(confidence: Confidence) -> dict[str, object]:
    return {"force_identified": confidence.force_identified, "force_reason": confidence.force_reason}


def notes(prepared: Prepared, confidence: Confidence) -> tuple[str, ...]:
    """What was assumed and what is not known, one sentence each."""
    unknown = [f"part {number} is not identified: {why}" for number, (known, why) in enumerate(zip(confidence.identified, confidence.reasons, strict=True), 1) if not known]
    unknown += [] if confidence.force_identified else [f"the force is not identified: {confidence.force_reason}"]
    said = [f"{name.replace('_', ' ')}: {text}" for name, text in sorted(prepared.body.sources.items())]
    of_prior = (describe_prior(prepared.prior), *prepared.prior.notes) if prepared.prior else ()
    scale = prepared.body.scale
    unknown += [] if scale.absolute else [f"scale: {scale.words}"]
    return (*unknown, *prepared.clip.notes, f"depth: {prepared.depth_source}", *of_prior, *said)
