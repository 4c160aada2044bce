"""What is random about a sample: a short, soft bar of two parts, or a strip that hangs, its gust and its view. World frame: z up,
SI units."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

FPS = 30
CELLS_ACROSS = 2  # quadratic elements across
GRAVITY_M_S2 = 9.81
GUST_START = 0.1  # s: frames 0 to 3 are at rest
GRID_CELLS, CFL, PARTICLES_PER_CELL = 4, 0.5, 1.25  # the explicit solver that the sample is made for; the last one per axis
NODE_WEIGHTS = np.einsum("i,j,k->ijk", *3 * [np.array([1.0, 4.0, 1.0]) / 6])  # share of a cell's volume per node (Simpson)


def wave_speed(young: np.ndarray, poisson: np.ndarray, density: float) -> float:
    """Largest speed of pressure waves c_p [m/s] of the parts."""
    return float(np.sqrt(young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson) * density)).max())


@dataclass(frozen=True)
class Shape:
    """A bar before anything is drawn."""

    length: float  # [m]
    height: float  # [m], in the picture
    thickness: float  # [m], along world y, which the camera hardly sees
    cells_long: int  # quadratic elements along the bar
    cells_inner: int  # of them, those of the part at the clamp
    most_frames: int

    @property
    def parts(self) -> int:
        """Number of materials."""
        return 1 + (self.cells_inner < self.cells_long)


BAR = Shape(0.30, 0.125, 0.10, cells_long=6, cells_inner=2, most_frames=45)
FLAT = Shape(0.30, 0.09, 0.05, cells_long=8, cells_inner=8, most_frames=48)
STRIP = Shape(0.30, 0.05, 0.045, cells_long=8, cells_inner=8, most_frames=48)


@dataclass
class Bar:
    """One draw. Parts: 0 at the clamp, 1 beyond its elements where there are two."""

    shape: Shape
    axis: int  # world axis along the bar
    sign: int  # which way it points from the clamp, which is at the origin
    young: np.ndarray  # of the n parts [Pa], shape (n,)
    poisson: np.ndarray  # shape (n,)
    density: float  # of both parts [kg/m^3]
    stiffness_damping: float  # beta [s]
    mass_damping: float  # alpha [1/s]
    push: np.ndarray  # unit direction of the gust, across the bar, shape (3,)
    half_sines: int
    gust_end: float  # [s]
    sway: float  # wanted largest displacement / length
    azimuth: float  # of the camera from -y [rad]
    elevation: float  # [rad]
    fovy: float  # vertical field of view [deg]
    fill: float  # share of the image that the motion takes in the tighter direction
    hue: float  # 0..1
    light: np.ndarray  # direction, shape (3,)
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))  # [m/s^2]
    gust_peak: float = 0.0  # [N/m^3], set from the wanted sway
    cells: np.ndarray = field(init=False)  # elements per axis, shape (3,)
    low: np.ndarray = field(init=False)  # lower corner [m], shape (3,)
    size: np.ndarray = field(init=False)  # [m], shape (3,)

    def __post_init__(self) -> None:
        self.cells = np.full(3, CELLS_ACROSS)
        self.cells[self.axis] = self.shape.cells_long
        self.size = np.full(3, self.shape.height)
        self.size[self.axis], self.size[1] = self.shape.length, self.shape.thickness
        self.low = -self.size / 2
        self.low[self.axis] = 0.0 if self.sign > 0 else -self.shape.length
        nodes = np.stack(np.meshgrid(*[np.arange(2 * n + 1) for n in self.cells], indexing="ij"), -1).reshape(-1, 3)
        self.nodes = self.low + nodes * self.size / (2 * self.cells)  # (N, 3), last axis fastest
        self.cell_index = np.array(list(np.ndindex(*self.cells)))
        outward = self.cell_index[:, self.axis]
        self.cell_part = ((outward if self.sign > 0 else self.shape.cells_long - 1 - outward) >= self.shape.cells_inner).astype(int)
        corner = np.array(list(np.ndindex(3, 3, 3)))
        self.cell_nodes = np.ravel_multi_index(tuple((2 * self.cell_index[:, None] + corner).transpose(2, 0, 1)), 2 * self.cells + 1)
        share = NODE_WEIGHTS.ravel() * (self.size / self.cells).prod()
        self.part_volume = np.zeros((self.shape.parts, len(self.nodes)))  # lumped [m^3], per part
        np.add.at(self.part_volume, (self.cell_part[:, None], self.cell_nodes), share)
        self.clamped = np.abs(self.nodes[:, self.axis]) < 1e-9

    @property
    def floor_m(self) -> float:
        """Height of the floor [m], world frame."""
        return min(-0.25, float(self.low[2]) - 0.1)

    @property
    def volume(self) -> np.ndarray:
        """Lumped volume of the nodes [m^3], shape (N,)."""
        return self.part_volume.sum(0)

    @property
    def mass(self) -> np.ndarray:
        """Lumped mass of the nodes [kg], shape (N,)."""
        return self.volume * self.density

    def gust(self, t: float) -> np.ndarray:
        """Force density [N/m^3], shape (3,), at time t [s]: half-sines of alternating sign."""
        if not GUST_START < t < self.gust_end:
            return np.zeros(3)
        phase = math.pi * self.half_sines * (t - GUST_START) / (self.gust_end - GUST_START)
        return self.gust_peak * math.sin(phase) * self.push

    @property
    def camera_direction(self) -> np.ndarray:
        """Unit vector from the bar to the camera, shape (3,)."""
        across = math.cos(self.elevation)
        return np.array([math.sin(self.azimuth) * across, -math.cos(self.azimuth) * across, math.sin(self.elevation)])

    @property
    def substeps(self) -> float:
        """Explicit substeps per frame at the true E: c_p dt_frame / (CFL dx), GRID_CELLS cells over the thickness."""
        return wave_speed(self.young, self.poisson, self.density) / FPS / (CFL * self.shape.thickness / GRID_CELLS)

    @property
    def particles(self) -> int:
        """Particles of that solver: points of a lattice with PARTICLES_PER_CELL points per cell and axis."""
        return int(np.rint(self.size / (self.shape.thickness / GRID_CELLS / PARTICLES_PER_CELL)).prod())


def draw(rng: np.random.Generator) -> Bar:
    """A random bar of two parts. The draw of the substeps sets Young's modulus."""
    axis, sign = [(2, 1), (0, 1), (0, -1)][rng.integers(3)]
    ratio = np.exp(rng.permutation([0.0, -rng.uniform(math.log(1.3), math.log(2.2))]))
    poisson, density = np.round(rng.uniform(0.26, 0.36, 2), 2), float(np.round(rng.uniform(200, 800), -1))
    speed = rng.uniform(38, 58) * FPS * CFL * BAR.thickness / GRID_CELLS
    young = ratio * (speed / wave_speed(ratio, poisson, density)) ** 2
    azimuth, elevation = math.radians(rng.uniform(-30, 30)), math.radians(rng.uniform(0, 20))
    bar = Bar(
        BAR, axis, sign, np.array([float(f"{e:.4g}") for e in young]), poisson, density,
        stiffness_damping=float(rng.uniform(2e-4, 1e-3)), mass_damping=0.0, push=np.zeros(3), half_sines=int(rng.integers(1, 3)),
        gust_end=float(rng.uniform(0.27, 0.35)), sway=float(rng.uniform(0.08, 0.14)), azimuth=azimuth, elevation=elevation,
        fovy=float(rng.uniform(32, 48)), fill=float(rng.uniform(0.60, 0.70)), hue=float(rng.uniform()),
        light=np.array([rng.choice([-1, 1]) * rng.uniform(0.3, 0.6), rng.uniform(0.5, 0.8), -1]),
    )  # fmt: skip
    bar.push = _across(rng, bar)
    return bar


