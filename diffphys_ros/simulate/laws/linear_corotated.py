"""Linear corotated solid: P = R (2 mu e + lam tr(e) I), e = R^T F - I with the rotation R of F (Sifakis and Barbic 2012).

With the left stretch s = sqrt(F F^T) this is tau = 2 mu (s - I) s + lam tr(s - I) s.
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
        shear = F * wp.transpose(F) - root
        return real(2.0) * constants[0] * shear + constants[1] * (wp.trace(root) - real(3.0)) * root

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        mu = real(2.0) * constants[0]
        lam = constants[1]
        U, values, root = stretch(F)
        dilation = wp.trace(root) - real(3.0)
        along = wp.ddot(tau_bar, root)
        root_bar = (lam * dilation - mu) * tau_bar + (lam * along) * wp.identity(3, dtype=real)
        F_bar = mu * ((tau_bar + wp.transpose(tau_bar)) * F) + stretch_adjoint(F, U, values, root_bar)
        mu_bar = real(2.0) * wp.ddot(tau_bar, F * wp.transpose(F) - root)
        return F_bar, vec4(mu_bar, dilation * along, real(0.0), real(0.0))

    return Functions(stress, stress_adjoint)


LAW = Law(build)
