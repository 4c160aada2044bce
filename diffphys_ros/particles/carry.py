"""Gaussians carried by the particles that they are bound to."""

from __future__ import annotations

import torch

from ..rotations import polar_rotation, product, quaternion_of
from .skinning import Binding


def deform_splats(
    binding: Binding, mean0: torch.Tensor, rotation0: torch.Tensor, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor | None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Means and rotations of Gaussians in every frame (paper A.11), differentiable.

    Means move by the weighted displacement of their particles; covariances turn by the rotation of the local deformation gradient.

    Args:
        binding: of the Gaussians' means to the particles at x0.
        mean0: frame 0 [m], shape (G, 3).
        rotation0: unit quaternions wxyz, shape (G, 4).
        x: particles in every frame [m], shape (T, P, 3).
        x0: particles in frame 0 [m], shape (P, 3).
        F: deformation gradients since frame 0, shape (T, P, 3, 3); None: from the particles' positions.

    Returns:
        mean (T, G, 3) [m], rotation (T, G, 4) wxyz.
    """
    mean = mean0 + binding.apply(x - x0)
    if F is None:
        local = _position_gradient(binding, x, x0)
    else:
        local = binding.apply(F.reshape(*F.shape[:-2], 9)).reshape(*x.shape[:-2], len(mean0), 3, 3)
    return mean, product(quaternion_of(polar_rotation(local)), rotation0.expand(*mean.shape[:-1], 4))


def _position_gradient(binding: Binding, x: torch.Tensor, x0: torch.Tensor) -> torch.Tensor:
    """Deformation gradients (T, G, 3, 3). Where a Gaussian's particles do not span space, a sheet's normal stays its normal; a thread
    and a single particle tell no more than they can."""
    index = torch.as_tensor(binding.index, device=x.device)
    gradient = torch.as_tensor(binding.gradient, dtype=x.dtype, device=x.device)
    found = torch.einsum("...mki,mkj->...mij", x[..., index, :], gradient)
    spanned = torch.einsum("mki,mkj->mij", x0[index], gradient)
    unit = torch.eye(3, dtype=x.dtype, device=x.device)
    rank = spanned.diagonal(dim1=-2, dim2=-1).sum(-1)[:, None, None]
    normal = torch.where(rank > 1.5, _cofactors(found), unit)
    return found + normal @ (unit - spanned)


def _cofactors(matrix: torch.Tensor) -> torch.Tensor:
    """Of matrices (..., 3, 3): how areas turn."""
    a, b, c = matrix.unbind(-2)
    return torch.stack([torch.linalg.cross(b, c), torch.linalg.cross(c, a), torch.linalg.cross(a, b)], -2)
