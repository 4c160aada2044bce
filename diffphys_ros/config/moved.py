"""Settings of earlier versions: what each is called now, or what says it instead."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

_SOURCE = "the source follows from what is given: prior.file, prior.materials, or prior.base_url with prior.model"
_LPIPS = "put both files into one folder as {} and give that folder as experiment.lpips_weights"

# 0.1 -> 0.2
RENAMED: Mapping[str, str] = MappingProxyType(
    {
        "tracks.spacing_px": "experiment.track_spacing_px",
        "tracks.window_px": "experiment.track_window_px",
        "tracks.round_trip_px": "experiment.track_round_trip_px",
        "particles.cells": "experiment.cells",
        "particles.per_cell": "experiment.per_cell",
        "particles.grid_nodes": "experiment.grid_nodes",
        "particles.downsample_ratio": "experiment.downsample_ratio",
        "prior.timeout_s": "experiment.prior_timeout_s",
        "prior.attempts": "experiment.prior_attempts",
        "prior.cache": "experiment.prior_cache",
        "modes.count": "experiment.mode_count",
        "splats.max_count": "experiment.max_splats",
        "splats.iterations": "experiment.splat_iterations",
        "splats.view_iterations": "experiment.view_iterations",
        "fit.schedule": "experiment.schedule",
        "fit.force_frame": "experiment.force_frame",
        "fit.field_iterations": "experiment.field_iterations",
        "fit.force_smoothness": "experiment.force_smoothness",
        "fit.max_substeps": "experiment.max_substeps",
        "fit.image_weight": "experiment.image_weight",
        "fit.ssim_weight": "experiment.ssim_weight",
        "fit.track_weight": "experiment.track_weight",
        "fit.depth_weight": "experiment.depth_weight",
        "fit.image_every": "experiment.image_every",
        "fit.seed": "experiment.seed",
        "fit.checkpoint_every_s": "experiment.checkpoint_every_s",
        "splats.refine_frames": "experiment.refine_frames",
    }
)
REMOVED: Mapping[str, str] = MappingProxyType(
    {
        "publish.max_markers": "a marker array has 300 arrows at most; publish.max_points bounds the clouds",
        "prior.source": _SOURCE,
        "metrics.lpips_backbone": _LPIPS.format("backbone.pth"),
        "metrics.lpips_heads": _LPIPS.format("heads.pth"),
        "modes.start_scale": "it checks the search and is the flag --guess_scale of `diffphys recover`",
        "fit.start_scale": "it checks the solver and is the flag --start_scale of `diffphys recover`",
    }
)


def moved(name: str) -> str:
    """A clause that says where a setting of an earlier version went, with the cure; empty for a name that was none."""
    if name in RENAMED:
        return f"is called {RENAMED[name]} since version 0.2; rename it"
    return f"is gone since version 0.2; {REMOVED[name]}" if name in REMOVED else ""
