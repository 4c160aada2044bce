"""Finite elements of the solid by scikit-fem: quadratic tetrahedra, stiffness per part, eigenmodes with gravity's prestress.

Small-strain linear elasticity about the shape in frame 0; gravity adds the geometric stiffness of its static stress
(integral of stress_ij du_k/dx_i dv_k/dx_j), which softens an upright body and stiffens a hanging one.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu
from skfem import Basis, BilinearForm, ElementTetP2, MeshTet, asm
from skfem.helpers import trace

from ..errors import InputError
from ..hooke import lame, lame_by_poisson
from ..modes.model import ModalModel
from ..types import Body
from .mesh import SolidMesh, solid_mesh

STIFFNESS_ORDER, MASS_ORDER = 2, 4  # polynomial degrees that the quadrature integrates exactly [derived: quadratic elements with straight sides]
EIGEN_TOLERANCE = 1e-6  # relative, of squared frequencies [numerical]
KEPT = 1e-8  # smallest squared length, after normalisation, of a basis vector that is new [numerical]
RIGID_SHIFT = -1.0  # [1/s^2]; moves the rigid motions of a free body off zero [numerical]


@dataclass(frozen=True)
class Elements:
    """Assembled matrices over the free degrees of freedom (node by node: x, y, z)."""

    nodes: np.ndarray  # [m], (N, 3)
    tets: np.ndarray  # (E, 10)
    part: np.ndarray  # 1..n, (E,)
    poisson: np.ndarray  # (n,)
    free: np.ndarray  # degrees of freedom that are not held, (D,)
    moduli: list[tuple[sp.csc_matrix, sp.csc_matrix]]  # per part, stiffness where Lame's lambda alone is 1 Pa, and where mu alone is, (D, D) each
    masses: list[sp.csc_matrix]  # of what may have densities of its own, each part or all of them together: m of (D, D)
    push: np.ndarray  # consistent loads of unit force densities along x, y, z, (D, 3)
    weights: np.ndarray  # consistent loads of their weights [N], (m, D)
    density: np.ndarray  # theirs [kg/m^3], (m,); the mean of all together
    scalar: Basis = field(repr=False)

    @classmethod
    def of(cls, body: Body, mesh: SolidMesh | None = None, *, apart: bool = False) -> Elements:
        """Elements of a body; of a mesh of your own where given. apart: what goes with density is kept part by part, for `weighing`."""
        mesh = mesh or solid_mesh(body)
        grid = MeshTet(np.ascontiguousarray(mesh.vertices.T), np.ascontiguousarray(mesh.tets.T))
        scalar = Basis(grid, ElementTetP2(), intorder=MASS_ORDER)
        nodes, tets = scalar.doflocs.T.copy(), scalar.element_dofs.T.copy()
        held = np.abs(nodes[:, 0] - mesh.held_x_m) < 1e-9 if mesh.clamped else np.zeros(len(nodes), bool)
        if mesh.clamped and not held.any():
            raise InputError("the object does not reach its clamped plane; move scene.clamp_box_m onto the held face or correct the mask")
        free = np.flatnonzero(np.repeat(~held, 3))
        density = np.asarray(body.density, float)
        own, plain = density[mesh.part - 1], _scalar_mass(scalar, np.ones(len(tets)))
        weighted = [_scalar_mass(scalar, np.where(mesh.part == i + 1, own, 0.0)) for i in range(len(density))] if apart else [_scalar_mass(scalar, own)]
        lumped, volume = [np.asarray(m.sum(1)).ravel() for m in weighted], np.asarray(plain.sum(1)).ravel()
        return cls(
            nodes,
            tets,
            mesh.part,
            np.asarray(body.poisson, float),
            free,
            [_part_moduli(grid, mesh.part == i + 1, free) for i in range(body.parts)],
            [sp.kron(m, sp.identity(3)).tocsr()[free][:, free].tocsc() for m in weighted],
            np.kron(volume[:, None], np.eye(3))[free],
            np.stack([np.kron(m, body.gravity)[free] for m in lumped]),
            density if apart else np.array([body.mass_kg / body.volume_m3]),
            scalar,
        )

    def weighing(self, density: np.ndarray) -> Elements:
        """The same elements with other densities (m,) [kg/m^3]."""
        heavier = density / self.density
        masses = [float(h) * m for h, m in zip(heavier, self.masses, strict=True)]
        return replace(self, masses=masses, weights=heavier[:, None] * self.weights, density=density)

    def squeezing(self, poisson: np.ndarray) -> Elements:
        """The same elements with other Poisson's ratios (n,)."""
        return replace(self, poisson=np.asarray(poisson, float))

    @cached_property
    def stiffness(self) -> list[sp.csc_matrix]:
        """Per part, of E = 1 Pa, (D, D)."""
        return self._mixed([lame(1.0, nu) for nu in self.poisson])

    @cached_property
    def by_poisson(self) -> list[sp.csc_matrix]:
        """Derivatives of `stiffness` by Poisson's ratio, (D, D)."""
        return self._mixed([lame_by_poisson(nu) for nu in self.poisson])

    def _mixed(self, constants: list[tuple[float, float]]) -> list[sp.csc_matrix]:
        """Stiffness per part (D, D) of a lambda and a mu [Pa] each."""
        return [lam * dilation + mu * shear for (dilation, shear), (lam, mu) in zip(self.moduli, constants, strict=True)]

    @cached_property
    def mass(self) -> sp.csc_matrix:
        """Of all parts (D, D)."""
        return sum(self.masses[1:], start=self.masses[0])

    @cached_property
    def gravity(self) -> np.ndarray:
        """Consistent load of the weight [N], (D,)."""
        return self.weights.sum(0)

    @cached_property
    def heavy(self) -> bool:
        """Whether gravity acts."""
        return bool(np.any(self.gravity))

    def elastic(self, young: np.ndarray) -> sp.csc_matrix:
        """Elastic stiffness (D, D) at Young's moduli (n,) [Pa]."""
        return sum((e * k for e, k in zip(young, self.stiffness, strict=True)), start=0 * self.mass)

    def prestress(self, young: np.ndarray) -> list[sp.csc_matrix]:
        """Stiffness (D, D) of the static stress under each of the weights; none without gravity, nor in a body that nothing holds, which falls."""
        if self.shift or not self.heavy:
            return [0 * self.mass] * len(self.weights)
        factor = splu(self.elastic(young), **_SYMMETRIC)
        return [self._stiffness_of_stress(young, factor.solve(weight)) for weight in self.weights]

    def _stiffness_of_stress(self, young: np.ndarray, free_sag: np.ndarray) -> sp.csc_matrix:
        """Geometric stiffness (D, D) of a static displacement (D,) [m]."""
        sag = np.zeros(3 * len(self.nodes))
        sag[self.free] = free_sag
        basis = self.scalar.with_element(ElementTetP2())
        slope = np.stack([basis.interpolate(sag[c::3]).grad for c in range(3)])
        strain = 0.5 * (slope + np.swapaxes(slope, 0, 1))
        e, nu = np.asarray(young, float)[self.part - 1], self.poisson[self.part - 1]
        lam, mu = (each[:, None] for each in lame(e, nu))
        stress = 2 * mu * strain + lam * trace(strain) * np.eye(3)[:, :, None, None]
        form = BilinearForm(lambda u, v, w: np.einsum("ij...,i...,j...->...", w.stress, u.grad, v.grad))
        return sp.kron(asm(form, basis, stress=stress), sp.identity(3)).tocsr()[self.free][:, self.free].tocsc()

    @property
    def shift(self) -> float:
        """Spectral shift [1/s^2] at which the stiffness can be inverted: 0 unless the body is free to move rigidly."""
        return 0.0 if len(self.free) < 3 * len(self.nodes) else RIGID_SHIFT

    def factor(self, matrix: sp.csc_matrix) -> SuperLU:
        """Factors of the shifted stiffness matrix."""
        return splu((matrix - self.shift * self.mass).tocsc(), **_SYMMETRIC)

    def eigenmodes(self, matrix: sp.csc_matrix, factor: SuperLU, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The `count` modes nearest to rest of a stiffness matrix and its factors: squared angular frequencies (count,)
        [1/s^2], rising, and shapes (D, count). Negative squares tell of buckling."""
        inverse = LinearOperator(matrix.shape, matvec=factor.solve, dtype=float)
        start = np.random.default_rng(0).standard_normal(len(self.free))
        count = min(count, len(self.free) - 2)
        omega2, shapes = eigsh(matrix, count, self.mass, sigma=self.shift, OPinv=inverse, v0=start, tol=EIGEN_TOLERANCE)
        order = np.argsort(omega2)
        return omega2[order], shapes[:, order]


_SYMMETRIC = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}


def _scalar_mass(basis: Basis, density: np.ndarray) -> sp.csr_matrix:
    form = BilinearForm(lambda u, v, w: w.rho * u * v)
    return asm(form, basis, rho=np.broadcast_to(density[:, None], basis.dx.shape))


def _part_moduli(grid: MeshTet, chosen: np.ndarray, free: np.ndarray) -> tuple[sp.csc_matrix, sp.csc_matrix]:
    """Of the chosen elements over the free degrees of freedom: the integrals of div(u) div(v) and of 2 sym(grad u) : sym(grad v). All pairs of an
    element's shapes at once: form by form takes several times as long. Of a part too small for an element: nothing."""
    if not chosen.any():
        return (sp.csc_matrix((len(free), len(free))),) * 2
    basis = Basis(grid, ElementTetP2(), intorder=STIFFNESS_ORDER, elements=np.flatnonzero(chosen))
    slope = np.stack([shape[0].grad for shape in basis.basis]).transpose(2, 0, 1, 3)  # (elements, 10, 3, points)
    flat = slope.reshape(len(slope), -1, slope.shape[-1])
    dilation = ((flat * basis.dx[:, None]) @ flat.swapaxes(1, 2)).reshape(len(slope), *(2 * slope.shape[1:3]))
    shear = dilation.swapaxes(2, 4) + np.einsum("eakbk->eab", dilation)[:, :, None, :, None] * np.eye(3)[:, None]
    places = (3 * basis.element_dofs.T[..., None] + np.arange(3)).reshape(len(slope), -1)
    rows, columns = (np.broadcast_to(each, (*places.shape, places.shape[1])).ravel() for each in (places[:, :, None], places[:, None]))

    def whole(local: np.ndarray) -> sp.csc_matrix:
        return sp.coo_matrix((local.ravel(), (rows, columns)), (3 * basis.N,) * 2).tocsr()[free][:, free].tocsc()

    return whole(dilation), whole(shear)


def modal_model(elements: Elements, youngs: list[np.ndarray], counts: list[int], *, loaded: bool = True, varied: int = 0) -> ModalModel:
    """Ritz model spanned by the lowest `counts[i]` eigenmodes at each of `youngs[i]` (n,) and the static shapes under
    uniform loads and gravity at the first, where the basis becomes diagonal. Frequencies in between are right to second
    order. loaded = False: the eigenmodes are those without gravity; the model has its stiffness all the same. varied: of how
    many of the first's lowest modes the change with every part's modulus is spanned as well, to first order."""
    prestress = elements.prestress(youngs[0])
    geometric = sum(prestress[1:], start=prestress[0])
    loads = np.column_stack([elements.push, elements.gravity[:, None]] if elements.heavy else [elements.push])
    vectors = []
    for young, count in zip(youngs, counts, strict=True):
        matrix = elements.elastic(young) + (geometric if loaded else 0 * elements.mass)
        factor = elements.factor(matrix)
        vectors.append(elements.eigenmodes(matrix, factor, count)[1])
        if len(vectors) == 1:
            vectors.append(factor.solve(loads))
            vectors.extend(factor.solve(k @ vectors[0][:, :varied]) for k in elements.stiffness if varied)
    basis = _orthonormal(np.column_stack(vectors), elements.mass)
    full = np.zeros((3 * len(elements.nodes), basis.shape[1]))
    full[elements.free] = basis
    matrices = elements.stiffness, elements.by_poisson, elements.masses, prestress
    stiffness, by_poisson, inertia, stressed = (np.stack([basis.T @ (each @ basis) for each in of]) for of in matrices)
    model = ModalModel(
        elements.nodes,
        elements.tets,
        elements.part,
        full.reshape(len(elements.nodes), 3, -1),
        stiffness,
        by_poisson,
        elements.poisson,
        inertia,
        stressed,
        elements.weights @ basis,
        elements.density,
        np.zeros((basis.shape[1],) * 2),
        np.asarray(youngs[0], float),
    )
    return model.rotated(youngs[0])


def _orthonormal(vectors: np.ndarray, mass: sp.csc_matrix) -> np.ndarray:
    """Mass-orthonormal basis of the span of vectors (D, k), near-copies dropped, (D, r)."""
    vectors = vectors / np.sqrt((vectors * (mass @ vectors)).sum(0))
    size, mix = np.linalg.eigh(vectors.T @ (mass @ vectors))
    kept = size > KEPT
    return vectors @ (mix[:, kept] / np.sqrt(size[kept]))
