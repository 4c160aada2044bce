"""Claims about the table of filmed strips."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.script import loaded

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def films(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return loaded(BENCHMARKS / "films.py")


def test_the_frequency_of_a_decaying_swing_is_found_in_noise(films: ModuleType) -> None:
    t = np.arange(180) / 240.0
    moved = 3.0 + 2.0 * np.exp(-0.6 * t) * np.sin(2 * np.pi * 4.87 * t + 0.4) + 0.02 * np.random.default_rng(0).normal(size=len(t))
    assert films.sine_hz(moved, 1 / 240.0) == pytest.approx(4.87, rel=2e-3)


def test_a_row_holds_what_a_run_says_and_the_body_let_free(films: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = tmp_path / "75mm_1-0123abcd"
    result.mkdir()
    swing = {"tip_error_share": 0.05, "constant_error_share": 0.06}
    (result / "metrics.json").write_text(json.dumps({"outline": {"rest_frame": 5, "end_frame": 50, "length_told": True, "px_per_m": 2500.0, "behind_px": 22.0, "swing": swing}}))
    modes = np.diag((2 * np.pi * np.array([2.0, 5.0])) ** 2)
    force = np.zeros((3, 4, 3))
    force[1, :, 0] = 0.01 * films.STANDARD_GRAVITY  # of four points that weigh .4 kg
    np.savez(
        result / "recovery.npz", density=np.full(4, 1000.0), volume=np.full(4, 1e-4), young=np.full(4, 7.4e4), log10_young_sd=np.full(4, 0.02), force=force, modes_elastic=modes, modes_geometric=0 * modes, modes_retuning=0 * modes
    )
    monkeypatch.setattr(films, "_swing_hz", lambda *_: 4.95)
    row = films.row_of(result, tmp_path)
    assert row.group == "75mm"
    assert (row.specific, row.body_hz, row.force_share) == pytest.approx((74.0, 5.0, 0.1))
    text = films.table([row, row])
    assert "| 75mm_1 | 74 | +0.000 | 0.020 | 22.0 | 2.500 | 4.950 | +1.01% | 0.100 | 5.0 % | 6.0 % |" in text
    assert "over 2 repeats 0.0000" in text
