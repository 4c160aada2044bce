"""Clamped bars whose answers are known: by beam theory, by finite elements."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.linalg import eigh
from skfem import MeshTet

from diffphys_ros.elements.assemble import Elements, modal_model
from diffphys_ros.elements.mesh import SolidMesh
from diffphys_ros.inverse.apparent_stiffness import elastic_modes, swing_ratios
from diffphys_ros.modes import ModalModel
from diffphys_ros.particles import dense_points, downsample, fill, fit_grid
from diffphys_ros.simulate import Simulator, substeps_per_frame
from diffphys_ros.types import Body, Grid, Particles

KINDS = ("bend_z", "bend_y", "twist", "stretch")
ELEMENTS = (16, 6, 4)  # along x, y, z, six tetrahedra each; squared frequencies of bars are then right within 0.3 %
REACH_M = 0.01
SETTLED = 1.8  # periods of critical damping; (1 + w t) exp(-w t) is then below 2e-4
PIXELS_ACROSS = 24  # of the body's raster
DENSE = 20  # points over the thickness from which `sparse` particles are taken

Lattice = tuple[Particles, Grid]


@dataclass(frozen=True)
class Bar:
    """Along x, clamped at x = 0; `width` along y, `thickness` along z [m]."""

    length: float = 0.3
    width: float = 0.09
    thickness: float = 0.06
    young: float = 2e5  # [Pa]
    poisson: float = 0.3
    density: float = 1000.0  # [kg/m^3]

    def body(self) -> Body:
        """The filled solid."""
        pitch = min(self.width, self.thickness) / PIXELS_ACROSS
        shape = round(self.length / pitch), round(self.width / pitch)
        origin = np.array([pitch, pitch - self.width]) / 2
        each = (np.array([self.density]), np.array([self.poisson]), np.zeros(3))
        return Body(np.eye(4), np.ones(shape, bool), origin, pitch, np.full(shape, self.thickness / 2), np.ones(shape, np.uint8), *each, True)

    def modal(self) -> ModalModel:
        """Quadratic finite elements on a regular mesh, finer towards the clamp."""
        along, across, through = (np.linspace(0, 1, n + 1) for n in ELEMENTS)
        mesh = MeshTet.init_tensor(self.length * along**1.5, self.width * (across - 0.5), self.thickness * (through - 0.5))
        solid = SolidMesh(mesh.p.T.copy(), mesh.t.T.copy(), np.ones(mesh.t.shape[1], int), True)
        return modal_model(Elements.of(self.body(), solid), [np.array([self.young])], [8])

    def height(self, axis: int) -> float:
        """Of the section along the direction of bending, 1 or 2 [m]."""
        return (self.width, self.thickness)[axis - 1]


SLIM = Bar(width=0.06, poisson=0.0)  # without Poisson's effect a clamp is what beam theory takes it for
WIDE = Bar()


def fitted(bar: Bar, cells: float, per_cell: float, *, offset: float = 0.0, reach_m: float = REACH_M) -> Lattice:
    """Particles and grid as a fit lays them out, `cells` over the thickness; `offset` moves the grid along x, in cells; `reach_m` is the room for a motion."""
    dx = bar.thickness / cells
    particles = fill(bar.body(), dx, per_cell)
    grid = fit_grid(particles, dx=dx, reach_m=reach_m, clamped=True)
    return particles, replace(grid, origin=grid.origin + np.array([offset * dx, 0, 0]))


def sparse(bar: Bar, cells: float, per_cell: float) -> Lattice:
    """Particles down-sampled from points on the front and a dense interior, to as many as `per_cell` to a cell and axis are."""
    body, dx = bar.body(), bar.thickness / cells
    step = bar.thickness / DENSE
    front = np.stack(np.meshgrid(np.arange(step / 2, bar.length, step), np.arange((step - bar.width) / 2, bar.width / 2, step), [bar.thickness / 2]), -1)
    count = round(body.volume_m3 * (per_cell / dx) ** 3)
    particles = downsample(body, dense_points(body, front.reshape(-1, 3)), count, dx)
    return particles, fit_grid(particles, dx=dx, reach_m=REACH_M, clamped=True)


def plain(bar: Bar, cells: float, per_cell: float) -> Lattice:
    """What one would do first: particles at the middles of equal boxes, the held nodes on the clamped face."""
    particles, grid = fitted(bar, cells, per_cell)
    at_face = replace(grid, origin=np.array([-grid.clamp_index * grid.dx, *grid.origin[1:]]))
    x = particles.x_rest.copy()
    for axis in (1, 2):
        # a row of n equal boxes that have the bar's second moment is narrower by sqrt(1 - 1 / n^2) at its middles
        n = len(np.unique(np.round(x[:, axis], 9)))
        x[:, axis] *= math.sqrt(1 - 1 / n**2)
    return replace(particles, x_rest=x), at_face


def kinds_of(modal: ModalModel, bar: Bar) -> dict[str, int]:
    """Number of the lowest mode of each kind, counted from the slowest."""
    edges = np.array([[bar.length, y, z] for y, z in ((0, 0), (0.45 * bar.width, 0), (0, 0.45 * bar.thickness))])
    found: dict[str, int] = {}
    for k, shape in enumerate(np.moveaxis(modal.evaluate(edges)[0], -1, 0)[:8]):
        axis = int(np.abs(shape[0]).argmax())
        twists = np.abs(shape[0]).max() < 0.15 * np.abs(shape).max()
        found.setdefault("twist" if twists else ("stretch", "bend_y", "bend_z")[axis], k)
    return found


def apparent_by_kind(lattice: Lattice, modal: ModalModel, bar: Bar) -> dict[str, float]:
    """E_apparent / E of each kind of motion, by a roll-out against finite elements."""
    kinds, young = kinds_of(modal, bar), np.array([bar.young])
    names = [name for name in KINDS if name in kinds]
    omega, value, gradient = elastic_modes(modal, young, lattice[0], np.array([kinds[name] for name in names]))
    return dict(zip(names, swing_ratios(*lattice, young, omega, value, gradient).tolist(), strict=True))


def shear_modulus(bar: Bar) -> float:
    """Effective, kappa G [Pa]: Cowper's factor for a rectangle (1966)."""
    return bar.young / (2 * (1 + bar.poisson)) * 10 * (1 + bar.poisson) / (12 + 11 * bar.poisson)


