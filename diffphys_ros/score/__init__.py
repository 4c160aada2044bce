"""A recovery against a known truth. Nothing else in the package opens a truth.

A truth is an .npz of a finite-element scene with V vertices and T frames: rest_vertices (V, 3), positions (T, V, 3) [m, world],
part_E (n,) and vertex_E (V,) [Pa], vertex_part (V,) 0..n-1, interface (V,) bool (vertices shared by parts), vertex_volume (V,)
[m^3], clamped (V,) bool, force_density (T, V, 3) [N/m^3]; where they are there, stamps_ns (T,) and time (T,) [s] or fps [Hz]
place its frames beside those of a clip that lost some.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import folder as folders
from .. import result
from .force import net_force, score_force, score_force_sd
from .modal import score_modal
from .stiffness import score_young
from .truth import RECOVERY, TRUTH, Arrays, match, on_truth_frames, read, read_truth, spread

__all__ = ["net_force", "read_truth", "score", "score_folder"]


def score(recovery_npz: str | Path, truth_npz: str | Path) -> dict[str, object]:
    """Figures of a recovery.npz against a truth.npz.

    young_log10_error: log10(recovered / true) by part, of the median over points off the interface, None where not identified;
    young_ratio_error: worst |log10| of the error in the ratio of two parts, None with fewer than two;
    net_force_cosine: mean cosine of recovered and true net force over forced frames; false_force_ratio: rms of the recovered
    net force over force-free frames / true peak; net_force_relative_rmse: rms error of the net force over its rms;
    net_force_across_cosine, net_force_across_relative_rmse: the same of what acts across the line from the clamp to the body's middle, which is what bends it;
    modal_force_relative_rmse: likewise of the generalised force on the true motion's leading modes, a list;
    trajectory_rmse_over_rms_motion: 1 is no better than predicting no motion.
    net_force_inside_1sd, net_force_inside_2sd: share of the components of the net force, over frames that carry one, off by no more than one or two
    stated standard deviations; net_force_relative_sd: rms of these over the rms of the true net force; force_peak_stated_n, force_peak_sd_n: the stated peak and its standard deviation.
    With them young_pa, young_true_pa (by part) and force_peak_n, force_peak_true_n, and what was stated of E: see score_young.
    Raises InputError for unreadable files.
    """
    found: Arrays = read(recovery_npz, "recovery", RECOVERY)
    recovery, truth = on_truth_frames(found, read(truth_npz, "truth", TRUTH), recovery_npz)
    vertices, nearest = match(truth, recovery["points"])
    force = spread(recovery["points"], vertices, recovery["force"][: len(truth["positions"])].astype(float))
    return {
        **score_young(truth, nearest, recovery),
        **score_force(truth, force),
        **score_force_sd(truth, recovery),
        **score_modal(truth, force),
        "trajectory_rmse_over_rms_motion": _score_motion(truth, vertices, recovery),
    }


def score_folder(folder: str | Path, truth_npz: str | Path) -> dict[str, object]:
    """Scores the recovery.npz of a result folder and adds the figures to its metrics.json. Raises InputError, also where a run
    still works in the folder."""
    figures = score(folders.current(folder, result.RECOVERY), truth_npz)
    with result.owned(folder):
        result.write_metrics(folder, result.read_metrics(folder) | figures)
    return figures


def _score_motion(truth: Arrays, vertices: np.ndarray, recovery: Arrays) -> float | None:
    path = recovery["trajectory"][: len(truth["positions"])].astype(float)
    true = truth["positions"][: len(path)].astype(float)
    motion = spread(vertices, recovery["points"], true - true[0])
    moved = (motion**2).sum(2).mean()
    return float(np.sqrt(((path - path[0] - motion) ** 2).sum(2).mean() / moved)) if moved > 0 else None
