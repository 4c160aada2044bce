"""By eigenmodes, where the fit kept the start values and their linear motion."""

from __future__ import annotations

import numpy as np

from ..modes import ModalModel
from ..types import ModalProblem, Recovery


def eigenmodes(recovery: Recovery, problem: ModalProblem, young_scale: float, force_scale: float) -> np.ndarray:
    """Displacements from frame 0 [m], body frame, shape (T, N, 3). What frequencies were seen to differ from the elements' grows with
    Young's modulus; gravity's prestress does not."""
    count = len(problem.elastic)
    nowhere = np.zeros((0, 3)), np.zeros((0, 10), int), np.zeros(0, int)  # the mesh: coordinates and basis at the particles are enough
    retuning = young_scale * problem.retuning
    same = {"inertia": np.eye(count)[None], "prestress": problem.geometric[None], "weight": np.zeros((1, count)), "density": np.ones(1)}
    model = ModalModel(*nowhere, problem.basis, problem.elastic[None], np.zeros((1, count, count)), np.zeros(1), retuning=retuning, reference=np.ones(1), **same)
    q = model.respond(
        np.array([young_scale]),
        damping=recovery.damping,
        load=force_scale * problem.force @ problem.load.T,
        period_s=recovery.period_s,
        initial_displacement=problem.initial_displacement,
        initial_velocity=problem.initial_velocity,
    )
    return np.einsum("pcr,tr->tpc", problem.basis, q - q[:1])
