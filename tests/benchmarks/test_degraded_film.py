"""A film made worse keeps its frames, its clock and its mean; blur takes from edges, noise is as strong as it says. Films of other cameras have
their frames, their rate and their size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.script import loaded

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.mark.parametrize("how", ["blur", "noise"])
def test_a_worse_film_has_the_frames_and_the_clock_of_the_film(tmp_path: Path, how: str) -> None:
    frame = np.full((48, 64, 3), 60, np.uint8)
    frame[:, 32:] = 160
    film, out = tmp_path / "film.avi", tmp_path / "worse.avi"
    made = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*"FFV1"), 120.0, (64, 48))
    for _ in range(3):
        made.write(frame)
    made.release()
    assert loaded(BENCHMARKS / "degraded_film.py").main(str(film), str(out), how) == 0
    read = cv2.VideoCapture(str(out))
    assert (read.get(cv2.CAP_PROP_FRAME_COUNT), read.get(cv2.CAP_PROP_FPS)) == (3, 120.0)
    worse = read.read()[1].astype(float)
    assert worse.mean() == pytest.approx(110.0, abs=0.5)
    across = worse[:, :, 0].mean(0)
    if how == "blur":
        assert across[33] - across[30] == pytest.approx(100 * 0.547, abs=3.0)  # within 1.5 px of the edge: erf(.75 / sqrt 2)
    else:
        assert worse[:, :20].std() == pytest.approx(5.0, abs=0.5)


def test_films_of_other_cameras_have_their_frames_their_rate_and_their_size() -> None:
    film, fps = np.zeros((104, 160, 200, 3), np.uint8), 240.0
    film[:, :120, 90:110] = 100
    made = {how: worse(film, fps) for how, worse in loaded(BENCHMARKS / "degraded_film.py").WORSE.items() if how not in ("blur", "noise", "double", "gamma")}
    told = {how: (frames.shape[:3], rate) for how, (frames, rate) in made.items()}
    assert {frames.dtype for frames, _ in made.values()} == {np.dtype(np.uint8)}
    assert told["60fps"] == told["60fps-shutter"] == ((26, 160, 200), 60.0)
    assert told["turned"] == ((104, 200, 160), 240.0)
    assert told["half"] == ((104, 80, 100), 240.0)
    assert told["slow-motion"] == ((104, 160, 200), 30.0)
    assert told["two-periods"] == ((98, 160, 200), 240.0)
    assert told["no-top"] == ((104, 130, 200), 240.0)
    held = made["held"][0]
    assert len(held) == 128
    assert held[0, 115, 120:190].min() > 100
    assert np.array_equal(held[-1], film[-1])
