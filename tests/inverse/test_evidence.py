"""Claims about kinds of evidence: what each sees, and that one of a person's own counts."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from diffphys_ros.inverse.evidence import EVIDENCE, Moved, Told
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.problem import pose_problem

NET = np.array([0.0, 0.02, -0.01])  # a "measured" net force [N]


def net_force(told: Told):
    """Misfit of the mean net force [N^2]."""

    def misfit(moved: Moved) -> dict[str, torch.Tensor]:
        mean = (moved.force * told.volume[:, None]).sum(1).mean(0)
        return {"wrench": (mean - mean.new_tensor(NET)).square().sum().double()}

    return misfit


@pytest.mark.parametrize("engine", ["modes", "mpm"])
def test_evidence_of_a_kind_of_its_own_sees_the_force_that_acted_and_pulls_at_it(prepared, quick_settings, monkeypatch, engine) -> None:
    monkeypatch.setitem(EVIDENCE, "wrench", net_force)
    problem = pose_problem(prepared, None, quick_settings)
    model, p, start = Model(problem), problem.disc.particles, prepared.start
    model.engine, model.evidence = problem.engines[engine], ("wrench",)
    terms = model()
    volume = (p.volume * start.footprint.weights(p.x_rest) * ~p.ghost).sum()
    assert terms.parts["wrench"] == pytest.approx((((volume * start.force[:-1]).mean(0) - NET) ** 2).sum(), rel=1e-4)
    terms.total.backward()
    assert model.blocks["force"].grad is not None
    assert (model.blocks["force"].grad != 0).any()
