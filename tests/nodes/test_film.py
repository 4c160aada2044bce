"""Claims about a film of a plain object as live topics: five processes read its outline as the library does that is given the recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config, inverse, result
from diffphys_ros.progress import finished
from tests.plain_strips import Strip

from .conftest import FEW
from .processes import FIT_S, Domain

pytestmark = pytest.mark.faults

STRIP = Strip(frames=60, hz=8.0)  # as few frames as show the periods that are asked for
TOLD = f"""
scene: {{size_m: {STRIP.length_px / STRIP.px_per_m}, density_kg_m3: [1070.0], gravity_m_s2: [0.0, 0.0, 0.0], target_frame: camera_optical}}
"""


def test_a_film_of_a_plain_strip_through_five_processes_is_answered_bit_for_bit_as_by_one(tmp_path: Path) -> None:
    bag, files = STRIP.record(tmp_path / "strip.mcap"), []
    for name, text in {"told.yaml": TOLD, "few.yaml": FEW}.items():
        files.append(tmp_path / name)
        files[-1].write_text(text)
    given = {"config": f"[{', '.join(map(str, files))}]"}
    with Domain(tmp_path) as domain:
        domain.node("ingest_node", reliability="reliable", silence_s=6.0, **given)
        domain.node("segment_node", **given)
        domain.node("splat_node", **given)
        domain.node("fit_node", out=tmp_path / "five", **given)
        domain.start("camera", "-m", "diffphys_ros.nodes.replay", str(bag), "--inputs")
        domain.await_words("fit_node", "done: results in", FIT_S)
        assert domain.end_all() == dict.fromkeys(domain.running, 0)
    settings = config.layered(files)
    prepared, _, recovery = finished(inverse.run(bag, settings))
    result.save(recovery, prepared.clip, settings, tmp_path / "one")
    one, five = (np.load(tmp_path / side / result.RECOVERY) for side in ("one", "five"))
    assert set(one.files) == set(five.files)
    for name in one.files:
        np.testing.assert_array_equal(one[name], five[name], err_msg=name)
    assert abs(np.log10(np.median(five["young"]) / 1070.0 / STRIP.specific)) < 0.025
