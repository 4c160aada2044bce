"""The first answer of an object that is thrown onto a floor: its modulus by how fast it rings when it has come to lie there.

While it bounces, where and when it touches decides more than its stiffness does. Two things do not hang on that. A contact lasts at least as long as a wave
of pressure takes through the body and back, so its length bounds the modulus from below. And what lies on a floor, and swings by less than its
weight presses it down, swings as if its foot were held.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..config import Settings
from ..damping import Damping
from ..modes import interpolation
from ..modes.model import ModalModel
from ..similarity import robust_similarity
from ..types import Body, Camera, Floor, StartValues, Tracks, transformed
from ..vibration.coordinates import observe
from ..vibration.ring import Ring, ring_of
from .evidence import Evidence
from .uncertainty import OPEN_SD, outline_sd
from .values import GUESS_SD, WIDEST_SD, everywhere, supported, values_under

LEAST_POINTS, LEAST_SHARE = 8, 0.2  # of the points, that must hold in a frame for it to tell where the body is [chosen]
LIES_DEG = 3.0  # by which a body turns at most that lies [chosen]
SINKS_M = 1.5e-4  # by which floor and foot give under the body's weight, and the standard deviation of that: they make what stands on them slower, never faster [chosen]
LASTS_LOG10, LASTS_SD = 0.15, 0.2  # of log10 E over what a contact of one wave's time says: one lasts one to two times as long [chosen]
LIKELIER = 20.0  # times, of a ring and its mirror about half the frame rate, by how long the contact was, for one to be told [chosen]
RIGID_HZ = 0.5  # below which a mode of a body that nothing holds is a motion of the whole [numerical]
GUESS_PA = 1e5  # where nothing tells a modulus [chosen]

if TYPE_CHECKING:
    from ..elements.assemble import Elements
    from ..elements.standing import Standing


def motions_of(body: Body, tracks: Tracks) -> np.ndarray:
    """How a body moves as a whole since frame 0, by the points that hold in each frame: rigid motions (T, 4, 4), body frame; NaN where too few do."""
    points = body.to_body(tracks.points)
    motion = np.full((len(points), 4, 4), np.nan)
    for k, holds in enumerate(tracks.valid):
        if holds.sum() >= max(LEAST_POINTS, LEAST_SHARE * len(holds)):
            motion[k] = robust_similarity(points[0, holds], points[k, holds], scaled=False)
    return motion


def heights_of(motion: np.ndarray, nodes: np.ndarray, floor: Floor) -> np.ndarray:
    """Of nodes (N, 3) that move along with (T, 4, 4), above a floor [m], (T, N)."""
    row = floor.up @ motion[:, :3]
    return np.asarray(row[:, :3] @ nodes.T + row[:, 3:] - floor.height_m)


@dataclass(frozen=True)
class Contact:
    """The first time that a body meets the floor and leaves it again."""

    seconds: float
    height_m: float  # of the body before

    @classmethod
    def of(cls, heights: np.ndarray, period_s: float) -> Contact | None:
        """By the heights (T, N) of nodes that move as a whole; None where it is not seen from begin to end."""
        lowest = heights.min(1)
        crossed = [(k, k + low / (low - high)) for k, (low, high) in enumerate(pairwise(lowest)) if low * high < 0]
        if len(crossed) < 2 or not lowest[crossed[0][0]] > 0:
            return None
        (before, begins), (_, ends) = crossed[:2]
        return cls((ends - begins) * period_s, float(np.ptp(heights[before])))

    def young(self, density: float) -> float:
        """Young's modulus [Pa] of a slender body through which a wave goes there and back meanwhile."""
        return density * (2 * self.height_m / self.seconds) ** 2

    def least_young(self, density: float, poisson: float) -> float:
        """That of a body so wide that it cannot widen, the least that any body can have [Pa]."""
        return self.young(density) * (1 + poisson) * (1 - 2 * poisson) / (1 - poisson)


