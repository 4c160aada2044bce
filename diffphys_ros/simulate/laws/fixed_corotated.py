"""Fixed corotated solid (Stomakhin et al. 2012): P = 2 mu (F - R) + lam (J - 1) J F^-T with the rotation R of F.

With b = F F^T this is tau = 2 mu (b - sqrt(b)) + lam (J - 1) J I.
"""

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

import warp as wp

from . import isotropic
from .law import Functions, Law


def build(real: type) -> Functions:
    """Stress and its adjoint over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)
    s = isotropic.build(real)
    stretch, stretch_adjoint = s.stretch, s.stretch_adjoint

    @wp.func
    def stress(F: mat33, constants: vec4):
        _U, _values, root = stretch(F)
        j = wp.determinant(F)
        shear = F * wp.transpose(F) - root
        return real(2.0) * constants[0] * shear + constants[1] * (j - real(1.0)) * j * wp.identity(3, dtype=real)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        mu = real(2.0) * constants[0]
        U, values, root = stretch(F)
        j = wp.determinant(F)
        trace_bar = wp.trace(tau_bar)
        j_bar = constants[1] * (real(2.0) * j - real(1.0)) * trace_bar
        F_bar = mu * ((tau_bar + wp.transpose(tau_bar)) * F) - mu * stretch_adjoint(F, U, values, tau_bar)
        F_bar = F_bar + (j_bar * j) * wp.transpose(wp.inverse(F))
        mu_bar = real(2.0) * wp.ddot(tau_bar, F * wp.transpose(F) - root)
        return F_bar, vec4(mu_bar, (j - real(1.0)) * j * trace_bar, real(0.0), real(0.0))

    return Functions(stress, stress_adjoint)


LAW = Law(build)
