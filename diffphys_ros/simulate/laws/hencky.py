"""Hencky's energy mu |h|^2 + lam / 2 tr(h)^2 of the logarithmic strain h = log(F F^T) / 2, and the return to a yield surface.

With it the plastic flow of a substep is a radial return of h's deviator (Simo 1992; Klar et al. 2016):
F = exp(k) F_trial with k = (radius / |dev h| - 1) dev h, a symmetric tensor in the principal frame.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import isotropic

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"


@cache
def build(real: type) -> SimpleNamespace:
    """Over scalar type `real`: strain, stress, stress_adjoint, returned, returned_adjoint."""
    vec3, vec4, mat33 = wp.types.vector(3, real), wp.types.vector(4, real), wp.types.matrix((3, 3), real)
    s = isotropic.build(real)
    principal, assembled, in_frame, log_slopes, exp_slopes = s.principal, s.assembled, s.in_frame, s.log_slopes, s.exp_slopes

    @wp.func
    def total(a: vec3):
        return a[0] + a[1] + a[2]

    @wp.func
    def deviator(a: vec3):
        mean = total(a) / real(3.0)
        return vec3(a[0] - mean, a[1] - mean, a[2] - mean)

    @wp.func
    def strain(F: mat33):
        """Directions, values of F F^T, and the principal logarithmic strains."""
        U, beta = principal(F * wp.transpose(F))
        half = real(0.5)
        return U, beta, vec3(half * wp.log(beta[0]), half * wp.log(beta[1]), half * wp.log(beta[2]))

    @wp.func
    def strain_adjoint(F: mat33, U: mat33, beta: vec3, H: mat33):
        """Adjoint of F, for the adjoint H of the logarithmic strain in the principal frame."""
        return U * wp.cw_mul(log_slopes(beta), H) * wp.transpose(U) * F

    @wp.func
    def stress(F: mat33, constants: vec4):
        U, _beta, h = strain(F)
        return assembled(U, (real(2.0) * constants[0]) * h) + constants[1] * total(h) * wp.identity(3, dtype=real)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        U, beta, h = strain(F)
        M = in_frame(U, tau_bar)
        H = (real(2.0) * constants[0]) * M + constants[1] * wp.trace(M) * wp.identity(3, dtype=real)
        mu_bar = real(2.0) * wp.dot(h, wp.get_diag(M))
        return strain_adjoint(F, U, beta, H), vec4(mu_bar, total(h) * wp.trace(M), real(0.0), real(0.0))

    @wp.func
    def returned(F: mat33, U: mat33, h: vec3, radius: real):
        """F with the deviator of its strain no longer than `radius`."""
        dev = deviator(h)
        size = wp.length(dev)
        if size <= radius:
            return F
        k = (radius / size - real(1.0)) * dev
        return assembled(U, vec3(wp.exp(k[0]), wp.exp(k[1]), wp.exp(k[2]))) * F

    @wp.func
    def returned_adjoint(F: mat33, U: mat33, beta: vec3, h: vec3, radius: real, per_trace: real, F_bar: mat33):
        """Adjoints of F and of the radius, which itself grows by `per_trace` with the trace of the strain."""
        dev = deviator(h)
        size = wp.length(dev)
        if size <= radius and radius > real(0.0):
            return F_bar, real(0.0)
        scale = real(0.0)
        inverse = real(0.0)  # 1 / |dev|; a deviator of zero has radius zero here, and nothing to scale
        if size > real(0.0):
            inverse = real(1.0) / size
            scale = radius * inverse
        k = (scale - real(1.0)) * dev
        N = wp.cw_mul(exp_slopes(k), in_frame(U, F_bar * wp.transpose(F)))
        n = wp.get_diag(N)  # type: ignore[arg-type]
        radius_bar = wp.dot(n, dev) * inverse
        coaxial = (radius_bar * per_trace - (scale - real(1.0)) * total(n) / real(3.0)) * vec3(real(1.0)) - (radius_bar * scale * inverse) * dev
        H = (scale - real(1.0)) * N + wp.diag(coaxial)
        through_flow = assembled(U, vec3(wp.exp(k[0]), wp.exp(k[1]), wp.exp(k[2]))) * F_bar
        return through_flow + strain_adjoint(F, U, beta, H), radius_bar

    return SimpleNamespace(**locals())
