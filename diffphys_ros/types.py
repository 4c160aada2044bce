"""The data that flows through the pipeline: frozen, shapes and units on every field.

Frames of reference: `world` is the root of the camera's transform tree (z up where gravity is known), `camera` the
optical frame (x right, y down, z forward; REP-103), `body` the object's own frame (see Body). `a_from_b` maps
coordinates of b to coordinates of a. Pixel centres lie at integer coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from .damping import Damping
from .footprints import Footprint
from .inpaint import nearest_known

IGNORE = 255  # label of pixels that are neither object nor background (an arm, an occluder)


def object_mask(labels: np.ndarray) -> np.ndarray:
    """Where label images (..., H, W) show the object, bool: neither background nor IGNORE."""
    return (labels > 0) & (labels != IGNORE)


def transformed(a_from_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Coordinates in a, (..., 3), of points (..., 3) given in b; the transform is (4, 4)."""
    return points @ a_from_b[:3, :3].T + a_from_b[:3, 3]


@dataclass(frozen=True)
class Camera:
    """An undistorted pinhole camera."""

    pixel_from_camera: np.ndarray  # intrinsic matrix, px, shape (3, 3)
    world_from_camera: np.ndarray  # rigid transform, m, shape (4, 4)
    width: int  # px
    height: int  # px
    frame_id: str = "camera_optical_frame"  # name of the camera frame
    world_frame_id: str = ""  # name of the world frame; equal to frame_id where no transform is known

    @property
    def focal_px(self) -> float:
        """Horizontal focal length [px]."""
        return float(self.pixel_from_camera[0, 0])

    @property
    def position(self) -> np.ndarray:
        """Optical centre in the world [m], shape (3,)."""
        return self.world_from_camera[:3, 3]

    @property
    def pose_known(self) -> bool:
        """Whether the world frame is another than the camera's."""
        return bool(self.world_frame_id) and self.world_frame_id != self.frame_id

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) [px] and depths (...) [m] of world points (..., 3) [m]."""
        local = (points - self.position) @ self.world_from_camera[:3, :3]
        homogeneous = local @ self.pixel_from_camera.T
        return homogeneous[..., :2] / homogeneous[..., 2:], local[..., 2]

    def backproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """World points (..., 3) [m] of pixels (..., 2) [px] at depths (...) [m]."""
        return self.position + self.rays(pixels) * depth[..., None]

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """World directions (..., 3) of pixels (..., 2) [px], scaled to unit depth."""
        k = self.pixel_from_camera
        y = (pixels[..., 1] - k[1, 2]) / k[1, 1]
        x = (pixels[..., 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
        return np.stack([x, y, np.ones_like(x)], -1) @ self.world_from_camera[:3, :3].T


@dataclass(frozen=True)
class Thickness:
    """How far the object extends along an axis, as something measured it."""

    extent_m: float
    axis: np.ndarray  # unit vector, world, (3,)


@dataclass(frozen=True)
class Clip:
    """A recording on a uniform clock: T frames, `period_s` apart. A frame that was lost is a copy of the one before
    it, with `observed` false; nothing is fitted to it."""

    frames: np.ndarray  # RGB, uint8, shape (T, H, W, 3)
    start_ns: int  # stamp of frame 0 [ns]
    period_s: float  # time between frames [s]
    camera: Camera
    depth: np.ndarray | None = None  # along the optical axis [m], 0 where unknown, float32, shape (T, H, W)
    labels: np.ndarray | None = None  # 0 background, 1..n parts (1 at the clamp), 255 ignore; uint8, shape (T, H, W)
    observed: np.ndarray | None = None  # bool, shape (T,); None: all
    source: str = ""  # where the clip came from
    notes: tuple[str, ...] = ()  # what was assumed while reading, one sentence each
    first_labels: np.ndarray | None = None  # frame 0 as a mask topic labels it, or 0 and 255 for background and object; uint8 (H, W)
    thickness: Thickness | None = None  # measured; what a person tells goes before it
    gravity: np.ndarray | None = None  # measured, world [m/s^2], shape (3,); what a person tells goes before it

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def times(self) -> np.ndarray:
        """Time of every frame after frame 0 [s], shape (T,)."""
        return np.arange(len(self)) * self.period_s

    @property
    def seen(self) -> np.ndarray:
        """Which frames were really received, bool, shape (T,)."""
        return np.ones(len(self), bool) if self.observed is None else self.observed

    def with_labels(self, labels: np.ndarray) -> Clip:
        """The same clip with label images (T, H, W)."""
        return replace(self, labels=labels)


@dataclass(frozen=True)
class Tracks:
    """M surface points followed from frame 0."""

    pixels: np.ndarray  # [px], shape (T, M, 2)
    points: np.ndarray  # world [m], shape (T, M, 3); frame 0 is always finite
    valid: np.ndarray  # bool, shape (T, M); frame 0 is always true
    has_depth: bool  # whether motion along the line of sight was measured
    noise_m: float  # standard deviation of one coordinate of a displacement [m], estimated from the tracks
    sd_m: np.ndarray | None = None  # the same for every track and frame [m], shape (T, M, 2): of a coordinate across the line of sight,
    # and along it (infinite where that is not seen); 0 in frame 0, infinite where the track does not hold; None: not estimated


@dataclass(frozen=True)
class Doubt:
    """Something in a recording that contradicts what a recovery takes for granted; force and motion are then not those of the object."""

    text: str  # one sentence
    of_young: bool  # whether Young's modulus is not to be trusted either


@dataclass(frozen=True)
class Front:
    """The body's surface on the camera's side in C pieces, with the solid behind each."""

    points: np.ndarray  # body frame [m], shape (C, 3)
    volume: np.ndarray  # [m^3], shape (C,)
    part: np.ndarray  # 1..n, shape (C,)


@dataclass(frozen=True)
class Body:
    """The filled solid: a silhouette extruded symmetrically to its mid-plane, on a raster of square cells.

    What makes elements, particles and zones of it knows the raster; all others ask for volumes, sizes, the front and the part at a point.

    Body frame: x leaves the clamp (the clamped face is the plane x = 0; without a clamp x starts at the silhouette's
    lower edge), z is the thickness axis pointing towards the camera with the mid-plane at z = 0, y completes a
    right-handed frame.
    """

    world_from_body: np.ndarray  # rigid transform, m, shape (4, 4)
    inside: np.ndarray  # silhouette, bool, shape (nx, ny)
    origin: np.ndarray  # centre of raster cell (0, 0) in the body's x and y [m], shape (2,)
    pitch_m: float  # side of a raster cell [m]
    half_thickness: np.ndarray  # distance of the surface from the mid-plane [m], shape (nx, ny)
    part: np.ndarray  # 1..n on the silhouette (1 at the clamp), extended to its nearest value outside; (nx, ny) uint8
    density: np.ndarray  # per part [kg/m^3], shape (n,)
    poisson: np.ndarray  # per part, shape (n,)
    gravity: np.ndarray  # body frame [m/s^2], shape (3,)
    clamped: bool  # whether the face x = 0 is held
    sources: dict[str, str] = field(default_factory=dict)  # what fixed density and metric scale, in words

    @property
    def parts(self) -> int:
        """Number of parts."""
        return len(self.density)

    @property
    def volume_m3(self) -> float:
        """Volume [m^3]."""
        return float((self.inside * 2 * self.half_thickness).sum() * self.pitch_m**2)

    @property
    def part_volumes_m3(self) -> np.ndarray:
        """Volume of each part [m^3], shape (n,)."""
        return np.bincount(self.front.part - 1, self.front.volume, self.parts)

    @property
    def mass_kg(self) -> float:
        """Mass [kg]."""
        return float((self.density[self.part - 1] * self.half_thickness * self.inside).sum() * 2 * self.pitch_m**2)

    @property
    def silhouette_m2(self) -> float:
        """Area that it covers across its thickness [m^2]."""
        return float(self.inside.sum()) * self.pitch_m**2

    @property
    def sides_m(self) -> np.ndarray:
        """Sides of its bounding box along the axes of its frame [m], shape (3,)."""
        used = [np.flatnonzero(self.inside.any(1 - axis)) for axis in (0, 1)]
        return np.array([*(self.pitch_m * (u[-1] - u[0] + 1) for u in used), 2 * float(self.half_thickness[self.inside].max())])

    @cached_property
    def front(self) -> Front:
        """What a camera sees of it."""
        i, j = np.nonzero(self.inside)
        flat, half = self.origin + self.pitch_m * np.stack([i, j], -1), self.half_thickness[i, j]
        return Front(np.concatenate([flat, half[:, None]], 1), 2 * half * self.pitch_m**2, self.part[i, j].astype(int))

    def with_parts(self, part: np.ndarray, density: np.ndarray, poisson: np.ndarray) -> Body:
        """The body with other parts: their numbers 1..n, or 0 where it is that of the nearest, on the pieces of the front (C,); density
        [kg/m^3] and Poisson's ratio of each, (n,)."""
        known = np.zeros(self.part.shape, np.uint8)
        known[np.nonzero(self.inside)] = part
        return replace(self, part=nearest_known(known, known > 0), density=density, poisson=poisson)

    def to_body(self, points: np.ndarray) -> np.ndarray:
        """Body coordinates (..., 3) of world points (..., 3)."""
        return (points - self.world_from_body[:3, 3]) @ self.world_from_body[:3, :3]

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """World coordinates (..., 3) of body points (..., 3)."""
        return transformed(self.world_from_body, points)

    def rotate_to_world(self, vectors: np.ndarray) -> np.ndarray:
        """World components (..., 3) of body vectors (..., 3)."""
        return vectors @ self.world_from_body[:3, :3].T

    def cell_of(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nearest raster cell, as two index arrays, of body points (..., 2 or 3); clipped to the raster."""
        index = np.rint((points[..., :2] - self.origin) / self.pitch_m).astype(int)
        return tuple(np.clip(index[..., i], 0, self.inside.shape[i] - 1) for i in (0, 1))  # type: ignore[return-value]

    def part_at(self, points: np.ndarray) -> np.ndarray:
        """Part numbers 1..n (...) at body points (..., 2 or 3)."""
        return self.part[self.cell_of(points)]


@dataclass(frozen=True)
class Particles:
    """Material points that fill the body, in the body frame."""

    x_rest: np.ndarray  # [m], shape (P, 3)
    volume: np.ndarray  # [m^3], shape (P,); 0 < volume
    part: np.ndarray  # 1..n, shape (P,)
    density: np.ndarray  # [kg/m^3], shape (P,)
    poisson: np.ndarray  # shape (P,)
    ghost: np.ndarray  # bool, shape (P,): continues the body behind the clamp so that the grid is full there; never
    # published, never weighed

    @property
    def own(self) -> np.ndarray:
        """Indices of the particles that are the body itself."""
        return np.flatnonzero(~self.ghost)

    @property
    def mass(self) -> np.ndarray:
        """[kg], shape (P,)."""
        return self.volume * self.density


@dataclass(frozen=True)
class Grid:
    """A regular grid in the body frame. Node (i, j, k) lies at origin + dx * (i, j, k)."""

    origin: np.ndarray  # [m], shape (3,)
    dx: float  # [m]
    size: tuple[int, int, int]  # nodes along each axis
    clamp_index: int = -1  # nodes with first index <= clamp_index are held (the clamped face lies a sixth of a cell before that plane); -1: none


@dataclass(frozen=True)
class MaterialPrior:
    """What is believed of the material before any motion is looked at: K materials and where each lies in frame 0."""

    index: np.ndarray  # material of every pixel, off the object that of the nearest pixel on it; 0..K-1, int16, shape (H, W)
    name: tuple[str, ...]  # K names
    young: np.ndarray  # [Pa], shape (K,)
    log10_young_sd: np.ndarray  # shape (K,)
    poisson: np.ndarray  # shape (K,)
    density: np.ndarray  # [kg/m^3], shape (K,)
    source: str  # who says so, in words
    notes: tuple[str, ...] = ()  # what was assumed, one sentence each

    def at(self, camera: Camera, points: np.ndarray) -> np.ndarray:
        """Materials 0..K-1 (...) at world points (..., 3) [m] of frame 0, by the pixel that they project to."""
        pixels = np.rint(camera.project(points)[0])
        u, v = (np.clip(pixels[..., i], 0, self.index.shape[1 - i] - 1).astype(int) for i in (0, 1))
        return self.index[v, u].astype(int)


@dataclass(frozen=True)
class Splats:
    """3D Gaussians of the object in frame 0, world frame."""

    mean: np.ndarray  # [m], float32, shape (G, 3)
    rotation: np.ndarray  # unit quaternion wxyz, float32, shape (G, 4)
    scale: np.ndarray  # standard deviations [m], float32, shape (G, 3)
    opacity: np.ndarray  # 0..1, float32, shape (G,)
    color: np.ndarray  # RGB 0..1, float32, shape (G, 3)


@dataclass(frozen=True)
class StartValues:
    """What tracks and eigenmodes say before any simulation (arrays over parts have shape (n,))."""

    young: np.ndarray  # [Pa], shape (n,)
    log10_young_sd: np.ndarray  # shape (n,)
    damping: Damping[float]
    forced: np.ndarray  # frames in which a force may act, bool, shape (T,)
    footprint: Footprint  # where on the body the force acts
    force: np.ndarray  # amplitude per frame, body frame [N/m^3 of rest volume], shape (T, 3); force[k] acts in [t_k, t_k+1)
    initial_displacement: np.ndarray  # modal coordinates at frame 0 about rest, shape (r,); zeros when at rest
    initial_velocity: np.ndarray  # their rates [1/s], shape (r,)
    frequencies_hz: np.ndarray  # of the leading modes at `young`, shape (r,)
    observed_hz: np.ndarray  # seen in the tracks, leading first
    decay_per_s: np.ndarray  # of the observed frequencies
    track_cost: float  # mean squared misfit of the linear motion over all frames / mean squared motion
    identified: np.ndarray  # bool, shape (n,)
    reasons: tuple[str, ...]  # one sentence per part
    has_free_tail: bool  # false: young is a guess, the joint schedule must find it
    modes_hold: bool  # whether linear modes explain the free motion; false: only a simulation can tell the stiffness
    geometry_sd: np.ndarray  # of log10 E by outline and densities alone, shape (n,)
    detuning: float = 0.0  # largest |log| of a leading mode's frequency over the one that the body as told would have at `young`


@dataclass(frozen=True)
class MpmProblem:
    """The initial value problem that the material points solved: beside grid, substeps and damping all that their motion follows
    from, to the bit. P particles in the solver's order, those that are no ghosts in the order of Recovery.points; body frame.
    """

    engine: ClassVar[str] = "mpm"

    ghost: np.ndarray  # bool, shape (P,); see Particles
    rest: np.ndarray  # [m], shape (P, 3)
    volume: np.ndarray  # [m^3], shape (P,)
    density: np.ndarray  # [kg/m^3], shape (P,)
    young: np.ndarray  # as simulated [Pa], shape (P,)
    poisson: np.ndarray  # as simulated, shape (P,)
    position: np.ndarray  # in frame 0 [m], shape (P, 3); a body that settled under gravity is not quite at rest positions
    velocity: np.ndarray  # in frame 0 [m/s], shape (P, 3)
    velocity_gradient: np.ndarray  # C of APIC in frame 0 [1/s], shape (P, 3, 3)
    deformation_gradient: np.ndarray  # F in frame 0, shape (P, 3, 3): its prestress
    force: np.ndarray  # amplitude [N/m^3 of rest volume], shape (T, 3); force[k] acts in [t_k, t_k+1)
    force_weight: np.ndarray  # of the amplitude, shape (P,)
    damping_shapes: np.ndarray  # modes that stiffness damping acts on, in any scale, shape (P, 3, m)
    damping_gradients: np.ndarray  # d(shape_a)/dX_b [1/m], shape (P, 3, 3, m)
    damping_frequencies: np.ndarray  # angular [rad/s], shape (m,)
    law: str  # name of the constitutive law
    plane_normal: np.ndarray  # floor and walls, out of the obstacle, shape (K, 3)
    plane_offset: np.ndarray  # material stays where normal . x >= offset [m], shape (K,)
    plane_friction: np.ndarray  # Coulomb's coefficient, shape (K,)
    plane_kind: np.ndarray  # "sticky", "slip" or "separate", shape (K,)
    field_force: np.ndarray | None = None  # on top of force * force_weight [N/m^3], as it acted, shape (T - 1, P, 3)


@dataclass(frozen=True)
class ModalProblem:
    """The linear motion about frame 0 where the material points were not the answer: q'' + (alpha + beta K) q' + K q = load force,
    K = elastic + geometric + retuning, displacement = basis q (see modes.ModalModel). N particles and r modes, body frame."""

    engine: ClassVar[str] = "modes"

    rest: np.ndarray  # [m], shape (N, 3)
    young: np.ndarray  # [Pa], shape (N,)
    basis: np.ndarray  # [kg^-1/2], shape (N, 3, r)
    elastic: np.ndarray  # of these Young's moduli [1/s^2], shape (r, r)
    geometric: np.ndarray  # of gravity's prestress [1/s^2], shape (r, r)
    retuning: np.ndarray  # [1/s^2], shape (r, r)
    load: np.ndarray  # modal loads of unit amplitudes along x, y, z, shape (r, 3)
    force: np.ndarray  # amplitude [N/m^3 of rest volume], shape (T, 3); force[k] acts in [t_k, t_k+1)
    initial_displacement: np.ndarray  # modal coordinates in frame 0, shape (r,)
    initial_velocity: np.ndarray  # their rates [1/s], shape (r,)


PROBLEMS: dict[str, type[MpmProblem] | type[ModalProblem]] = {kind.engine: kind for kind in (MpmProblem, ModalProblem)}


@dataclass(frozen=True)
class Recovery:
    """The answer: fields on the body's own particles, in the world frame, and what moves them so."""

    points: np.ndarray  # at rest [m], shape (N, 3)
    volume: np.ndarray  # [m^3], shape (N,)
    part: np.ndarray  # 1..n, shape (N,)
    young: np.ndarray  # corrected for the grid's apparent stiffness [Pa], shape (N,)
    log10_young_sd: np.ndarray  # shape (N,)
    poisson: np.ndarray  # shape (N,)
    density: np.ndarray  # [kg/m^3], shape (N,)
    force: np.ndarray  # [N/m^3 of rest volume], float32, shape (T, N, 3); force[k] acts in [t_k, t_k+1)
    trajectory: np.ndarray  # [m], float32, shape (T, N, 3)
    clamped: np.ndarray  # bool, shape (N,): more than half held by the clamp (particles.held_by), all within 2/3 of a cell of it; left out of net forces
    frames: np.ndarray | None  # rendered, uint8 RGB, shape (T, H, W, 3)
    world_from_body: np.ndarray  # rigid transform, m, shape (4, 4): of the body frame, which grid, gravity and simulation are in
    gravity: np.ndarray  # body frame [m/s^2], shape (3,)
    simulation: MpmProblem | ModalProblem  # whose solution the trajectory is
    apparent_stiffness: float  # E_apparent / E of the grid: young over what the material points must be given
    grid: Grid  # body frame
    period_s: float  # between frames [s]
    substeps: int  # per frame
    damping: Damping[float]
    initial_velocity: np.ndarray  # [m/s], world frame, shape (N, 3)
    identified: np.ndarray  # per part, bool, shape (n,)
    reasons: tuple[str, ...]  # per part, one sentence
    metrics: dict[str, object]  # what metrics.json holds
    notes: tuple[str, ...] = ()  # what was assumed, one sentence each
    force_identified: bool = False  # whether the force can be believed
    force_reason: str = "nobody has judged the force."  # one sentence

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """World coordinates (..., 3) of body points (..., 3)."""
        return transformed(self.world_from_body, points)

    @property
    def young_solver(self) -> np.ndarray:
        """Young's modulus that the trajectory was really simulated with [Pa], shape (N,): for the material points that on their grid,
        before its correction; for eigenmodes `young` itself."""
        problem = self.simulation
        return (problem.young if isinstance(problem, ModalProblem) else problem.young[~problem.ghost]).astype(float)

    def net_force(self) -> np.ndarray:
        """Sum of force * volume over the unclamped particles [N], shape (T, 3)."""
        return np.einsum("tnc,n->tc", self.force.astype(float), self.volume * ~self.clamped)