def draw_strip(rng: np.random.Generator) -> Bar:
    """A random strip of one material that hangs from its upper end and is struck hard by one gust."""
    density = float(np.round(rng.uniform(700, 1100), -1))
    azimuth, elevation = math.radians(rng.uniform(-15, 15)), math.radians(rng.uniform(0, 10))
    side, depth = rng.choice([-1, 1]), rng.uniform(-0.25, 0.25)
    return Bar(
        STRIP, 2, -1, np.array([float(f"{density * rng.uniform(350, 450):.4g}")]), np.round(rng.uniform(0.26, 0.36, 1), 2), density,
        stiffness_damping=float(rng.uniform(4e-4, 1e-3)), mass_damping=0.0, push=np.array([side * math.cos(depth), math.sin(depth), 0.0]), half_sines=1,
        gust_end=float(rng.uniform(0.30, 0.36)), sway=float(rng.uniform(0.40, 0.45)), azimuth=azimuth, elevation=elevation,
        fovy=float(rng.uniform(32, 48)), fill=float(rng.uniform(0.75, 0.85)), hue=float(rng.uniform()),
        light=np.array([rng.choice([-1, 1]) * rng.uniform(0.3, 0.6), rng.uniform(0.5, 0.8), -1]),
        gravity=np.array([0.0, 0.0, -GRAVITY_M_S2]),
    )  # fmt: skip


def draw_flat(rng: np.random.Generator) -> Bar:
    """A random flat bar of one material, struck aslant: it swings fast across its width and slowly across its thickness, and mass and
    stiffness damping brake the two differently."""
    density = float(np.round(rng.uniform(700, 1100), -1))
    young = density * (rng.uniform(1.8, 2.1) * FLAT.length**2 / (0.1615 * FLAT.thickness)) ** 2  # Euler-Bernoulli, across the thickness
    return Bar(
        FLAT, 0, 1, np.array([float(f"{young:.4g}")]), np.round(rng.uniform(0.26, 0.36, 1), 2), density,
        stiffness_damping=float(rng.uniform(8e-3, 9e-3)), mass_damping=float(rng.uniform(1.5, 2.0)), push=np.array([0.0, 0.36, 0.933]),
        half_sines=1, gust_end=float(rng.uniform(0.2, 0.23)), sway=float(rng.uniform(0.24, 0.26)),
        azimuth=math.radians(rng.uniform(-15, 15)), elevation=math.radians(rng.uniform(20, 30)),
        fovy=float(rng.uniform(32, 48)), fill=float(rng.uniform(0.75, 0.85)), hue=float(rng.uniform()),
        light=np.array([rng.choice([-1, 1]) * rng.uniform(0.3, 0.6), rng.uniform(0.5, 0.8), -1]),
    )  # fmt: skip


def _across(rng: np.random.Generator, bar: Bar) -> np.ndarray:
    """Unit vector across the bar, at least 26 degrees off the line of sight."""
    while True:
        push = rng.normal(size=3)
        push[bar.axis] = 0
        push /= np.linalg.norm(push)
        if abs(push @ bar.camera_direction) < 0.9:
            return push
