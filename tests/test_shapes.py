"""Claims about what stored arrays must look like."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from diffphys_ros import shapes
from diffphys_ros.modes.model import ModalModel
from diffphys_ros.types import Body, Camera, Clip, MaterialPrior, ModalProblem, MpmProblem, Recovery, StartValues, Tracks

TABLES = {
    Camera: shapes.CAMERA, Clip: shapes.CLIP, Tracks: shapes.TRACKS, Body: shapes.BODY, StartValues: shapes.START, ModalModel: shapes.MODAL, MaterialPrior: shapes.PRIOR,
    Recovery: shapes.RECOVERY, MpmProblem: shapes.MPM, ModalProblem: shapes.MODES,
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES, ids=lambda kind: kind.__name__)
def test_every_array_of_a_stored_class_has_its_line(kind: type) -> None:
    arrays = {field.name for field in dataclasses.fields(kind) if "ndarray" in str(field.type)}
    assert arrays - set(TABLES[kind]) == set()
    assert set(TABLES[kind]) <= {field.name for field in dataclasses.fields(kind)}


def test_a_letter_stands_for_one_length() -> None:
    assert shapes.check({"a": np.zeros((2, 3)), "b": np.zeros(3)}, {"a": "real N 3", "b": "real 3"}) == {"N": 2}
    with pytest.raises(shapes.MisshapenError, match=r"b is of shape \(3,\), must be \(N = 2\)"):
        shapes.check({"a": np.zeros((2, 3)), "b": np.zeros(3)}, {"a": "real N 3", "b": "real N"})


@pytest.mark.parametrize(
    ("line", "value"),
    [
        *(("real", np.nan), ("real", 1e31), ("positive", 0.0), ("amount", -1.0), ("truth", 1), ("whole", 1.0), ("text", 3)),
        *(("pixel 1", np.zeros(1, np.uint16)), ("real 1", np.zeros(1, np.float16)), ("real 1", np.zeros(1, int))),
    ],
)
def test_a_number_of_another_kind_is_refused(line: str, value: object) -> None:
    with pytest.raises(shapes.MisshapenError, match="a "):
        shapes.check({"a": value}, {"a": line})