@dataclass(frozen=True)
class Mode:
    """A bending mode of the Timoshenko beam: deflection and turn of the section as polynomials of x / length."""

    omega: float  # [rad/s]
    deflection: np.polynomial.Polynomial
    turn: np.polynomial.Polynomial  # times the length


def timoshenko_mode(bar: Bar, axis: int, *, terms: int = 9) -> Mode:
    """First cantilever mode by Ritz's method on the Timoshenko beam; converged to 1e-9 at 9 terms."""
    powers = np.arange(1, terms + 1)
    plus = powers[:, None] + powers
    mass = 1.0 / (plus + 1)  # int s^i s^j
    slope = np.outer(powers, powers) / (plus - 1.0)  # int s^i' s^j'
    mixed = powers[:, None] / plus  # int s^i' s^j
    inertia, shear = bar.height(axis) ** 2 / 12, shear_modulus(bar)
    stiffness = np.block([[shear * slope, -shear * mixed], [-shear * mixed.T, bar.young * inertia / bar.length**2 * slope + shear * mass]])
    zero = np.zeros_like(mass)
    weight = bar.density * bar.length**2 * np.block([[mass, zero], [zero, inertia / bar.length**2 * mass]])
    omega2, shapes = eigh(stiffness, weight, subset_by_index=[0, 0])
    w, psi = (np.polynomial.Polynomial(np.r_[0, part]) for part in np.split(shapes[:, 0], 2))
    return Mode(float(np.sqrt(omega2[0])), w, psi)


def timoshenko_ratio(lattice: Lattice, bar: Bar, axis: int) -> float:
    """(simulated / theoretical first frequency)^2."""
    mode, (particles, _) = timoshenko_mode(bar, axis), lattice
    s, across = particles.x_rest[:, 0] / bar.length, particles.x_rest[:, axis]
    value, gradient = np.zeros((len(s), 3, 1)), np.zeros((len(s), 3, 3, 1))
    value[:, axis, 0], value[:, 0, 0] = mode.deflection(s), -across * mode.turn(s) / bar.length
    gradient[:, axis, 0, 0] = mode.deflection.deriv()(s) / bar.length
    gradient[:, 0, 0, 0] = -across * mode.turn.deriv()(s) / bar.length**2
    gradient[:, 0, axis, 0] = -mode.turn(s) / bar.length
    value[particles.ghost], gradient[particles.ghost] = 0.0, 0.0
    return float(swing_ratios(*lattice, np.array([bar.young]), np.array([mode.omega]), value, gradient)[0])


