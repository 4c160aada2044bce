"""A flat solid that moves far in its own plane: quadratic triangles in plane stress, large rotations and strains (total Lagrangian).

The law is the compressible neo-Hookean one of Blatz and Ko (1962), with the strain across the plane eliminated exactly:
psi = mu / 2 (tr C - 2 + (J^(-2 beta) - 1) / beta), beta = nu / (1 - nu), J of the plane alone. It resists being crushed without bound; that of
St Venant and Kirchhoff gives way at strains of .3, as at the clamp of a strip that swings by 60 degrees. What gives way as it is strained has
its stress divided by (1 + (c e)^p)^(1/p), e = sqrt(2 psi) with E = 1: the strain of a pulled bar. So its modulus falls by (c e)^p / p at first, the stress
rises at any strain, and where p is 1 it is divided by 1 + c e. c is told by what the modulus falls at a strain of .1 over that strain, `softens`, as (c .1)^p / p.
The air's drag may grow with the square of speed.

Everything is per unit of depth and density, so that stiffness is E / density [m^2/s^2] and loads are accelerations. Displacements u (2 N,) count
from the shape without load, node by node: x, y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh, splu

from ..types import Body
from .band import Band, solved
from .mesh import element_size, triangulate

COARSER = 1.6  # sides of elements over those of the solid mesh: two quadratic triangles across a strip have its frequency to .3 % [tests/elements/test_plane.py]
MOST_NEWTON, CLOSE_M = 12, 1e-9  # steps of one equilibrium, and the last one's length [numerical]
TOLD_STRAIN = 0.1  # at which `softens` is told: a unit [numerical]
LEAST_ENERGY = 1e-16  # over E: less is no strain [numerical]
MOST_SPLITS = 5  # of a step of a motion in halves [numerical]
MOST_HALVINGS = 8  # of a step that would turn an element inside out [numerical]
SPECTRAL_RADIUS = 0.5  # of the fastest motions from step to step (Chung and Hulbert 1993): they die, the leading mode's decay changes by less than .1 % [Chung and Hulbert 1993]
_CORNER = np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]])  # of the rule that is exact for quadratics, each with a third of the area
EDGES = ((0, 1), (1, 2), (2, 0))


class DivergedError(ArithmeticError):
    """An integration whose steps are too long, or a pose with an element turned inside out."""


def _shapes(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions (Q, 6) and their slopes (Q, 2, 6) at local coordinates (Q, 2); corners, then middles of EDGES."""
    r, s = at.T
    t = 1 - r - s
    nought = np.zeros_like(r)
    value = np.stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t], 1)
    by_r = np.stack([1 - 4 * t, 4 * r - 1, nought, 4 * (t - r), 4 * s, -4 * s], 1)
    by_s = np.stack([1 - 4 * t, nought, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)], 1)
    return value, np.stack([by_r, by_s], 1)


def _det(a: np.ndarray) -> np.ndarray:
    """Determinants of 2 x 2 matrices (..., 2, 2)."""
    return a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]


def _metric(strained: np.ndarray, area_ratio: np.ndarray) -> np.ndarray:
    """The inverse of C = F^T F: xx, yy, xy (..., 3)."""
    first, second = strained[..., 0], strained[..., 1]  # columns of F
    inverse = np.stack([(second**2).sum(-1), (first**2).sum(-1), -(first * second).sum(-1)], -1)
    return np.asarray(inverse / area_ratio[..., None] ** 2)


def _crossed(m: np.ndarray) -> np.ndarray:
    """m_ik m_jl + m_il m_jk (..., 3, 3) of a symmetric tensor (..., 3), both pairs of axes xx, yy, xy."""
    out = 2 * m[..., [[0, 2, 0], [2, 1, 1], [0, 1, 0]]] * m[..., [[0, 2, 2], [2, 1, 2], [2, 2, 1]]]
    out[..., 2, 2] = m[..., 0] * m[..., 1] + m[..., 2] ** 2
    return np.asarray(out)


def _drag(speed: np.ndarray, per_s: float, per_m: float) -> np.ndarray:
    """Deceleration [m/s^2] of nodes with velocities x, y, x, y, ... [m/s]."""
    return (per_s + per_m * np.repeat(np.hypot(speed[::2], speed[1::2]), 2)) * speed


@dataclass(frozen=True)
class _Moving:
    """A moment of a free motion."""

    u: np.ndarray  # displacements [m], (2 N,)
    v: np.ndarray  # velocities [m/s] of what is not held, in the band's order, (D,)
    a: np.ndarray  # accelerations [m/s^2], (D,)


