"""The solid object."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..inpaint import nearest_known
from .poses import transformed
from .scale import Scale


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
    clamp_sd_m: float = 0.0  # standard deviation of how far along x the held face lies off x = 0 [m]; 0 where a box tells it

    @property
    def parts(self) -> int:
        """Number of parts."""
        return len(self.density)

    @property
    def scale(self) -> Scale:
        """Whether density and lengths were told or measured."""
        return Scale.of(self.sources)

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
