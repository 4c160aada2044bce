"""Von Mises plasticity of a Hencky solid (plasticine): the deviator s of the Kirchhoff stress keeps sqrt(3/2) |s| <= yield stress.

No hardening; volume is elastic. Return mapping of Simo (1992) in logarithmic strains.
"""

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,valid-type"

import math

import warp as wp

from . import hencky
from .law import Functions, Law, Parameter


def build(real: type) -> Functions:
    """Stress, projection and their adjoints over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)
    h = hencky.build(real)
    strain, returned, returned_adjoint = h.strain, h.returned, h.returned_adjoint
    per_yield = real(math.sqrt(2.0 / 3.0) / 2.0)

    @wp.func
    def project(F_trial: mat33, constants: vec4):
        U, _beta, h = strain(F_trial)
        return returned(F_trial, U, h, per_yield * constants[2] / constants[0])

    @wp.func
    def project_adjoint(F_trial: mat33, constants: vec4, F_bar: mat33):
        U, beta, h = strain(F_trial)
        radius = per_yield * constants[2] / constants[0]
        F_trial_bar, radius_bar = returned_adjoint(F_trial, U, beta, h, radius, real(0.0), F_bar)
        mu_bar = -radius_bar * radius / constants[0]
        return F_trial_bar, vec4(mu_bar, real(0.0), radius_bar * per_yield / constants[0], real(0.0))

    return Functions(h.stress, h.stress_adjoint, project, project_adjoint)


YIELD_STRESS = Parameter("yield_stress_pa", 1e3, 0.0, 1e12, "uniaxial stress at which the material flows [Pa]")
LAW = Law(build, (YIELD_STRESS,), elastic=False)
