"""What the tracks say about the motion: a few leading coordinates over time and their shapes. numpy and scipy only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..modes.model import ModalModel
from ..types import Body, Camera, Tracks

LEAST_POINTS = 0.05  # of the tracks that must hold in a frame for it to count as seen [chosen]
CANDIDATES = 6  # principal coordinates that are looked at [chosen]
MOST_COORDINATES = 3  # that are kept [chosen]
LEAST_SEEN = 0.4  # of the frames in which a track must hold [chosen]
LEAST_SHARE = 0.025  # of the first coordinate's motion that a further one must have [chosen]
OVER_NOISE = 1.5  # times the common noise that it must have as well [chosen]
NEW_SHARE = 0.5  # of the variance of its own that products of those before it must leave: else it is their second order [chosen]
STEADY_SHARE, STEADY_POINTS = 0.97, 40  # points seen in nearly all frames span the coordinates [chosen]
NEIGHBOURS = 5  # that stand in for a point that was lost in a frame [numerical]
WILD = 6.0  # times the median misfit: single track positions that far off, and off what their neighbours share, are left out [chosen]
SEPARABLE = 0.045  # of the strongest combination of coordinates and products: with a weaker one a point's frames do not tell them apart [chosen]
COHERENT_SHARE = 0.5  # of the track noise that is common to all points [chosen: a tenth in docs/measurements/front_end.md]


@dataclass(frozen=True)
class Motion:
    """Observed motion in n leading coordinates: displacement(t, m) = sum_i q_i(t) shape_i(m) + products of the q's + noise.

    Products (foreshortening and the like) are second order in the amplitude; linear modes must not be asked to explain
    them, so that only the first-order part is kept. They are products of the motion about rest: about a frame 0 that is bent they would
    lie in the shapes as well. Shapes have unit root mean square over the points, so the q's are metres.
    """

    points: np.ndarray  # body frame at frame 0 [m], (M, 3)
    coordinates: np.ndarray  # [m], (T, n)
    shapes: np.ndarray  # (M, 3, n); without depth across the line of sight
    across: np.ndarray | None  # projectors across the line of sight, or onto the normals of an outline, (M, 3, 3); None with depth
    known: np.ndarray  # frames in which anything was seen, bool, (T,)
    noise_m: float  # of one coordinate of one track [m]
    displacement: np.ndarray  # as tracked, 0 where not valid [m], (T, M, 3)
    valid: np.ndarray  # bool, (T, M)
    begun: np.ndarray | float = 0.0  # coordinates of frame 0 from rest [m], (n,); 0: it is at rest, as far as is known

    @property
    def products(self) -> np.ndarray:
        """Of the coordinates [m^2], (T, n (n + 1) / 2)."""
        return _products(self.coordinates)

    @property
    def coherent_m(self) -> float:
        """Standard deviation [m] of a coordinate q: the part of the tracking error that is common to the points."""
        return COHERENT_SHARE * self.noise_m

    @property
    def size_m(self) -> float:
        """Root mean square of the motion [m]."""
        return float(np.sqrt((self.coordinates[self.known] ** 2).sum(1).mean()))

    @cached_property
    def first_order(self) -> np.ndarray:
        """The displacement without products of the coordinates [m], (T, M, 3); a track that was lost follows the coordinates, and its neighbours beyond them."""
        return self._by_coordinates + _from_neighbours(_likeness(self.points, self.across), self._left, self.valid & self.known[:, None])

    @property
    def second_order(self) -> np.ndarray:
        """What products of the coordinates were found to move the tracks [m], (T, M, 3): with `first_order`, the displacement itself, without gaps."""
        return self.displacement - self._left - self._by_coordinates

    @cached_property
    def _left(self) -> np.ndarray:
        """What coordinates and their products leave of the displacement [m], where a track was lost less what they are, (T, M, 3)."""
        return shapes_of(self.coordinates, self.displacement, self.valid, self.begun)[1]

    @cached_property
    def _by_coordinates(self) -> np.ndarray:
        """The displacement by the coordinates alone [m], (T, M, 3)."""
        return np.einsum("tk,mck->tmc", self.coordinates, self.shapes)

    def seen_basis(self, modal: ModalModel) -> np.ndarray:
        """Modal basis at the points as it is observed, (M, 3, r)."""
        value = modal.evaluate(self.points)[0]
        return value if self.across is None else np.einsum("mij,mjr->mir", self.across, value)

    def misfit_share(self, modal: ModalModel, q: np.ndarray) -> float:
        """Mean squared misfit of a modal motion (T, r) from frame 0 on the tracks over their mean squared motion."""
        predicted = np.einsum("mcr,tr->tmc", self.seen_basis(modal), q)
        error = ((predicted - self.displacement) ** 2).sum(2)[self.valid].sum()
        return float(error / max((self.displacement**2).sum(2)[self.valid].sum(), 1e-300))


@dataclass(frozen=True)
class Projection:
    """The linear observation of modal coordinates, compressed without loss to d numbers a frame.

    |data[t] - operator @ q|^2 is the mean squared misfit over the points, summed over x, y, z [m^2].
    """

    data: np.ndarray  # [m], (T, d)
    operator: np.ndarray  # (d, r)
    second_order: np.ndarray | None = None  # what was left out of the data [m], (T, d); None: not known, or nothing

    @property
    def as_tracked(self) -> Projection:
        """The same with nothing left out of the data."""
        return self if self.second_order is None else replace(self, data=self.data + self.second_order)

    @classmethod
    def of(cls, motion: Motion, modal: ModalModel) -> Projection:
        """Projection on the span of the observed and the modal shapes."""
        return cls.alike(motion, modal)[0]

    @classmethod
    def alike(cls, motion: Motion, *models: ModalModel) -> tuple[Projection, ...]:
        """Of several models, on the span of all, so that what they miss can be compared."""
        count = np.sqrt(len(motion.points))
        shapes = motion.shapes.reshape(-1, motion.shapes.shape[2]) / count
        bases = [motion.seen_basis(modal).reshape(-1, modal.modes) / count for modal in models]
        frame, _ = np.linalg.qr(np.column_stack([shapes, *bases]))
        data = motion.coordinates @ (frame.T @ shapes).T
        return tuple(cls(data, frame.T @ basis) for basis in bases)

    @classmethod
    def of_tracks(cls, motion: Motion, modal: ModalModel) -> Projection:
        """Of all that the tracks show at first order, on the span of the modal shapes: where on the body a force acts is told by more than
        the leading coordinates."""
        count = np.sqrt(len(motion.points))
        basis = motion.seen_basis(modal).reshape(-1, modal.modes) / count
        frame, _ = np.linalg.qr(basis)

        def seen(moved: np.ndarray) -> np.ndarray:
            return np.asarray(moved.reshape(len(moved), -1) / count @ frame)

        return cls(seen(motion.first_order), frame.T @ basis, seen(motion.second_order))


def observe(body: Body, tracks: Tracks, camera: Camera | None = None) -> Motion:
    """Leading coordinates of the tracks. The camera fixes the lines of sight where the tracks have no depth; the thickness
    axis stands in for it."""
    points = body.to_body(tracks.points)
    displacement = np.where(tracks.valid[..., None], points - points[:1], 0.0)
    across = seen_across(body, tracks, camera)
    if across is not None:
        displacement = np.einsum("mij,tmj->tmi", across, displacement)
    places = _likeness(points[0], across)
    q, known, begun = _about_rest(places, displacement, tracks, body)
    _, left = shapes_of(q, displacement, tracks.valid, begun)
    calm = tracks.valid & ~_wild(places, left, tracks.valid)
    kept = calm[known].mean(0) > LEAST_SEEN
    shapes, _ = shapes_of(q, displacement[:, kept], calm[:, kept], begun)
    size = np.maximum(np.sqrt((shapes**2).sum((0, 1)) / len(shapes)), 1e-300)
    kept_across = None if across is None else across[kept]
    return Motion(points[0, kept], q * size, shapes / size, kept_across, known, tracks.noise_m, displacement[:, kept], calm[:, kept], begun * size)


def _about_rest(places: np.ndarray, displacement: np.ndarray, tracks: Tracks, body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `leading` says, and the coordinates of frame 0 from rest (n,): those of one more frame, in which all points are where they rest."""
    if tracks.first is None:
        q, known = leading(places, displacement, tracks.valid, tracks.noise_m)
        return q, known, np.zeros(q.shape[1])
    rest = body.to_body(tracks.points[:1]) - body.to_body(tracks.first)  # as such tracks see it, which have depth
    q, known = leading(places, np.concatenate([displacement, rest]), np.concatenate([tracks.valid, tracks.valid[:1]]), tracks.noise_m)
    return q[:-1], known[:-1], -q[-1]


