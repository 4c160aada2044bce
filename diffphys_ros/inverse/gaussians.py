"""The Gaussians of frame 0, over the scene that the clip shows behind them."""

from __future__ import annotations

from collections.abc import Generator

from ..config import Settings
from ..devices import usable
from ..progress import Progress, told
from ..types import Clip, Splats
from .evidence.pixels import static_background


def fit_gaussians(clip: Clip, depth0, settings: Settings, *, behind=None) -> Generator[Progress, None, Splats]:  # type: ignore[no-untyped-def]
    """Static Gaussians of frame 0 (paper section 3.2); depth0 (H, W) [m]; behind uint8 (H, W, 3): the scene without the object, None: it is
    read from the clip where an edge shows it."""
    from ..splats import fit_splats

    assert clip.labels is not None
    edge_px = settings.experiment.splat_edge_px
    if behind is None and edge_px:
        behind = static_background(clip, edge_px=edge_px)
    steps = fit_splats(clip.frames[0], clip.labels[0], depth0, clip.camera, settings, device=usable(settings.fit.device), behind=behind if edge_px else None)
    splats = yield from told("splats", steps)
    yield Progress("splats", text=f"{len(splats.mean)} Gaussians")
    return splats
