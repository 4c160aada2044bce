"""A law's functions at single material points, in double precision: matrices (N, 3, 3) and constants (N, 4) in numpy."""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from diffphys_ros.simulate.laws import LAWS, law_of

ELASTIC = [name for name, law in LAWS.items() if law.elastic]
PLASTIC = [name for name, law in LAWS.items() if law_of(name, wp.float64).project]
FLUIDS = [name for name, law in LAWS.items() if law_of(name, wp.float64).viscous_stress]
SOLIDS = [name for name in LAWS if name not in FLUIDS]
UNIT = np.eye(3)
OWN = {"friction_angle_rad": 0.6, "yield_stress_pa": 900.0, "viscosity_pa_s": 2.5, "pressure_exponent": 6.0}

Matrices, Constants = wp.array(dtype=wp.mat33d), wp.array(dtype=wp.vec4d)
kernel = wp.kernel(enable_backward=False, module="unique")


def constants_of(law: str) -> np.ndarray:
    """mu and lam [Pa] and the law's own, shape (4,)."""
    own = [OWN[p.name] for p in LAWS[law].parameters]
    return np.array([3e3, 5e3, *own, *[0.0] * (2 - len(own))])


def rotations(count: int) -> np.ndarray:
    """Random rotations (count, 3, 3)."""
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(count, 3, 3)))
    return q * np.linalg.det(q)[:, None, None]


def points(law: str, *, repeated: bool = False) -> np.ndarray:
    """Deformation gradients; sand is packed in all of them, with `repeated` some have stretches that are equal, or almost."""
    F = UNIT + 0.15 * np.random.default_rng(1).normal(size=(40, 3, 3))
    if repeated:
        stretches = [[0.8] * 3, [0.8, 0.8, 1.1], [1.1, 0.7, 0.7], [0.9, 0.9 + 1e-9, 1.2], [1.0, 1.0, 1.0 - 1e-12], [0.9, 0.9 + 1e-5, 0.9 - 1e-5]]
        square = UNIT * np.array(stretches)[:, None]
        Q = rotations(2 * len(square)).reshape(2, -1, 3, 3)
        F = np.concatenate([F, square, Q[0] @ square @ Q[1]] + ([] if law == "drucker_prager" else [UNIT[None], Q[0]]))
    packed = 0.7 / np.cbrt(np.linalg.det(F)) if law == "drucker_prager" else np.ones(len(F))
    return F * packed[:, None, None]


def differences(law: str, name: str, *matrices: np.ndarray) -> None:
    """Asserts that the adjoint of a function equals central differences in every argument, at every point."""
    rng, arguments = np.random.default_rng(2), [*matrices, np.tile(constants_of(law), (len(matrices[0]), 1))]
    bar = rng.normal(size=matrices[0].shape)
    adjoints = evaluate(law, f"{name}_adjoint", *arguments, bar)
    for i, (value, adjoint) in enumerate(zip(arguments, adjoints, strict=True)):
        step = 1e-5 * rng.normal(size=value.shape) * (1.0 if value.ndim == 3 else value)
        sides = [evaluate(law, name, *arguments[:i], value + sign * step, *arguments[i + 1 :])[0] for sign in (1, -1)]
        expected = ((sides[0] - sides[1]) / 2 * bar).sum((1, 2))
        found = (adjoint * step).reshape(len(step), -1).sum(1)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=2e-9 * abs(expected).max())


kernel = wp.kernel(enable_backward=False, module="unique")


def evaluate(law: str, name: str, *arguments: np.ndarray) -> list[np.ndarray]:
    """Results of the function `name` of a law in double precision; what it leaves out stays infinite."""
    count = len(arguments[0])
    function, kinds = _kernel(law, name)
    given = [_see(np.broadcast_to(a, (count, *a.shape[-d:])), d) for a, d in zip(arguments, _dimensions(name), strict=True)]
    out = [_see(np.full((count, 3, 3) if d == 2 else (count, 4), np.inf), d) for d in kinds]
    wp.launch(function, dim=count, inputs=given, outputs=out, device="cpu")
    return [o.numpy() for o in out]


def _see(values: np.ndarray, dimensions: int) -> Any:
    return wp.array(np.ascontiguousarray(values, float), dtype=wp.mat33d if dimensions == 2 else wp.vec4d, device="cpu")


def _dimensions(name: str) -> list[int]:
    """Of the arguments: 2 for a matrix, 1 for constants."""
    return [2] * (2 if name.startswith("viscous") else 1) + [1] + [2] * name.endswith("adjoint")


@cache
def _kernel(law: str, name: str) -> tuple[Any, list[int]]:
    """A kernel that calls the function at every point, and the dimensions of its results."""
    function = getattr(law_of(law, wp.float64), name)

    @kernel
    def value(F: Matrices, constants: Constants, out: Matrices):
        i = wp.tid()
        out[i] = function(F[i], constants[i])

    @kernel
    def adjoint(F: Matrices, constants: Constants, bar: Matrices, F_bar: Matrices, constants_bar: Constants):
        i = wp.tid()
        a, b = function(F[i], constants[i], bar[i])
        F_bar[i] = a
        constants_bar[i] = b

    @kernel
    def viscous(F: Matrices, C: Matrices, constants: Constants, out: Matrices):
        i = wp.tid()
        out[i] = function(F[i], C[i], constants[i])

    @kernel
    def viscous_adjoint(F: Matrices, C: Matrices, constants: Constants, bar: Matrices, F_bar: Matrices, C_bar: Matrices, constants_bar: Constants):
        i = wp.tid()
        a, b, c = function(F[i], C[i], constants[i], bar[i])
        F_bar[i] = a
        C_bar[i] = b
        constants_bar[i] = c

    kernels = {
        (False, False): (value, [2]),
        (False, True): (adjoint, [2, 1]),
        (True, False): (viscous, [2]),
        (True, True): (viscous_adjoint, [2, 2, 1]),
    }
    return kernels[name.startswith("viscous"), name.endswith("adjoint")]
