"""Claims about the baselines: what one frequency says of E, and what the table counts."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from diffphys_ros.modes import ModalModel
from tests.script import loaded

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def baselines(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return loaded(BENCHMARKS / "baselines.py")


def model(prestress: float) -> ModalModel:
    """Two modes at 1 kPa, (2 pi 3)^2 and (2 pi 9)^2, and a prestress that stiffens both."""
    elastic = np.diag((2 * np.pi * np.array([3.0, 9.0])) ** 2)[None] / 1e3
    empty = np.zeros((0, 3))
    return ModalModel(
        nodes=empty,
        tets=np.zeros((0, 10), int),
        part=np.zeros(0, int),
        basis=np.zeros((0, 3, 2)),
        stiffness=elastic,
        by_poisson=0 * elastic,
        poisson=np.zeros(1),
        inertia=np.eye(2)[None],
        prestress=prestress * np.eye(2)[None],
        weight=np.zeros((1, 2)),
        density=np.ones(1),
        retuning=np.zeros((2, 2)),
        reference=np.array([1e3]),
    )


def test_the_modulus_of_a_frequency_goes_with_its_square(baselines) -> None:
    assert baselines.swinging_at(model(0.0), 6.0) == pytest.approx(4e3, rel=1e-6)


def test_what_gravity_stiffens_is_not_taken_for_elasticity(baselines) -> None:
    assert baselines.swinging_at(model((2 * np.pi * 4.0) ** 2), 5.0) == pytest.approx(1e3, rel=1e-6)


def test_every_method_has_its_line_and_parts_without_a_modulus_are_not_counted(baselines) -> None:
    about = {"device": "d", "versions": "v", "commit": "c"}
    rows = [{"clip": name, "method": baselines.FREQUENCY, "young": young, **about} for name, young in (("a", [-0.1, 0.6]), ("b", [0.3, None]), ("c", []))]
    rows += [{"clip": "a", "method": baselines.OURS, "young": [0.01, 0.02], "cosine": 0.9, "trajectory": 0.05, **about}]
    lines = baselines.table(rows).splitlines()
    assert [line.split(" | ")[0].strip("| ") for line in lines[2:6]] == list(baselines.METHODS)
    assert lines[2].split(" | ")[1:4] == ["3", "0.200, 0.280", "0.600"]
    assert lines[5].split(" | ")[1:] == ["1", "0.010, 0.010", "0.020", "0.900", "0.050 |"]


def test_the_stored_table_is_that_of_its_rows(baselines) -> None:
    page = baselines.PAGE.read_text()
    assert baselines.filled(page) == page
