"""The figures of a result folder that the summary shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .. import result, store
from ..errors import InputError

SCORED_PARTS = ("young_log10_error", "young_log10_sd", "young_lower_log10", "specific_log10_error", "specific_log10_sd")  # by the truth's parts, which may be more or fewer
OF_PARTS = ("identified", "young_pa", "log10_young_sd", *SCORED_PARTS)
MODAL = "modal_force_relative_rmse"
PREDICTED = "prediction_over_rms_motion"  # of frames that were kept back
HZ = "observed_hz"  # of the leading free oscillation [Hz]
OF_CLIP = (
    "force_identified",
    "scale",
    HZ,
    "young_ratio_error",
    "net_force_cosine",
    "false_force_ratio",
    "net_force_relative_rmse",
    "net_force_across_cosine",
    "net_force_across_relative_rmse",
    MODAL,
    "force_peak_n",
    "force_peak_true_n",
    "force_peak_stated_n",
    "force_peak_sd_n",
    "net_force_inside_1sd",
    "net_force_inside_2sd",
    "net_force_relative_sd",
    "trajectory_rmse_over_rms_motion",
    "psnr_masked",
    "psnr_masked_frozen_frame",
    PREDICTED,
)


def figures_of(folder: Path) -> dict[str, Any]:
    """Figures of OF_PARTS, a list with an entry for each part, and those of OF_CLIP that the result has.

    young_pa [Pa] is the median over a part, None where it is not identified; log10_young_sd its standard deviation. Both hold at the assumed
    density and size where `scale` says that they are relative. Errors are
    there after a score. Raises InputError for a folder without a whole result.
    """
    path = folder / result.RECOVERY
    arrays, metrics = store.read_arrays(path, "recovery"), result.read_metrics(folder)
    missing = [name for name in ("identified", "part", "young", "log10_young_sd") if name not in arrays]
    if missing or not metrics:
        raise InputError(f"recovery {path}: {', '.join(missing) or result.METRICS} is missing; recover the clip again")
    identified, part = arrays["identified"].astype(bool), arrays["part"]
    parts = range(1, len(identified) + 1)

    def medians(name: str) -> list[float | None]:
        return [_median(arrays[name][part == k]) if identified[k - 1] else None for k in parts]

    found = {"identified": identified.tolist(), "young_pa": medians("young"), "log10_young_sd": medians("log10_young_sd")}
    found |= {name: metrics[name] for name in SCORED_PARTS if isinstance(metrics.get(name), list)}
    if isinstance(modal := metrics.get(MODAL), list):
        metrics[MODAL] = modal[0] if modal else None  # of the mode that moves most
    if isinstance(seen := metrics.get(HZ), list):
        metrics[HZ] = seen[0] if seen else None
    if isinstance(prediction := metrics.get("prediction"), dict):
        metrics[PREDICTED] = prediction.get("over_rms_motion")
    return found | {name: metrics[name] for name in OF_CLIP if metrics.get(name) is not None}


def _median(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None
