"""Principal values and rotations are right to rounding, in both scalar types, at equal stretches and at extreme ones."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from diffphys_ros.simulate.laws import isotropic, polar

from .points import rotations

UNIT = np.eye(3)
STRETCHES = np.array(
    [[1, 1, 1], [0.8, 0.8, 1.2], [1 + 1e-7, 1, 1 - 1e-7], [1.3, 1.1, 0.6], [0.05, 1.0, 20.0], [1e-3, 1e-3, 1e-3], [30.0, 30.0, 0.1]]
)
ROUNDING = {wp.float32: 6e-8, wp.float64: 1.1e-16}


def gradients() -> np.ndarray:
    Q = rotations(14).reshape(2, 7, 3, 3)
    return np.concatenate([Q[0] @ (UNIT * STRETCHES[:, None]) @ Q[1], UNIT * STRETCHES[:, None]])


def run(function: Any, real: type, F: np.ndarray, *, results: int) -> list[np.ndarray]:
    """A function of one matrix, at every F."""
    matrix, vector = wp.types.matrix((3, 3), real), wp.types.vector(3, real)

    @wp.kernel(enable_backward=False, module="unique")
    def one(given: wp.array(dtype=matrix), out: wp.array(dtype=matrix)):
        i = wp.tid()
        out[i] = function(given[i])

    @wp.kernel(enable_backward=False, module="unique")
    def two(given: wp.array(dtype=matrix), out: wp.array(dtype=matrix), second: wp.array(dtype=vector)):
        i = wp.tid()
        a, b = function(given[i])
        out[i] = a
        second[i] = b

    out = [wp.full(len(F), float("inf"), dtype=kind, device="cpu") for kind in (matrix, vector)][:results]
    wp.launch(one if results == 1 else two, dim=len(F), inputs=[wp.array(F, dtype=matrix, device="cpu")], outputs=out, device="cpu")
    return [o.numpy().astype(float) for o in out]


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_principal_values_and_directions_give_the_tensor_back(real):
    F = gradients()
    scalar = np.float32 if real is wp.float32 else np.float64
    b = (F @ F.swapaxes(1, 2)).astype(scalar).astype(float)
    U, beta = run(isotropic.build(real).principal, real, b, results=2)
    size = 20 * ROUNDING[real]
    np.testing.assert_allclose(U @ U.swapaxes(1, 2), np.tile(UNIT, (len(F), 1, 1)), rtol=0, atol=size)
    scale = np.trace(b, axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose((U * beta[:, None]) @ U.swapaxes(1, 2) / scale, b / scale, rtol=0, atol=size)


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_a_rotation_is_one_and_leaves_a_symmetric_stretch(real):
    F = gradients()
    (R,) = run(polar.build(real).rotation, real, F, results=1)
    size = 50 * ROUNDING[real] * (STRETCHES.max(1) / STRETCHES.min(1))[np.arange(len(F)) % 7]
    np.testing.assert_array_less(abs(R @ R.swapaxes(1, 2) - UNIT).max((1, 2)), size)
    S = R.swapaxes(1, 2) @ F
    np.testing.assert_array_less(abs(S - S.swapaxes(1, 2)).max((1, 2)) / abs(S).max((1, 2)), size)
    assert (np.linalg.det(R) > 0.9).all()
