"""Zones in the fit: a bar of two materials that is taken for one part."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.config import build
from diffphys_ros.inverse import solve
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.zones import WITHOUT_ELEMENTS, divided, zones_of

from .conftest import YOUNG, as_one_part
from .test_solve import drive

FIELD = build({
    "scene.at_rest": True, "scene.density_kg_m3": [600.0], "experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 3,
    "fit.material_field": "residual", "experiment.field_iterations": 4,
})  # fmt: skip


@pytest.fixture(scope="module")
def one_part(prepared) -> Prepared:
    return as_one_part(prepared, 0.1)


@pytest.fixture(scope="module")
def zones(one_part):
    return drive(zones_of(one_part, FIELD))[1]


@pytest.fixture(scope="module")
def recovery(one_part, zones):
    """From a force that is too weak: what the linear modes, of which the tracks were made, would explain to the last digit is off then."""
    weak = dataclasses.replace(zones, start=dataclasses.replace(zones.start, force=0.8 * zones.start.force))
    return drive(solve(dataclasses.replace(one_part, zones=weak), None, FIELD))[1]


def truth(recovery) -> np.ndarray:
    return np.where(recovery.points[:, 0] < 0.1, *YOUNG)


def test_a_field_finds_both_materials_that_one_constant_cannot_be(recovery):
    far = np.abs(recovery.points[:, 0] - 0.1) > 0.03
    error = np.abs(np.log10(recovery.young / truth(recovery)))[far]
    constant = np.abs(np.log10(1.7e5 / truth(recovery)))[far]
    assert recovery.metrics["refined"]
    assert np.mean(error) < 0.5 * np.mean(constant)
    assert (error < 2 * recovery.log10_young_sd[far]).mean() > 0.95


def test_the_answer_speaks_of_the_parts_that_were_seen_and_holds_the_zones_beside_them(recovery, zones):
    assert set(recovery.part) == {1}
    assert recovery.identified.shape == (1,)
    assert "log10 E known to" in recovery.reasons[0]
    assert len(recovery.metrics["young_refined_pa"]) == 1
    assert len(recovery.metrics["zones"]["young_refined_pa"]) == len(zones.part)


def test_the_spread_differs_along_the_body(recovery):
    x = recovery.points[:, 0]
    assert recovery.log10_young_sd[x > 0.27].mean() > 1.5 * recovery.log10_young_sd[x < 0.03].mean()


def test_constants_per_part_need_no_zones_and_ignore_those_a_clip_carries(one_part, zones):
    constants = build({"fit.material_field": "part"})
    assert drive(zones_of(dataclasses.replace(one_part, zones=zones), constants)) == ([], None)
    assert divided(dataclasses.replace(one_part, zones=zones), None).zones is None


def test_a_clip_without_a_free_tail_has_no_zones(one_part):
    forced = dataclasses.replace(one_part, start=dataclasses.replace(one_part.start, has_free_tail=False))
    assert drive(zones_of(forced, FIELD)) == ([], None)


def test_zones_travel_with_the_clip_to_a_machine_without_finite_elements(one_part, zones, tmp_path, monkeypatch):
    result.save_prepared(tmp_path / "clip.npz", dataclasses.replace(one_part, zones=zones), FIELD)
    loaded = result.load_prepared(tmp_path / "clip.npz")
    monkeypatch.delitem(sys.modules, "diffphys_ros.elements.assemble")
    monkeypatch.setitem(sys.modules, "skfem", None)
    _, found = drive(zones_of(loaded, FIELD))
    np.testing.assert_array_equal(found.start.young, zones.start.young)
    news, found = drive(zones_of(one_part, FIELD))
    assert found is None
    assert news[-1].text == WITHOUT_ELEMENTS
