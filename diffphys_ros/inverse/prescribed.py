"""Unknowns that an earlier result, or another simulator, tells: what is held takes its values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import shapes, store
from ..config import Settings
from ..damping import Damping
from ..errors import InputError
from ..types import Body, MaterialDoubt, StartValues
from .prepared import Prepared
from .unknowns import checked_hold

FILE = "recovery.npz"
TOLD_SD = 0.01  # of log10 E that is told
TOLD = {
    "points": "real N 3", "part": "whole N", "volume": "positive N", "young": "gap N", "force": "real T N 3", "clamped": "truth N",
    **shapes.DAMPING,
}  # fmt: skip


def prescribed(prepared: Prepared, settings: Settings) -> Prepared:
    """The clip with what fit.prescribe tells of the blocks that fit.hold names; unchanged where nothing is prescribed.

    E [Pa] of a part is the mean of its logarithm over the volume; the force [N/m^3] of a frame is the amplitude of the start values' family
    with the told net force. Densities and Poisson's ratios are told by scene.density_kg_m3 and scene.poisson_ratio. Raises InputError for a
    file that does not fit the clip.
    """
    if settings.fit.prescribe is None:
        return prepared
    held = checked_hold(settings.fit.hold)
    told = _read(settings.fit.prescribe, prepared)
    body, start = prepared.body, prepared.start
    if "young" in held:
        young = 10 ** _per_part(told, np.log10(told["young"]), body.parts, "young")
        reasons = ("told by fit.prescribe.",) * body.parts
        sd, exact = np.full(body.parts, TOLD_SD), MaterialDoubt.none(body.parts)  # whatever the densities are
        start = replace(start, young=young, log10_young_sd=sd, material=exact, identified=np.ones(body.parts, bool), reasons=reasons, young_lower=np.full(body.parts, np.nan))
    if "damping" in held:
        start = replace(start, damping=Damping.of_stored(told))
    if "force" in held:
        force = _amplitudes(told, body, start)
        start = replace(start, force=force, forced=np.abs(force).max(1) > 0)
    return replace(prepared, start=start)


def _read(path: str, prepared: Prepared) -> dict[str, np.ndarray]:
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    found = store.read_arrays(file, "fit.prescribe", cure="give the folder of a result")
    try:
        sizes = shapes.check(found, TOLD)
    except shapes.MisshapenError as error:
        raise InputError(f"fit.prescribe {file}: {error}; give the folder of a result") from error
    frames = len(prepared.clip)
    if sizes["T"] != frames:
        raise InputError(f"fit.prescribe {file}: has {sizes['T']} frames, the clip has {frames}; give a result of this clip")
    return found


def _per_part(told: dict[str, np.ndarray], values: np.ndarray, parts: int, name: str) -> np.ndarray:
    """Means over the volume of each part, (n,)."""
    known, part = np.isfinite(values), told["part"]
    lacking = [number for number in range(1, parts + 1) if not (known & (part == number)).any()]
    if lacking:
        raise InputError(f"fit.prescribe: tells no {name} of part {lacking[0]} of {parts}; take {name} out of fit.hold, or give a result that has it")
    return np.array([np.average(values[known & (part == number)], weights=told["volume"][known & (part == number)]) for number in range(1, parts + 1)])


def _amplitudes(told: dict[str, np.ndarray], body: Body, start: StartValues) -> np.ndarray:
    """Amplitudes (T, 3) of the start values' family, body frame, that have the told net force on the free particles."""
    free = ~told["clamped"].astype(bool)
    volume = told["volume"][free]
    net = np.einsum("tnc,n->tc", told["force"][:, free].astype(float), volume)
    carried = start.footprint.weights(body.to_body(told["points"][free])) @ volume
    return net @ body.world_from_body[:3, :3] / carried
