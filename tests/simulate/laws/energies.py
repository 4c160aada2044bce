"""The laws again, in plain torch: energies per rest volume, and what a material that flows makes of F. F (P, 3, 3), constants (P, 4)."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

Energy = Callable[[Tensor, Tensor], Tensor]


def _elastic(strain: Callable[[Tensor], Tensor], F: Tensor, constants: Tensor) -> Tensor:
    """mu |e|^2 + lam / 2 tr(e)^2 of principal strains that are a function of the stretches."""
    e = strain(torch.linalg.svdvals(F))
    return constants[:, 0] * e.square().sum(-1) + constants[:, 1] / 2 * e.sum(-1) ** 2


def neo_hookean(F: Tensor, constants: Tensor) -> Tensor:
    mu, lam, log_j = constants[:, 0], constants[:, 1], torch.logdet(F)
    return mu / 2 * (F.square().sum((1, 2)) - 3) - mu * log_j + lam / 2 * log_j**2


def fixed_corotated(F: Tensor, constants: Tensor) -> Tensor:
    stretches = torch.linalg.svdvals(F)
    return constants[:, 0] * (stretches - 1).square().sum(-1) + constants[:, 1] / 2 * (torch.det(F) - 1) ** 2


def linear_corotated(F: Tensor, constants: Tensor) -> Tensor:
    return _elastic(lambda s: s - 1, F, constants)


def st_venant_kirchhoff(F: Tensor, constants: Tensor) -> Tensor:
    return _elastic(lambda s: (s.square() - 1) / 2, F, constants)


def hencky(F: Tensor, constants: Tensor) -> Tensor:
    return _elastic(torch.log, F, constants)


def packed(F: Tensor, constants: Tensor) -> Tensor:
    return torch.where(torch.det(F) < 1, hencky(F, constants), 0.0)


def tait(F: Tensor, constants: Tensor) -> Tensor:
    j, bulk, gamma = torch.det(F), constants[:, 1] + 2 / 3 * constants[:, 0], constants[:, 3]
    return bulk / gamma * (j + j ** (1 - gamma) / (gamma - 1))


ENERGIES: dict[str, Energy] = {
    "neo_hookean": neo_hookean,
    "fixed_corotated": fixed_corotated,
    "linear_corotated": linear_corotated,
    "st_venant_kirchhoff": st_venant_kirchhoff,
    "drucker_prager": packed,
    "von_mises": hencky,
    "weakly_compressible": tait,
}


def stress(law: str, F: Tensor, constants: Tensor) -> Tensor:
    """Kirchhoff stress as the derivative of the energy, itself differentiable."""
    with torch.enable_grad():
        variable = F if F.requires_grad else F.clone().requires_grad_()
        (first_piola,) = torch.autograd.grad(ENERGIES[law](variable, constants).sum(), variable, create_graph=True)
    return first_piola @ F.mT


def von_mises_radius(trace: Tensor, constants: Tensor) -> Tensor:
    return math.sqrt(2 / 3) * constants[:, 2] / (2 * constants[:, 0])


def drucker_prager_radius(trace: Tensor, constants: Tensor) -> Tensor:
    mu, lam, sine = constants[:, 0], constants[:, 1], torch.sin(constants[:, 2])
    return (2 * mu + 3 * lam) / (2 * mu) * math.sqrt(2 / 3) * 2 * sine / (3 - sine) * (-trace).clamp_min(0.0)


RADII: dict[str, Energy] = {"von_mises": von_mises_radius, "drucker_prager": drucker_prager_radius}


def project(law: str, F: Tensor, constants: Tensor) -> Tensor:
    """What is left of F once the material has flowed."""
    if law == "weakly_compressible":
        return torch.det(F)[:, None, None] ** (1 / 3) * torch.eye(3, dtype=F.dtype)
    if law not in RADII:
        return F
    U, s, Vh = torch.linalg.svd(F)
    trace = s.log().sum(-1)
    dev = s.log() - trace[:, None] / 3
    size = torch.linalg.vector_norm(dev, dim=-1)
    kept = torch.clamp_max(RADII[law](trace, constants) / size, 1.0)
    return U @ torch.diag_embed(torch.exp(trace[:, None] / 3 + kept[:, None] * dev)) @ Vh


def viscous_stress(law: str, F: Tensor, C: Tensor, constants: Tensor) -> Tensor:
    """Kirchhoff stress of a velocity gradient."""
    if law != "weakly_compressible":
        return torch.zeros_like(F)
    twice = C + C.mT - 2 / 3 * C.diagonal(dim1=1, dim2=2).sum(-1)[:, None, None] * torch.eye(3, dtype=F.dtype)
    return (constants[:, 2] * torch.det(F))[:, None, None] * twice
