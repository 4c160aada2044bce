"""Weakly compressible Newtonian fluid: p = K / gamma (J^-gamma - 1) (Tait's equation, Becker and Teschner 2007), K = lam + 2 mu / 3.

tau = -J p I + 2 eta J dev(sym C) with the viscosity eta. The fluid remembers its volume alone: F is J^(1/3) I.
"""

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"

import warp as wp

from .law import VISCOSITY, Functions, Law, Parameter


def build(real: type) -> Functions:
    """Pressure, viscous stress, projection and their adjoints over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)
    third = real(1.0 / 3.0)

    @wp.func
    def bulk(constants: vec4):
        return constants[1] + real(2.0) * third * constants[0]

    @wp.func
    def stress(F: mat33, constants: vec4):
        j = wp.determinant(F)
        gamma = constants[3]
        return (bulk(constants) / gamma * (j - wp.pow(j, real(1.0) - gamma))) * wp.identity(3, dtype=real)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        j = wp.determinant(F)
        gamma = constants[3]
        power = wp.pow(j, real(1.0) - gamma)
        bar = wp.trace(tau_bar)
        j_bar = bulk(constants) / gamma * (real(1.0) + (gamma - real(1.0)) * power / j) * bar
        bulk_bar = (j - power) / gamma * bar
        gamma_bar = bulk(constants) / gamma * (power * wp.log(j) - (j - power) / gamma) * bar
        return (j_bar * j) * wp.transpose(wp.inverse(F)), vec4(real(2.0) * third * bulk_bar, bulk_bar, real(0.0), gamma_bar)

    @wp.func
    def shearing(C: mat33):
        """Twice the deviator of the strain rate."""
        return C + wp.transpose(C) - (real(2.0) * third * wp.trace(C)) * wp.identity(3, dtype=real)

    @wp.func
    def viscous_stress(F: mat33, C: mat33, constants: vec4):
        return (constants[2] * wp.determinant(F)) * shearing(C)

    @wp.func
    def viscous_stress_adjoint(F: mat33, C: mat33, constants: vec4, tau_bar: mat33):
        j = wp.determinant(F)
        work = j * wp.ddot(tau_bar, shearing(C))
        F_bar = (constants[2] * work) * wp.transpose(wp.inverse(F))
        return F_bar, (constants[2] * j) * shearing(tau_bar), vec4(real(0.0), real(0.0), work, real(0.0))

    @wp.func
    def project(F_trial: mat33, constants: vec4):
        return wp.cbrt(wp.determinant(F_trial)) * wp.identity(3, dtype=real)

    @wp.func
    def project_adjoint(F_trial: mat33, constants: vec4, F_bar: mat33):
        scale = third * wp.trace(F_bar) * wp.cbrt(wp.determinant(F_trial))
        return scale * wp.transpose(wp.inverse(F_trial)), vec4()

    return Functions(stress, stress_adjoint, project, project_adjoint, viscous_stress, viscous_stress_adjoint)


PARAMETERS = (
    Parameter(VISCOSITY, 0.0, 0.0, 1e9, "dynamic viscosity [Pa s]"),
    Parameter("pressure_exponent", 7.0, 0.1, 50.0, "gamma in Tait's equation"),
)
LAW = Law(build, PARAMETERS, elastic=False)
