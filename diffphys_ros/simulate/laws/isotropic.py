"""Isotropic functions of a symmetric tensor and their adjoints, exact at repeated principal values.

A primary matrix function Y(b) = U diag(f(beta)) U^T has the adjoint b_bar = U (Q o (U^T Y_bar U)) U^T, where Q_ij is the
divided difference (f(beta_i) - f(beta_j)) / (beta_i - beta_j) and f'(beta_i) in its limit (Daleckii and Krein; Higham 2008,
theorem 3.11). The differences are written so that nothing cancels: series take over where beta_i and beta_j are close.
Principal values come from Jacobi rotations: wp.svd3 and wp.eig3 lose up to 5e-3 in float32.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"

SWEEPS = {wp.float32: 5, wp.float64: 6}  # Jacobi converges quadratically; it ends earlier where nothing is left to rotate
EPSILON = {wp.float32: 6e-8, wp.float64: 1.1e-16}
SERIES_BELOW = 0.06  # where the seven terms below are exact to rounding in float64


@cache
def build(real: type) -> SimpleNamespace:
    """Over scalar type `real`: principal, assembled, in_frame, log_slopes, exp_slopes."""
    vec3, mat33 = wp.types.vector(3, real), wp.types.matrix((3, 3), real)
    sweeps, epsilon, series_below = SWEEPS[real], real(EPSILON[real]), real(SERIES_BELOW)

    @wp.func
    def rotation(a_pp: real, a_qq: real, a_pq: real):
        """Tangent, cosine and sine of the Jacobi rotation that takes a_pq to zero."""
        half = real(0.5) * (a_qq - a_pp)
        t = a_pq / (wp.abs(half) + wp.sqrt(half * half + a_pq * a_pq))
        if half < real(0.0):
            t = -t
        c = real(1.0) / wp.sqrt(real(1.0) + t * t)
        return t, c, t * c

    @wp.func
    def rotated(U: mat33, p: int, q: int, c: real, s: real):
        for i in range(3):
            up = U[i, p]
            uq = U[i, q]
            U[i, p] = c * up - s * uq
            U[i, q] = s * up + c * uq
        return U

    @wp.func
    def principal(b: mat33):
        """Directions (columns of U) and values of a symmetric tensor."""
        U = wp.identity(3, dtype=real)
        d = vec3(b[0, 0], b[1, 1], b[2, 2])
        off = vec3(b[1, 2], b[0, 2], b[0, 1])  # off[r]: of the two axes other than r
        small = epsilon * (wp.abs(d[0]) + wp.abs(d[1]) + wp.abs(d[2]))
        for _ in range(sweeps):
            if wp.max(wp.abs(off)) <= small:
                break
            for r in range(3):
                p = (r + 1) % 3
                q = (r + 2) % 3
                a = off[r]
                if a != real(0.0):
                    t, c, s = rotation(d[p], d[q], a)
                    d[p] = d[p] - t * a
                    d[q] = d[q] + t * a
                    a_qr = off[p]
                    a_pr = off[q]
                    off[r] = real(0.0)
                    off[q] = c * a_pr - s * a_qr
                    off[p] = s * a_pr + c * a_qr
                    U = rotated(U, p, q, c, s)
        return U, d

    @wp.func
    def assembled(U: mat33, y: vec3):
        """The symmetric tensor of principal values y in the directions U."""
        return U * wp.diag(y) * wp.transpose(U)

    @wp.func
    def in_frame(U: mat33, Y: mat33):
        """Components of the symmetric part of Y in the frame U."""
        M = wp.transpose(U) * Y * U
        return real(0.5) * (M + wp.transpose(M))

    @wp.func
    def log_slope(a: real, b: real):
        """(log a - log b) / (a - b), as 2 artanh(z) / ((a + b) z) with z = (a - b) / (a + b)."""
        z = (a - b) / (a + b)
        if wp.abs(z) > series_below:
            return wp.log(a / b) / (a - b)
        y = z * z
        series = real(1.0) / real(11.0) + y / real(13.0)
        for k in range(5):
            series = real(1.0) / real(9 - 2 * k) + y * series
        return real(2.0) * series / (a + b)

    @wp.func
    def exp_slope(a: real, b: real):
        """(exp a - exp b) / (a - b), as exp(m) sinh(h) / h with mean m and half difference h."""
        h = real(0.5) * (a - b)
        scale = wp.exp(real(0.5) * (a + b))
        if wp.abs(h) > real(1.0):
            return scale * wp.sinh(h) / h
        y = h * h
        series = real(1.0)
        for k in range(9):
            n = real(18 - 2 * k)
            series = real(1.0) + y / (n * (n + real(1.0))) * series
        return scale * series

    @wp.func
    def log_slopes(beta: vec3):
        a = log_slope(beta[1], beta[2])
        b = log_slope(beta[0], beta[2])
        c = log_slope(beta[0], beta[1])
        return mat33(real(1.0) / beta[0], c, b, c, real(1.0) / beta[1], a, b, a, real(1.0) / beta[2])

    @wp.func
    def exp_slopes(y: vec3):
        a = exp_slope(y[1], y[2])
        b = exp_slope(y[0], y[2])
        c = exp_slope(y[0], y[1])
        return mat33(wp.exp(y[0]), c, b, c, wp.exp(y[1]), a, b, a, wp.exp(y[2]))

    return SimpleNamespace(**locals())