def landed_values(body: Body, tracks: Tracks, period_s: float, settings: Settings, floor: Floor, *, camera: Camera | None = None) -> tuple[StartValues, ModalModel]:
    """Young's modulus and damping of what was thrown onto a floor, and the modes that they came from; as `start_values`. Of more than one material
    none is told."""
    from ..elements.assemble import Elements
    from ..elements.mesh import solid_mesh

    elements = Elements.of(body, solid_mesh(body))
    motion, n = motions_of(body, tracks), body.parts
    heights = heights_of(motion, elements.nodes, floor)
    contact, density = Contact.of(heights, period_s), body.mass_kg / body.volume_m3
    found = _Found(np.full(n, GUESS_PA if contact is None else contact.young(density) * 10**LASTS_LOG10), np.full(n, GUESS_SD))
    if n > 1:
        found = replace(found, why="a thrown object's modulus is told where it is of one material (segment.max_parts: 1)")
    elif tracks.normals is not None:
        found = replace(found, why="a thrown object's modulus is told by points that can be followed: it needs texture")
    elif contact is None:
        found = replace(found, why="the object is not seen to meet the floor and to leave it again")
    else:
        first = lies_from(motion[:, :3, :3], heights.mean(1), float(np.linalg.norm(body.gravity)) * (contact.seconds / np.pi) ** 2)
        found = _by_ring(body, tracks, period_s, floor, elements, motion, first, found)
    evidence = Evidence(body, tracks, observe(body, tracks, camera), period_s, settings, found)
    start, modal = values_under(evidence, everywhere(supported(evidence)))
    least = contact.least_young(density, float(body.poisson[0])) if contact is not None and n == 1 else np.nan
    return _flying(_with_answer(start, found, least, body), motion[1], modal, body, period_s), modal


@dataclass(frozen=True)
class _Found:
    """A Belief, and what it is by."""

    young: np.ndarray  # [Pa], (n,)
    log10_young_sd: np.ndarray  # (n,)
    why: str = ""  # a clause
    damping_s: float = 0.0  # of strain


def _with_answer(start: StartValues, found: _Found, least: float, body: Body) -> StartValues:
    """With what was found, or where that is too unsure with the least modulus [Pa]."""
    told = found.log10_young_sd <= WIDEST_SD
    lower = np.where(told, np.nan, least)
    value, name, unit = body.scale.stiffness(lower[:1], start.density[:1])
    bound = f"; by how long it touched the floor, {name} is at least {value[0]:.2g} {unit}" if np.isfinite(lower[0]) and unit else ""
    return replace(
        start,
        young=found.young,
        log10_young_sd=np.minimum(found.log10_young_sd, OPEN_SD),
        geometry_sd=found.log10_young_sd,
        identified=told,
        reasons=(f"{found.why}{bound}.",) * len(told),
        young_lower=lower,
        damping=Damping(0.0, found.damping_s) if told.all() else start.damping,
    )


def _flying(start: StartValues, motion: np.ndarray, modal: ModalModel, body: Body, period_s: float) -> StartValues:
    """With the velocity that takes the body as a whole, by a motion (4, 4), from frame 0 to the next under its weight, and no force: what else moves it is
    the floor."""
    still = np.zeros(modal.modes)
    rigid = modal.frequencies(start.young) < RIGID_HZ
    velocity = still.copy()
    if rigid.any() and np.isfinite(motion).all():
        moved = transformed(motion, modal.nodes) - modal.nodes
        basis = modal.basis[..., rigid].reshape(-1, int(rigid.sum()))
        velocity[rigid] = np.linalg.lstsq(basis, (moved / period_s - 0.5 * period_s * body.gravity).ravel(), rcond=None)[0]
    silent, never = np.zeros_like(start.force), np.zeros_like(start.forced)
    return replace(start, force=silent, forced=never, initial_displacement=still, initial_velocity=velocity)


def _by_ring(
    body: Body, tracks: Tracks, period_s: float, floor: Floor, elements: Elements, motion: np.ndarray, first: int, guess: _Found
) -> _Found:
    """The modulus by the swing along the vertical of what lies on the floor from frame `first` on, where it shows one."""
    from ..elements.standing import standing

    lying = motion[first:, :3, :3][np.isfinite(motion[first:, 0, 0])]
    if not len(lying):
        return replace(guess, why="the object does not come to lie in the clip, so that it could be read from how it rings there; record until it does")
    model = standing(elements, guess.young, lying[-1].T @ floor.up)
    ring = ring_of(stretch_of(body, tracks, motion, elements, model, first), period_s)
    if ring is None:
        return replace(guess, why="the object does not ring on the floor, once it lies there, so that its modulus can be read from it; record with more frames a second")
    hz = told_apart(ring, period_s, model)
    if hz is None:
        return replace(guess, why=f"it rings on the floor at {ring.hz:.1f} Hz or at {1 / period_s - ring.hz:.1f}, which look alike at {1 / period_s:.3g} frames a second; record with more")
    natural = float(np.hypot(hz, ring.decay_per_s / (2 * np.pi)))
    times, spread = stiffer_than(model, natural, float(np.linalg.norm(body.gravity)))
    sd = np.linalg.norm([spread, 2 * ring.hz_sd / (hz * np.log(10.0)), float(outline_sd(body, tracks)[0]) / np.log(10.0)])
    why = f"it rings at {hz:.2f} Hz on the floor, where it lies from frame {first} on"
    return _Found(guess.young * 10**times, np.array([sd]), why, 2 * max(ring.decay_per_s, 0.0) / (2 * np.pi * natural) ** 2)


