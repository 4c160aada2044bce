"""The similarity that takes a reconstruction into the clip's world, in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..config import read_text
from ..errors import InputError, short, shown
from ..similarity import robust_similarity
from ..types import Camera
from .structure import Structure

LEAST_DEPTHS = 20  # sparse points or pixels with a depth that a scale is read from
LEAST_POSITIONS = 3  # cameras of known position
LARGEST_M = 1e7  # of a coordinate; those of maps stay below
LARGEST_FILE = 1 << 24  # bytes of a text of positions
COLLINEAR = 1e-3  # second over first singular value of positions that lie in a line


def scale_of(reference_m: np.ndarray, depth: np.ndarray) -> tuple[float, float]:
    """Metres per unit from depths [m] (P,) and those of the reconstruction (P,), by the median; and the ratios' spread (a standard
    deviation, from the median deviation) as a share.

    Raises InputError for fewer than LEAST_DEPTHS that are known in both.
    """
    known = (reference_m > 0) & (depth > 0)
    if known.sum() < LEAST_DEPTHS:
        raise InputError(
            f"capture: {int(known.sum())} points of frame 0 have a depth in the clip and in the capture, needs at least {LEAST_DEPTHS}; "
            "take more pictures from near the clip's camera, or give capture.positions"
        )
    ratio = np.log(reference_m[known] / depth[known])
    middle = float(np.median(ratio))
    return float(np.exp(middle)), 1.4826 * float(np.median(np.abs(ratio - middle)))


def onto_camera(found: Camera, known: Camera, scale: float) -> np.ndarray:
    """The similarity (4, 4) that puts a camera of the reconstruction where it is known to be and enlarges by `scale` around it."""
    similarity = np.eye(4)
    similarity[:3, :3] = scale * known.world_from_camera[:3, :3] @ found.world_from_camera[:3, :3].T
    similarity[:3, 3] = known.position - similarity[:3, :3] @ found.position
    return similarity


def onto_positions(structure: Structure, positions: dict[str, np.ndarray], source: str) -> tuple[np.ndarray, float]:
    """The similarity (4, 4) that takes cameras to their known positions [m], by name, and what it leaves of them [m, rms].

    Raises InputError for fewer than LEAST_POSITIONS of the placed pictures, or positions in one line.
    """
    pairs = [(p.camera.position, positions[p.name.rsplit(".", 1)[0]]) for p in structure.placed if p.name.rsplit(".", 1)[0] in positions]
    if len(pairs) < LEAST_POSITIONS:
        raise InputError(f"{source}: names {len(pairs)} of the pictures that found their place, needs at least {LEAST_POSITIONS}; add more, by file name")
    found, known = (np.array(side) for side in zip(*pairs, strict=True))
    spread = np.linalg.svd(known - known.mean(0), compute_uv=False)
    if spread[1] < COLLINEAR * spread[0]:
        raise InputError(f"{source}: the positions lie in one line, which leaves the turn about it open; add one beside it")
    similarity = robust_similarity(found, known)
    left = known - (found @ similarity[:3, :3].T + similarity[:3, 3])
    return similarity, float(np.sqrt((left**2).sum(1).mean()))


def read_positions(path: Path) -> dict[str, np.ndarray]:
    """Camera positions [m] by picture from lines `name x y z` (as COLMAP's model_aligner reads them); names without their ending.

    Raises InputError for a file that cannot be read, for other lines and for a picture that stands twice.
    """
    found: dict[str, np.ndarray] = {}
    origin = f"capture.positions {shown(path)}"
    for number, line in enumerate(read_text(path, origin, largest=LARGEST_FILE).splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        name, position = _position(line.split(), f"{origin}, line {number}")
        if name in found:
            raise InputError(f"{origin}, line {number}: {short(name)} stands twice; keep one")
        found[name] = position
    return found


def _position(words: list[str], origin: str) -> tuple[str, np.ndarray]:
    try:
        position = np.array([float(word) for word in words[1:]])
    except ValueError:
        position = np.zeros(0)
    if len(words) != 4 or position.shape != (3,) or not (np.abs(position) < LARGEST_M).all():
        raise InputError(f"{origin}: must hold a picture's name and its camera's x y z in metres, each below {LARGEST_M:g}; correct the file")
    return words[0].rsplit(".", 1)[0], position
