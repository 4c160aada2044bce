"""The solver that a plain reading of the method gives, to measure ours against: one thread per particle and node, a dense
grid, Warp's own derivatives of three kernels, one shared grid and replays in the backward pass, a CUDA graph where there
is CUDA. MLS-MPM, APIC, neo-Hookean, as in Hu et al. 2018; nothing in it is tuned.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from diffphys_ros.types import Grid, Particles

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors


@cache
def kernels(real: type) -> SimpleNamespace:
    """Kernels p2g, grid and g2p of one substep."""
    vec3, mat33 = wp.types.vector(3, real), wp.types.matrix((3, 3), real)
    module = wp.get_module(f"prototype_{real.__name__}")

    @wp.func
    def weight(f: real):
        d = wp.abs(f)
        if d < real(0.5):
            return real(0.75) - d * d
        return real(0.5) * (real(1.5) - d) * (real(1.5) - d)

    @wp.func
    def stress(F: mat33, mu: real, lam: real):
        unit = wp.identity(3, dtype=real)
        return mu * (F * wp.transpose(F) - unit) + lam * wp.log(wp.determinant(F)) * unit

    @wp.kernel(module=module)
    def p2g(
        x: wp.array(dtype=vec3),
        v: wp.array(dtype=vec3),
        C: wp.array(dtype=mat33),
        F: wp.array(dtype=mat33),
        mu: wp.array(dtype=real),
        lam: wp.array(dtype=real),
        mass: wp.array(dtype=real),
        volume: wp.array(dtype=real),
        gravity: vec3,
        origin: vec3,
        dx: real,
        dt: real,
        node_mass: wp.array3d(dtype=real),
        node_momentum: wp.array3d(dtype=vec3),
    ):
        p = wp.tid()
        u = (x[p] - origin) / dx
        i, j, k = int(wp.floor(u[0] - real(0.5))), int(wp.floor(u[1] - real(0.5))), int(wp.floor(u[2] - real(0.5)))
        A = mass[p] * C[p] - (real(4.0) * dt * volume[p] / (dx * dx)) * stress(F[p], mu[p], lam[p])
        b = mass[p] * (v[p] + dt * gravity)
        for a in range(3):
            for c in range(3):
                for e in range(3):
                    d = vec3(real(i + a), real(j + c), real(k + e)) - u
                    w = weight(d[0]) * weight(d[1]) * weight(d[2])
                    wp.atomic_add(node_mass, i + a, j + c, k + e, w * mass[p])
                    wp.atomic_add(node_momentum, i + a, j + c, k + e, w * (b + A * (dx * d)))

    @wp.kernel(module=module)
    def grid(
        node_mass: wp.array3d(dtype=real),
        node_momentum: wp.array3d(dtype=vec3),
        clamp_index: int,
        drag: real,
        node_velocity: wp.array3d(dtype=vec3),
    ):
        i, j, k = wp.tid()
        if node_mass[i, j, k] > real(0.0) and i > clamp_index:
            node_velocity[i, j, k] = (drag / node_mass[i, j, k]) * node_momentum[i, j, k]

    @wp.kernel(module=module)
    def g2p(
        x: wp.array(dtype=vec3),
        F: wp.array(dtype=mat33),
        node_velocity: wp.array3d(dtype=vec3),
        origin: vec3,
        dx: real,
        dt: real,
        next_x: wp.array(dtype=vec3),
        next_v: wp.array(dtype=vec3),
        next_C: wp.array(dtype=mat33),
        next_F: wp.array(dtype=mat33),
    ):
        p = wp.tid()
        u = (x[p] - origin) / dx
        i, j, k = int(wp.floor(u[0] - real(0.5))), int(wp.floor(u[1] - real(0.5))), int(wp.floor(u[2] - real(0.5)))
        v = vec3()
        C = mat33()
        for a in range(3):
            for c in range(3):
                for e in range(3):
                    d = vec3(real(i + a), real(j + c), real(k + e)) - u
                    w = weight(d[0]) * weight(d[1]) * weight(d[2])
                    g = node_velocity[i + a, j + c, k + e]
                    v += w * g
                    C += (w * real(4.0) / dx) * wp.outer(g, d)
        next_x[p] = x[p] + dt * v
        next_v[p] = v
        next_C[p] = C
        next_F[p] = F[p] + dt * (C * F[p])

    return SimpleNamespace(p2g=p2g, grid=grid, g2p=g2p, vec3=vec3, mat33=mat33)


@dataclass
class Nodes:
    """Arrays over the nodes of the dense grid."""

    mass: Any
    momentum: Any
    velocity: Any

    def arrays(self) -> list[Any]:
        """All of them."""
        return [self.mass, self.momentum, self.velocity]


class Prototype:
    """One frame of `substeps` of a body at rest, and the gradient of a weighted sum of its last positions."""

    def __init__(
        self,
        particles: Particles,
        grid: Grid,
        *,
        young: float,
        poisson: float,
        dt: float,
        substeps: int,
        mass_damping: float,
        gravity: tuple[float, float, float],
        device: str,
        real: type = wp.float32,
    ):
        """Everything in SI units; moduli are the same everywhere."""
        wp.init()
        k = self.kernels = kernels(real)
        self.device, self.size, self.substeps, self.real = device, grid.size, substeps, real
        x, count = particles.x_rest, len(particles.x_rest)
        lame = young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        self.mu, self.lam = (self._array(np.full(count, value), real) for value in lame)
        self.matter = [self.mu, self.lam, self._array(particles.mass, real), self._array(particles.volume, real)]
        self.space = [k.vec3(*grid.origin), grid.dx, dt]
        self.gravity, self.clamp_index, self.drag = k.vec3(*gravity), grid.clamp_index, float(np.exp(-mass_damping * dt))
        still = (
            (x, k.vec3),
            (np.zeros((count, 3)), k.vec3),
            (np.zeros((count, 3, 3)), k.mat33),
            (np.tile(np.eye(3), (count, 1, 1)), k.mat33),
        )
        self.states = [[self._array(values, kind) for values, kind in still] for _ in range(substeps + 1)]
        self.weight = self._array(np.zeros((count, 3)), k.vec3)

    def nodes(self) -> Nodes:
        """A fresh dense grid, all zero."""
        zeros = lambda kind: wp.zeros(self.size, dtype=kind, device=self.device, requires_grad=True)  # noqa: E731
        return Nodes(zeros(self.real), zeros(self.kernels.vec3), zeros(self.kernels.vec3))

    def launches(self, n: int, grid: Nodes) -> list[tuple[Any, Any, list[Any], list[Any]]]:
        """(kernel, dim, inputs, outputs) of substep n."""
        k, (x, v, C, F) = self.kernels, self.states[n]
        count = len(x)
        return [
            (k.p2g, count, [x, v, C, F, *self.matter, self.gravity, *self.space], [grid.mass, grid.momentum]),
            (k.grid, self.size, [grid.mass, grid.momentum, self.clamp_index, self.drag], [grid.velocity]),
            (k.g2p, count, [x, F, grid.velocity, *self.space], list(self.states[n + 1])),
        ]

    def forward(self) -> None:
        """All substeps, on one grid."""
        for n in range(self.substeps):
            self._clear(self._shared.arrays())
            for kernel, dim, inputs, outputs in self.launches(n, self._shared):
                wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.device)

    def backward(self) -> None:
        """Gradients of sum(weight . x) into the `grad` of mu, lam and the first state; p2g and grid of each substep again."""
        self._clear([a.grad for state in self.states for a in state] + [self.mu.grad, self.lam.grad])
        wp.copy(self.states[-1][0].grad, self.weight)
        for n in reversed(range(self.substeps)):
            arrays = self._shared.arrays()
            self._clear(arrays + [a.grad for a in arrays])
            steps = self.launches(n, self._shared)
            for kernel, dim, inputs, outputs in steps[:2]:
                wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.device)
            for kernel, dim, inputs, outputs in reversed(steps):
                bars = [[_grad(a) for a in values] for values in (inputs, outputs)]
                wp.launch(kernel, dim, inputs, outputs, adj_inputs=bars[0], adj_outputs=bars[1], device=self.device, adjoint=True)

    def gradient(self) -> np.ndarray:
        """dL/dE (P,) after `backward`, for a Poisson's ratio that is kept."""
        mu, lam = self.mu.numpy(), self.lam.numpy()
        poisson = lam / (2 * (lam + mu))
        young = 2 * mu * (1 + poisson)
        return (self.mu.grad.numpy() * mu + self.lam.grad.numpy() * lam) / young

    @cached_property
    def _shared(self) -> Nodes:
        return self.nodes()

    def _array(self, values: np.ndarray, kind: Any) -> Any:
        return wp.array(values, dtype=kind, device=self.device, requires_grad=True)

    @staticmethod
    def _clear(arrays: list[Any]) -> None:
        for array in arrays:
            array.zero_()


def _grad(value: Any) -> Any:
    return value.grad if isinstance(value, wp.array) else value
