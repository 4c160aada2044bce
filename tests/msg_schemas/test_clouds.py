"""Claims about clouds that others publish."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import clouds, messages


def cloud(**changes: Any) -> dict[str, Any]:
    layout = {"x": "m", "id": "#"}
    good = clouds.pack(messages.header(1, "world"), layout, {"x": np.arange(3), "id": np.arange(3)}, (1, 3))
    return pickle.loads(pickle.dumps(good)) | changes


def field(name: Any = "x", offset: Any = 0, datatype: Any = 7, count: Any = 1) -> dict[str, Any]:
    return {"name": name, "offset": offset, "datatype": datatype, "count": count}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"height": 0, "row_step": 0, "data": b""}, "0 x 3 points, at least one"),
        ({"height": 0, "data": b""}, "0 x 3 points, at least one"),
        ({"width": 0, "row_step": 0, "data": b""}, "1 x 0 points, at least one"),
        ({"point_step": 0}, "within the 0 bytes of a point"),
        ({"point_step": 4}, "within the 4 bytes of a point"),
        ({"fields": [field(offset=5), field("id")]}, "offset 5 and count 1"),
        ({"fields": [field(offset=-4), field("id")]}, "offset -4"),
        ({"fields": [field(offset=2**32 - 1), field("id")]}, "offset 4294967295"),
        ({"fields": [field(), field()]}, "a field is called 'x'"),
        ({"fields": [field(), field("")]}, "a field is called ''"),
        ({"fields": [field(), field(7)]}, "a field is called 7"),
        ({"fields": [field(), field("id", count=2)]}, "count 2"),
        ({"fields": [field(), field("id", datatype=8)]}, "neither float32 nor uint32"),
        ({"fields": [field("y")]}, "has no field 'x'"),
        ({"fields": []}, "has no field"),
        ({"fields": [field(f"f{k}") for k in range(300)]}, "over 256 fields"),
        ({"width": 2**32 - 1, "row_step": 24}, "do not hold"),
        ({"width": 2**31, "height": 2**31, "row_step": 2**31}, "do not hold"),
        ({"row_step": 2**32 - 1}, "do not hold"),
        ({"data": bytes(23)}, "23 bytes do not hold"),
        ({"data": None}, "do not hold"),
        ({"height": -1}, "height is -1"),
        ({"width": 1.5}, "width is 1.5"),
    ],
)
def test_a_malformed_cloud_is_refused_with_its_fault(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        clouds.unpack(cloud(**changes), ("x", "id"))
    assert len(str(caught.value)) < 300


def test_rows_of_which_only_a_part_is_used_are_read() -> None:
    wide = cloud(width=2)
    assert clouds.unpack(wide, ("x",))["x"].tolist() == [[0, 1]]
