"""The law that the settings name is the one that is fitted."""

import pytest
import torch

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.law import law_to_fit
from diffphys_ros.inverse.prepare import prepare
from diffphys_ros.inverse.problem import pose_problem
from diffphys_ros.simulate.laws import LAWS

ELASTIC = [name for name, law in LAWS.items() if law.elastic]


def test_every_elastic_law_can_be_fitted():
    assert [law_to_fit(build({"fit.law": name})) for name in ELASTIC] == ELASTIC
    assert law_to_fit(build({})) == "neo_hookean"


@pytest.mark.parametrize("name", [name for name in LAWS if name not in ELASTIC])
def test_a_law_that_flows_is_refused_before_the_work_begins(name, made_clip):
    with pytest.raises(InputError, match=rf"fit.law: '{name}' flows, .* choose one of neo_hookean, "):
        next(prepare(made_clip, build({"fit.law": name})))


def test_a_misspelt_law_is_answered_with_the_known_ones():
    with pytest.raises(InputError, match=r"fit.law: 'neohookean' is unknown; choose one of neo_hookean, "):
        law_to_fit(build({"fit.law": "neohookean"}))


def test_the_fit_simulates_with_the_law(prepared):
    reached = []
    for law in ("neo_hookean", "linear_corotated"):
        settings = build({"scene.at_rest": True, "experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 3, "fit.law": law})
        simulator = pose_problem(prepared, None, settings).forward.simulator
        stretched = simulator.rest(F=torch.diag(torch.tensor([1.3, 1.0, 1.0])).expand(len(simulator.volume), 3, 3))
        with torch.no_grad():
            after = simulator.frame(stretched, torch.full_like(simulator.volume, 1e4), simulator.tensor(0.3), None, 0.0)
        reached.append(after.x)
    assert (reached[0] - reached[1]).abs().max() > 1e-3
