"""The rotation R of a deformation gradient F = R S, and its adjoint.

R by Newton's iteration R <- (R + R^-T) / 2 from F (Higham 1986), quadratic from any F with a positive determinant. For dF the
rotation turns by w, dR = R [w], with (tr(S) I - S) w the axial vector of R^T dF: no eigenvalues, so nothing happens where
they are equal.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"

MOST_STEPS = 40  # a stretch of 1e-9 or 1e9 takes 35; usual ones 4 to 6
SMALL_STEP = {wp.float32: 1e-4, wp.float64: 1e-8}  # the next one is its square


@cache
def build(real: type) -> SimpleNamespace:
    """Over scalar type `real`: rotation, rotation_adjoint."""
    vec3, mat33 = wp.types.vector(3, real), wp.types.matrix((3, 3), real)
    small = real(SMALL_STEP[real] ** 2)

    @wp.func
    def rotation(F: mat33):
        R = F
        for _ in range(MOST_STEPS):
            step = real(0.5) * (wp.transpose(wp.inverse(R)) - R)
            R = R + step
            if wp.ddot(step, step) < small:
                break
        return R

    @wp.func
    def axial(A: mat33):
        return vec3(A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1])

    @wp.func
    def rotation_adjoint(F: mat33, R: mat33, R_bar: mat33):
        """Adjoint of F."""
        S = wp.transpose(R) * F
        turn = wp.inverse(wp.trace(S) * wp.identity(3, dtype=real) - S) * axial(wp.transpose(R) * R_bar)
        return R * wp.skew(turn)

    return SimpleNamespace(**locals())