def timoshenko_deflection(bar: Bar, axis: int, x: np.ndarray) -> np.ndarray:
    """Static deflection [m] at x [m] under a force density of 1 N/m^3."""
    bending = x**2 * (6 * bar.length**2 - 4 * bar.length * x + x**2) / (24 * bar.young * bar.height(axis) ** 2 / 12)
    return bending + (bar.length * x - x**2 / 2) / shear_modulus(bar)


def static_ratio(lattice: Lattice, bar: Bar, axis: int, *, share: float = 0.004) -> float:
    """Theoretical over simulated tip deflection under a uniform load that bends by `share` of the length: E_apparent / E at rest.

    The bar swings into its rest under critical mass damping, in double precision: steps of the slow end of it are below the
    rounding of a position in single.
    """
    particles, grid = lattice
    omega = timoshenko_mode(bar, axis).omega
    density = share * bar.length / float(timoshenko_deflection(bar, axis, np.array(bar.length)))
    period_s = 2 * np.pi / omega / 12
    substeps = substeps_per_frame(bar.young, bar.poisson, bar.density, dx=grid.dx, period_s=period_s)
    simulator = Simulator(particles, grid, substeps=substeps, period_s=period_s, dtype=torch.float64)
    force = torch.zeros_like(simulator.x_rest)
    force[:, axis] = density
    frames = math.ceil(12 * SETTLED)
    with torch.no_grad():
        young, poisson = simulator.tensor(bar.young), simulator.tensor(bar.poisson)
        end = simulator.rollout(simulator.rest(), young, poisson, force.expand(frames, -1, -1), 2 * omega).x[-1]
    tip = particles.x_rest[:, 0] > bar.length - grid.dx
    moved = (end - simulator.x_rest)[torch.as_tensor(tip), axis].numpy().mean()
    return float(density * timoshenko_deflection(bar, axis, particles.x_rest[tip, 0]).mean() / moved)


def wave_speed_ratio(cells: int, per_cell: float) -> float:
    """Speed of a stretching pulse along a slender bar without Poisson's effect, over sqrt(E / rho)."""
    bar = Bar(length=1.2, width=0.04, thickness=0.04, poisson=0.0)
    particles, grid = fitted(bar, cells, per_cell)
    c = math.sqrt(bar.young / bar.density)
    period_s = 0.02 / c
    simulator = Simulator(particles, grid, substeps=substeps_per_frame(bar.young, 0.0, bar.density, dx=grid.dx, period_s=period_s), period_s=period_s)
    state = _pulse(simulator, c)
    with torch.no_grad():
        path = simulator.rollout(state, simulator.tensor(bar.young), simulator.tensor(0.0), torch.zeros(30, *simulator.x_rest.shape), 0.0)
    energy = path.v[..., 0].double() ** 2
    place = (energy * simulator.x_rest[:, 0]).sum(1) / energy.sum(1)
    return float(np.polyfit(np.arange(31) * period_s, place.numpy(), 1)[0] / c)


def _pulse(simulator: Simulator, speed: float, *, peak: float = 1e-3, width: float = 0.08) -> object:
    """A Gaussian of axial velocity, `peak` of the wave speed, that runs towards the tip: the strain is -v / c."""
    s = (simulator.x_rest[:, 0] - 0.35) / width
    v, C = torch.zeros_like(simulator.x_rest), torch.zeros(len(s), 3, 3)
    v[:, 0] = peak * speed * torch.exp(-(s**2) / 2)
    C[:, 0, 0] = -v[:, 0] * s / width
    F = torch.eye(3).repeat(len(s), 1, 1)
    F[:, 0, 0] -= v[:, 0] / speed
    return simulator.rest(v=v, C=C, F=F)