def _wild(places: np.ndarray, left: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Positions of tracks (T, M) that went wrong, by what coordinates leave of them (T, M, 3) [m]: what those beside them are off by as well is motion."""
    size = np.linalg.norm(left, axis=2)
    bound = WILD * np.median(size[valid])
    wild = valid & (size > bound)
    near = cKDTree(places).query(places, k=min(NEIGHBOURS + 1, len(places)))[1].reshape(len(places), -1)[:, 1:]
    for t, m in np.argwhere(wild):
        beside = left[t, near[m][valid[t, near[m]]]]
        wild[t, m] = not len(beside) or np.linalg.norm(left[t, m] - np.median(beside, axis=0)) > bound
    return wild


def leading(places: np.ndarray, displacement: np.ndarray, valid: np.ndarray, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Leading coordinates (T, n), 0 in frame 0 [m, root mean square over the points], of displacements (T, M, 3) [m] of points at `places` (M, k), where
    they hold (T, M), with tracks' noise [m]; and the frames in which anything was seen (T,)."""
    known = valid.mean(1) > LEAST_POINTS
    known[0] = True
    principal = _principal(places, displacement, valid, known)
    principal = principal - principal[:1]
    return principal[:, _first_order(principal[known], floor=COHERENT_SHARE * noise_m)], known


def seen_across(body: Body, tracks: Tracks, camera: Camera | None) -> np.ndarray | None:
    """Projectors (M, 3, 3), body frame, onto what each track shows of its point's displacement: across the line of sight, or along the normal of an
    outline; None where tracks with depth show all."""
    if tracks.normals is not None:
        return _along_normals(body, tracks.normals)
    return None if tracks.has_depth else _across(body.to_body(tracks.points[0]), None if camera is None else body.to_body(camera.position))


def _across(points: np.ndarray, eye: np.ndarray | None) -> np.ndarray:
    sight = np.array([0.0, 0.0, 1.0]) * np.ones_like(points) if eye is None else points - eye
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    return np.eye(3) - sight[:, :, None] * sight[:, None, :]


def _along_normals(body: Body, normals: np.ndarray) -> np.ndarray:
    """Projectors (M, 3, 3) onto the normals (M, 3), world, of an outline."""
    own = normals @ body.world_from_body[:3, :3]
    return own[:, :, None] * own[:, None, :]


def _likeness(points: np.ndarray, across: np.ndarray | None) -> np.ndarray:
    """Coordinates (M, k) in which those lie near each other that show much the same: places (M, 3), and where one direction alone is seen, these."""
    if across is None or np.trace(across[0]) > 1.5:
        return points
    return np.hstack([points, np.ptp(points, axis=0).max() * across.reshape(len(points), 9)])


def _principal(places: np.ndarray, displacement: np.ndarray, valid: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Principal coordinates (T, k) [m, root mean square over the points] of the points that are seen nearly always."""
    share = valid[known].mean(0)
    steady = share >= min(STEADY_SHARE, np.sort(share)[-min(STEADY_POINTS, len(share))])
    filled = _from_neighbours(places, displacement, valid & known[:, None])[:, steady]
    u, s, _ = np.linalg.svd(filled.reshape(len(filled), -1), full_matrices=False)
    return u[:, :CANDIDATES] * s[:CANDIDATES] / np.sqrt(filled.shape[1])


def _from_neighbours(places: np.ndarray, displacement: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Displacements (T, M, 3) with those that are not valid taken from the nearest points that are; a frame in which nothing
    was seen lies between its neighbours in time."""
    filled, some = displacement.copy(), valid.any(1)
    for t in np.flatnonzero(some & ~valid.all(1)):
        distance, near = cKDTree(places[valid[t]]).query(places[~valid[t]], k=min(NEIGHBOURS, int(valid[t].sum())))
        weight = 1 / np.maximum(distance.reshape(len(near), -1), 1e-9)
        weight /= weight.sum(1, keepdims=True)
        filled[t, ~valid[t]] = np.einsum("mk,mkc->mc", weight, displacement[t, valid[t]][near.reshape(weight.shape)])
    frames = np.arange(len(filled))
    for t in np.flatnonzero(~some):
        before, after = frames[some & (frames < t)][-1], frames[some & (frames > t)][:1]
        share = (t - before) / (after[0] - before) if len(after) else 0.0
        filled[t] = filled[before] + share * (filled[after[0] if len(after) else before] - filled[before])
    return filled


def _products(q: np.ndarray) -> np.ndarray:
    n = q.shape[1]
    return np.stack([q[:, i] * q[:, j] for i in range(n) for j in range(i, n)], 1) if n else np.zeros((len(q), 0))


def _first_order(principal: np.ndarray, *, floor: float) -> list[int]:
    """Coordinates that move enough beside those before and are not products of them."""
    chosen = [0]
    for k in range(1, principal.shape[1]):
        straight = np.column_stack([principal[:, chosen], np.ones(len(principal))])
        own = _unexplained(principal[:, k], straight)  # principal coordinates about frame 0 move together where the motion is about another pose
        if len(chosen) == MOST_COORDINATES or own.std() < max(LEAST_SHARE * principal[:, 0].std(), OVER_NOISE * floor):
            break
        if _unexplained(own, np.column_stack([_products(principal[:, chosen]), straight])).var() > NEW_SHARE * own.var():
            chosen.append(k)
    return chosen


def _unexplained(q: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """What of a coordinate (T,) no sum of `terms` (T, k) is."""
    scaled = terms / np.maximum(np.linalg.norm(terms, axis=0), 1e-300)
    return np.asarray(q - scaled @ np.linalg.lstsq(scaled, q, rcond=None)[0])


def shapes_of(q: np.ndarray, displacement: np.ndarray, valid: np.ndarray, begun: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """First-order shapes (M, 3, n) of all points, by least squares on the q's and their products over the valid frames,
    and what is left of the displacement [m], (T, M, 3). Products are of the motion about rest, from which frame 0 is `begun` (n,) away."""
    size = np.maximum(np.abs(q).max(0), 1e-300)
    terms = np.column_stack([q / size, _products((q + begun) / size) - _products(np.atleast_2d(begun / size))])
    fits = np.stack([_fitted(terms[v], displacement[v, m], q.shape[1]) for m, v in enumerate(valid.T)])
    left = displacement - np.einsum("tk,mkc->tmc", terms, fits)
    return np.swapaxes(fits[:, : q.shape[1]] / size[:, None], 1, 2), left


def _fitted(terms: np.ndarray, moved: np.ndarray, first: int) -> np.ndarray:
    """Least-squares factors (k, 3) of the terms (F, k) of a point's motion (F, 3); on the `first` of them alone where these frames do not
    tell products from coordinates."""
    factors, _, _, strength = np.linalg.lstsq(terms, moved, rcond=1e-9)
    if len(terms) < terms.shape[1] or strength[-1] < SEPARABLE * strength[0]:
        factors = np.zeros_like(factors)
        factors[:first] = np.linalg.lstsq(terms[:, :first], moved, rcond=1e-9)[0]
    return factors
