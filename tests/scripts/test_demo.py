"""Claims about the verdict of the demonstrations."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
GOOD = {
    "young_pa": [1.1e5, 5.2e4],
    "young_true_pa": [1e5, 5e4],
    "young_ratio_error": 0.02,
    "net_force_cosine": 0.99,
    "false_force_ratio": 0.01,
    "force_peak_n": 1.0,
    "force_peak_true_n": 1.1,
    "trajectory_rmse_over_rms_motion": 0.03,
    "psnr_masked": 31.0,
    "psnr_masked_frozen_frame": 20.0,
    "refined": True,
    "misfit_refined": 0.4,
    "misfit_start": 0.8,
}


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> tuple[ModuleType, ModuleType]:
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    monkeypatch.syspath_prepend(str(SCRIPTS))
    import demo
    import demo_starts

    yield demo, demo_starts
    for name in ("demo", "demo_starts", "processes"):
        sys.modules.pop(name, None)


def test_a_good_recovery_passes(scripts: tuple[ModuleType, ModuleType], capsys: pytest.CaptureFixture[str]) -> None:
    assert scripts[0].print_comparison(GOOD)
    printed = capsys.readouterr().out
    assert "110 kPa" in printed
    assert "short" not in printed


@pytest.mark.parametrize(
    "flaw",
    [
        {"young_pa": [1.2e5, 5e4]},
        {"young_pa": [1e5, None]},
        {"young_ratio_error": 0.06},
        {"net_force_cosine": 0.94},
        {"false_force_ratio": 0.06},
        {"psnr_masked": 27.0},
        {"trajectory_rmse_over_rms_motion": 0.04},
        {"refined": False},
    ],
)
def test_one_missed_bound_fails_the_demonstration(
    scripts: tuple[ModuleType, ModuleType], flaw: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    assert not scripts[0].print_comparison(GOOD | flaw)
    assert capsys.readouterr().out.count("short") == 1


@pytest.mark.parametrize(("other", "status"), [(1.04, 0), (1.06, 1), (np.nan, 1)])
def test_starts_must_agree_within_five_percent(scripts: tuple[ModuleType, ModuleType], other: float, status: int) -> None:
    young = {"as it is": np.array([1e5, 5e4]), "from 3x": np.array([1e5, 5e4 * other])}
    assert scripts[1].print_table(young) == status


def test_different_numbers_of_parts_never_agree(scripts: tuple[ModuleType, ModuleType]) -> None:
    assert scripts[1].print_table({"as it is": np.array([1e5, 5e4]), "from 3x": np.array([1e5])}) == 1


@pytest.mark.parametrize(("found", "status"), [({}, 0), ({"refined": False}, 1), ({"trajectory_rmse_over_rms_motion": 0.045}, 1)])
def test_answers_that_are_the_start_values_never_count(scripts: tuple[ModuleType, ModuleType], found: dict[str, object], status: int) -> None:
    good = {"refined": True, "trajectory_rmse_over_rms_motion": 0.035}
    assert scripts[1].print_simulated({"as it is": good, "from 3x": good | found}) == status