@dataclass(frozen=True)
class _Under:
    """What acts in a free motion."""

    specific: float  # E / density [m^2/s^2]
    load: np.ndarray  # (2 N,)
    drag_per_s: float
    drag_per_m: float


@dataclass(frozen=True)
class FlatSolid:
    """The mesh and what of it never changes."""

    nodes: np.ndarray  # without load [m], (N, 2)
    triangles: np.ndarray  # (E, 6)
    held: np.ndarray  # nodes, bool (N,)
    poisson: float
    softens: float = 0.0  # share by which the modulus falls at first, over the strain, told at a strain of TOLD_STRAIN
    power: float = 1.0  # of the strain, with which it falls; 1 to 2

    @classmethod
    def of(cls, body: Body) -> FlatSolid:
        """Of a body's silhouette, as deep everywhere; held at x = 0 where the body is clamped."""
        points, corners = triangulate(body, COARSER * element_size(body))
        first, second = points[corners[:, 1]] - points[corners[:, 0]], points[corners[:, 2]] - points[corners[:, 0]]
        flip = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
        corners = np.where(flip[:, None], corners[:, [0, 2, 1]], corners)
        pairs = np.sort(np.concatenate([corners[:, list(edge)] for edge in EDGES]), 1)
        unique, number = np.unique(pairs, axis=0, return_inverse=True)
        middles = len(points) + number.reshape(3, -1).T
        nodes = np.concatenate([points, points[unique].mean(1)])
        held = (np.abs(nodes[:, 0]) < 1e-9) & body.clamped
        return cls(nodes, np.concatenate([corners, middles], 1), held, float(body.poisson.mean()))

    @cached_property
    def free(self) -> np.ndarray:
        """Degrees of freedom that are not held."""
        return np.flatnonzero(np.repeat(~self.held, 2))

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Slopes (E, Q, 2, 6) [1/m] of the shape functions and areas (E, Q) [m^2] at the points of the rule."""
        _, local = _shapes(_CORNER)
        jacobian = np.einsum("qkn,end->eqkd", local, self.nodes[self.triangles])
        area = np.abs(np.linalg.det(jacobian)) / 6
        return np.linalg.inv(jacobian) @ local, area

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Degrees of freedom (E, 12) of the elements, and rows and columns of their matrices."""
        own = (2 * self.triangles[..., None] + np.arange(2)).reshape(len(self.triangles), 12)
        return own, np.repeat(own, 12, 1).ravel(), np.tile(own, (1, 12)).ravel()

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, sp.csc_matrix]:
        """Where in a sparse matrix each entry of the elements' matrices goes, and one with that pattern."""
        _, rows, columns = self._places
        size = 2 * len(self.nodes)
        unique, slots = np.unique(columns.astype(np.int64) * size + rows, return_inverse=True)
        starts = np.searchsorted(unique, np.arange(size + 1, dtype=np.int64) * size)
        return slots.ravel(), sp.csc_matrix((np.zeros(len(unique)), (unique % size).astype(np.int32), starts.astype(np.int32)), (size, size))

    @cached_property
    def _band(self) -> Band:
        """Of the degrees of freedom that are not held."""
        return Band.of(self._pattern[1], self.free, *self._places[1:])

    def _matrix(self, local: np.ndarray) -> sp.csc_matrix:
        slots, pattern = self._pattern
        return sp.csc_matrix((np.bincount(slots, local.ravel(), pattern.nnz), pattern.indices, pattern.indptr), pattern.shape)

    @cached_property
    def mass(self) -> sp.csc_matrix:
        """Per unit of depth and density [m^2]."""
        return self._matrix(self._masses)

    @cached_property
    def _masses(self) -> np.ndarray:
        """The elements' (E, 12, 12)."""
        barycentric = np.array([[a, b, 1 - a - b] for a, b in ((0.0915762, 0.0915762), (0.8168476, 0.0915762), (0.0915762, 0.8168476), (0.4459485, 0.4459485), (0.1081030, 0.4459485), (0.4459485, 0.1081030))])
        weight = np.array([0.1099517] * 3 + [0.2233816] * 3)  # Dunavant's rule of degree 4
        value, _ = _shapes(barycentric[:, 1:])
        one = np.einsum("q,qn,qm->nm", weight, value, value)
        local = np.zeros((len(self.triangles), 6, 2, 6, 2))
        local[:, :, 0, :, 0] = local[:, :, 1, :, 1] = self._slopes[1].sum(1)[:, None, None] * one
        return local.reshape(-1, 12, 12)

    def _strained(self, u: np.ndarray) -> np.ndarray:
        """Deformation gradients (E, Q, 2, 2)."""
        slope = self._slopes[0]
        turned = slope.reshape(len(slope), -1, 6) @ u.reshape(-1, 2)[self.triangles]
        return np.eye(2) + np.swapaxes(turned.reshape(*slope.shape[:3], 2), -1, -2)

    def _upright(self, u: np.ndarray) -> bool:
        return bool((_det(self._strained(u)) > 0).all())

    def inner(self, u: np.ndarray) -> tuple[np.ndarray, sp.csc_matrix]:
        """Elastic forces (2 N,) and their tangent for E / density = 1 m^2/s^2. Raises DivergedError."""
        forces, local = self._inner(u)
        return forces, self._matrix(local)

    def _inner(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same, the tangent element by element, (E, 6, 2, 6, 2). Tensors are written out by components, for speed: arrays are small."""
        slope, area = self._slopes
        own, elements = self._places[0], len(area)
        strained = self._strained(u)
        area_ratio = _det(strained)
        if not (area_ratio > 0).all():
            raise DivergedError("an element is turned inside out")
        mu, beta = 0.5 / (1 + self.poisson), self.poisson / (1 - self.poisson)
        crushed = area_ratio ** (-2 * beta)
        energy = 0.5 * mu * ((strained**2).sum((-2, -1)) - 2 + (crushed - 1) / beta)
        strain = np.sqrt(2 * np.maximum(energy, LEAST_ENERGY))
        gives = self.power * self.softens * TOLD_STRAIN ** (1 - self.power)  # c^p
        left = (1 + gives * strain**self.power) ** (-1 / self.power)
        metric = _metric(strained, area_ratio)  # (E, Q, 3): xx, yy, xy, as what follows
        pressure = mu * crushed * left
        stress = mu * left[..., None] * np.array([1.0, 1.0, 0.0]) - pressure[..., None] * metric
        law = pressure[..., None, None] * (2 * beta * metric[..., :, None] * metric[..., None, :] + _crossed(metric))
        if self.softens:
            law -= (gives * strain ** (self.power - 2) * left ** (self.power - 1))[..., None, None] * stress[..., :, None] * stress[..., None, :]
        by_node = slope[..., None]  # (E, Q, axis, n, 1)
        turned = np.swapaxes(strained, -1, -2)[..., None, :]  # (E, Q, axis, 1, i)
        rows = np.empty((*area.shape, 3, 6, 2))  # how displacements change the strains, sheared ones twice
        np.multiply(turned, by_node, out=rows[:, :, :2])
        np.add(turned[:, :, 0] * by_node[:, :, 1], turned[:, :, 1] * by_node[:, :, 0], out=rows[:, :, 2])
        rows, weighted = rows.reshape(*area.shape, 3, 12), area[..., None] * stress
        back = np.swapaxes(rows.reshape(elements, -1, 12), -1, -2)
        forces = back @ weighted.reshape(elements, -1, 1)
        local = (back @ (area[..., None, None] * law @ rows).reshape(elements, -1, 12)).reshape(-1, 6, 2, 6, 2)
        pulled = weighted[..., [[0, 2], [2, 1]]] @ slope
        along = np.swapaxes(slope.reshape(elements, -1, 6), -1, -2) @ pulled.reshape(elements, -1, 6)
        for axis in (0, 1):
            local[:, :, axis, :, axis] += along
        return np.bincount(own.ravel(), forces.ravel(), 2 * len(self.nodes)), local

    def weight(self, gravity: np.ndarray) -> np.ndarray:
        """Load (2 N,) of an acceleration (2,) [m/s^2]."""
        return self.mass @ np.tile(gravity, len(self.nodes))

    def balanced(self, specific: float, load: np.ndarray, start: np.ndarray, springs: sp.csc_matrix | None = None, pull: np.ndarray | None = None) -> np.ndarray:
        """Displacements (2 N,) in equilibrium at E / density [m^2/s^2], from a start; springs are a stiffness and the load that they pull with.
        Raises DivergedError for a start that is turned inside out."""
        u, free = start.copy(), self.free
        for _ in range(MOST_NEWTON):
            forces, tangent = self.inner(u)
            residual, matrix = load - specific * forces, specific * tangent
            if springs is not None and pull is not None:
                residual, matrix = residual + pull - springs @ u, matrix + springs
            step = splu(matrix[free][:, free].tocsc()).solve(residual[free])
            trial = u.copy()
            trial[free] += step
            for _ in range(MOST_HALVINGS):
                if self._upright(trial):
                    break
                step = step / 2
                trial[free] = u[free] + step
            u = trial
            if np.abs(step).max() < CLOSE_M:
                break
        return u

    def march(self, specific: float, load: np.ndarray, u: np.ndarray, v: np.ndarray, *, drag_per_s: float, drag_per_m: float = 0.0, step_s: float, steps: int) -> np.ndarray:
        """Displacements (steps + 1, 2 N) of the free motion from u with velocity v, by the generalised alpha method; drag is of the mass, with
        a share that grows with speed. A step that is too long is halved, and its halves. Raises DivergedError."""
        under = _Under(specific, load, drag_per_s, drag_per_m)
        # what a pose that was seen has of unbalanced forces is noise of the fastest motions, which die at once
        at = _Moving(u.copy(), v[self._band.order].copy(), np.zeros(len(self._band.order)))
        out = [at.u]
        for _ in range(steps):
            at = self._stepped(at, under, step_s, MOST_SPLITS)
            out.append(at.u)
        return np.array(out)

    def _stepped(self, at: _Moving, under: _Under, step_s: float, splits: int) -> _Moving:
        try:
            return self._step(at, under, step_s)
        except DivergedError:
            if not splits:
                raise
        return self._stepped(self._stepped(at, under, step_s / 2, splits - 1), under, step_s / 2, splits - 1)

    def _step(self, at: _Moving, under: _Under, step_s: float) -> _Moving:
        free, (mass, heavy) = self._band.order, self._free_mass
        late = SPECTRAL_RADIUS / (1 + SPECTRAL_RADIUS)  # share of the step's begin in elastic forces and drag
        early = (2 * SPECTRAL_RADIUS - 1) / (1 + SPECTRAL_RADIUS)
        gamma, beta = 0.5 - early + late, 0.25 * (1 - early + late) ** 2
        u0, v0, a0 = at.u[free], at.v, at.a
        new, between = u0 + step_s * v0 + 0.5 * step_s**2 * a0, at.u.copy()
        for _ in range(MOST_NEWTON):
            a = (new - u0 - step_s * v0) / (beta * step_s**2) - (0.5 / beta - 1) * a0
            v = v0 + step_s * ((1 - gamma) * a0 + gamma * a)
            between[free] = (1 - late) * new + late * u0
            forces, tangent = self._inner(between)
            speed = (1 - late) * v + late * v0
            residual = (under.load - under.specific * forces)[free] - mass @ ((1 - early) * a + early * a0) - mass @ _drag(speed, under.drag_per_s, under.drag_per_m)
            scale = (1 - early) / (beta * step_s**2) + (1 - late) * under.drag_per_s * gamma / (beta * step_s)
            change = solved(scale * heavy + (1 - late) * under.specific * self._band.filled(tangent), residual)
            new = new + change
            if np.abs(change).max() < CLOSE_M:
                break
        else:
            raise DivergedError(f"a step of {step_s:.3g} s is too long for this motion")
        u, a = at.u.copy(), (new - u0 - step_s * v0) / (beta * step_s**2) - (0.5 / beta - 1) * a0
        u[free] = new
        return _Moving(u, v0 + step_s * ((1 - gamma) * a0 + gamma * a), a)

    @cached_property
    def _free_mass(self) -> tuple[sp.csr_matrix, np.ndarray]:
        """That of what is not held, in the band's order, as a matrix and as a band."""
        free = self._band.order
        return self.mass[free][:, free].tocsr(), self._band.filled(self._masses)

    @cached_property
    def border(self) -> np.ndarray:
        """Nodes (B, 3) of the sides that no other triangle shares: begin, middle, end, the solid on the left."""
        pairs = np.concatenate([self.triangles[:, [i, 3 + k, j]] for k, (i, j) in enumerate(EDGES)])
        _, number, count = np.unique(np.sort(pairs[:, [0, 2]], 1), axis=0, return_inverse=True, return_counts=True)
        own = pairs[count[number.ravel()] == 1]
        return own[~self.held[own].all(1)]

    def slowest(self, specific: float, load: np.ndarray, start: np.ndarray) -> tuple[float, np.ndarray]:
        """Frequency [Hz] and shape (2 N,) of the slowest small motion about rest under a load, looked for from a start."""
        rest = self.balanced(specific, load, start)
        matrix = (specific * self.inner(rest)[1])[self.free][:, self.free].tocsc()
        square, shape = eigsh(matrix, 1, self.mass[self.free][:, self.free].tocsc(), sigma=0.0, v0=np.ones(len(self.free)))
        full = np.zeros(len(start))
        full[self.free] = shape[:, 0]
        return float(np.sqrt(square[0]) / (2 * np.pi)), full

    def frequency(self, specific: float, load: np.ndarray) -> float:
        """That of `slowest` [Hz]."""
        return self.slowest(specific, load, np.zeros(2 * len(self.nodes)))[0]