def stiffer_than(model: Standing, natural_hz: float, gravity_m_s2: float) -> tuple[float, float]:
    """log10 of E over that of a standing model, and its standard deviation by how foot and floor hold, where the body rings at a frequency: its foot sticks or
    slides, and the floor gives, as a spring below the body that its weight presses by SINKS_M."""
    low, high = np.sort(2 * np.log10(natural_hz / np.array([model.stuck_hz, model.sliding_hz])))
    gives = np.log10(1 + (2 * np.pi * natural_hz) ** 2 * SINKS_M / gravity_m_s2)
    return float((low + high) / 2 + gives), float(np.hypot((high - low) / 2, gives))


def lies_from(turn: np.ndarray, centre: np.ndarray, swing_m: float) -> int:
    """The first frame from which on the body, turned by (T, 3, 3) since frame 0, hardly turns, and its centre's height (T,) swings by less than `swing_m` about where it ends: by more, and
    the floor lets it go. The number of frames where it never lies."""
    known = np.flatnonzero(np.isfinite(centre))
    if not len(known):
        return len(centre)
    last = known[-1]
    ended = np.median(centre[known[len(known) * 3 // 4 :]])
    cosine = (np.einsum("tij,ij->t", turn, turn[last]) - 1) / 2
    off = (np.abs(centre - ended) > swing_m) | (np.degrees(np.arccos(np.clip(cosine, -1, 1))) > LIES_DEG)
    return int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0


def stretch_of(body: Body, tracks: Tracks, motion: np.ndarray, elements: Elements, model: Standing, first: int) -> np.ndarray:
    """The coordinate (F,) of the standing body's mode along the vertical from frame `first` on, beside slower modes and any rigid motion; NaN where too few
    points hold."""
    holds = tracks.valid[first:]
    points = np.where(holds[..., None], body.to_body(tracks.points[first:]), np.nan)
    rest = body.to_body(tracks.points[0])
    usable = np.isfinite(points[..., 0]).mean(0) > 0.5 if len(points) else np.zeros(points.shape[1], bool)
    if usable.sum() < LEAST_POINTS:
        return np.full(len(points), np.nan)
    points, rest = points[:, usable], rest[usable]
    moved = points - np.nanmean(points, 0)
    if not tracks.has_depth:
        moved[..., 2] = 0.0
    shapes = interpolation.evaluate(elements.nodes, elements.tets, np.concatenate([model.shape[..., None], model.others], 2), rest)[0]
    arm = rest - rest.mean(0)
    rigid = np.concatenate([np.broadcast_to(np.eye(3), (len(rest), 3, 3)), np.stack([np.cross(axis, arm) for axis in np.eye(3)], 2)], 2)
    design = np.concatenate([shapes / np.sqrt((shapes**2).mean((0, 1))), rigid / np.sqrt((rigid**2).mean((0, 1)))], 2)
    if not tracks.has_depth:
        design[:, 2] = 0.0
    turn = motion[first:, :3, :3]
    q = np.full(len(points), np.nan)
    for k in np.flatnonzero(np.isfinite(turn[:, 0, 0])):
        held = np.isfinite(moved[k, :, 0])
        if held.sum() >= LEAST_SHARE * len(held):
            q[k] = np.linalg.lstsq(design[held].reshape(-1, design.shape[2]), (moved[k, held] @ turn[k]).ravel(), rcond=1e-6)[0][0]
    return q


def told_apart(ring: Ring, period_s: float, model: Standing) -> float | None:
    """The frequency [Hz] of a ring that is sampled every `period_s`, or of its mirror about half the frame rate: the one that is likelier by how long the
    contact was, by which the model has its modulus; None where both are as likely."""
    pair = np.array([ring.hz, 1 / period_s - ring.hz])
    far = 2 * np.log10(pair / np.sqrt(model.stuck_hz * model.sliding_hz)) / LASTS_SD
    if abs(np.diff(far**2)[0]) < 2 * np.log(LIKELIER):
        return None
    return float(pair[np.abs(far).argmin()])
