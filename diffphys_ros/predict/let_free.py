"""From a recovery to its prediction: the same problem with the same engine, let free where the fit ended."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..config import Settings
from ..devices import usable
from ..errors import SimulationError
from ..inverse import Prepared
from ..inverse.evidence.pixels import static_background
from ..inverse.refine import riding
from ..progress import Progress
from ..resimulate import simulate_again
from ..types import Recovery, Splats
from .figures import figures
from .held_out import HeldOut, held_out

LAST_FRAMES = 3  # of the fit, in which a force that still acts makes a free prediction mean nothing
ACTING = 0.1  # of the force's peak, from which it acts: a recovered force is not quite zero where there is none
STILL_ACTING = "predicted without force though it still acted in the last fitted frames; leave a free end to the fit (frames.fit), or do not read the prediction"


def predicted(source: str | Path, prepared: Prepared, splats: Splats, recovery: Recovery, settings: Settings) -> Generator[Progress, None, Recovery]:
    """The recovery with `prediction` among its metrics (see Figures), where settings.frames.predict asks for one; else as it is. `source` is
    the recording that it was recovered from. Yields news. Raises InputError."""
    if not settings.frames.predict:
        return recovery
    yield Progress("predict", text=f"{settings.frames.predict} frames that were kept back: following the points into them")
    held, device = held_out(source, prepared, settings), usable(settings.fit.device)
    try:
        trajectory = simulate_again(recovery, free_frames=held.count, device="cuda:0" if device != "cpu" else device)
    except SimulationError as error:
        return replace(recovery, notes=(*recovery.notes, f"nothing was predicted: {error}"))
    rendered = None if recovery.frames is None else rendering(held, prepared, splats, recovery, trajectory, device=device)
    found = figures(held, prepared.body, trajectory, rendered, force_at_end=force_at_end(recovery))
    notes = (STILL_ACTING,) if found.force_at_end else ()
    return replace(recovery, metrics=recovery.metrics | {"prediction": found.stored()}, notes=(*recovery.notes, *notes))


def rendering(held: HeldOut, prepared: Prepared, splats: Splats, recovery: Recovery, trajectory: np.ndarray, *, device: str) -> np.ndarray:
    """The held-out frames as the recovered Gaussians show them, before the background of the fitted ones; uint8 (F, H, W, 3)."""
    carried = riding(splats, recovery, prepared.clip, static_background(prepared.clip), device=device)
    return carried.clip(np.concatenate([trajectory[:1], trajectory[held.fitted :]]))[1:]


def force_at_end(recovery: Recovery) -> bool:
    """Whether a force acts in the last fitted frames. The last one's own acts after it, where nothing was seen."""
    size = np.sqrt((recovery.force.astype(float) ** 2).sum(-1).mean(-1))[:-1]
    return bool(size[-LAST_FRAMES:].max(initial=0.0) > ACTING * size.max(initial=0.0))

