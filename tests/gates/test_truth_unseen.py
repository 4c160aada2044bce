"""The truth that lies beside the bundled clips helps nobody."""

from __future__ import annotations

import shutil
from pathlib import Path

from diffphys_ros import result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.sample import sample_folder

from .conftest import COARSE, Recover
from .test_grid import TOO_COARSE


def test_a_clip_without_its_truth_is_recovered_to_the_same_byte(recovered: Recover, tmp_path: Path) -> None:
    for name in ("clip.mcap", "given.yaml", "mask0.png"):
        shutil.copy(sample_folder("bar") / name, tmp_path)
    given = ["--config", str(tmp_path / "given.yaml"), "--out", str(tmp_path / "out")]
    assert main(["recover", str(tmp_path / "clip.mcap"), *given, *COARSE, *TOO_COARSE]) == 0
    beside_its_truth = recovered("bar", *TOO_COARSE).folder
    assert (sample_folder("bar") / "truth.npz").exists()
    for name in (result.RECOVERY, result.RECORDING):
        assert (tmp_path / "out" / name).read_bytes() == (beside_its_truth / name).read_bytes()
