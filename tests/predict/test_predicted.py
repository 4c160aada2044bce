"""Frames that the fit never sees: they change nothing of its answer, and they tell a right stiffness from a wrong one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config, result
from diffphys_ros.__main__ import main
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.bags.write import write_recording
from diffphys_ros.batch.figures import PREDICTED, figures_of
from diffphys_ros.errors import SimulationError
from diffphys_ros.inverse import Prepared, run
from diffphys_ros.predict import Figures, HeldOut, figures, held_out, predicted
from diffphys_ros.predict import let_free as room
from diffphys_ros.progress import finished
from diffphys_ros.resimulate import simulate_again
from diffphys_ros.score import score_folder
from diffphys_ros.types import Recovery, Splats
from tests.coarse import coarse_elements
from tests.quick_batch import QUICK_FLAGS, QUICK_WORDS
from tools.sample_maker.messages import clip_messages

FITTED, KEPT_BACK = 26, 10  # of the sample's 36 frames; its force ends with frame 10
FLAGS = QUICK_FLAGS | {"experiment.refine_frames": 0, "frames.fit": FITTED, "scene.poisson_ratio": [0.3], "frames.predict": KEPT_BACK}
WORDS = (*QUICK_WORDS, "--experiment.refine_frames", "0", "--frames.fit", str(FITTED), "--scene.poisson_ratio", "[0.3]", "--frames.predict", str(KEPT_BACK))


@dataclass(frozen=True)
class Found:
    """A quick recovery of the sample's first frames, and what judges it."""

    source: Path
    settings: config.Settings
    prepared: Prepared
    splats: Splats
    recovery: Recovery
    held: HeldOut

    def predicting(self, recovery: Recovery, **scales: float) -> Figures:
        """Figures of a recovery in the place of the one found."""
        trajectory = simulate_again(recovery, free_frames=KEPT_BACK, **scales)
        return figures(self.held, self.prepared.body, trajectory, None, force_at_end=room.force_at_end(recovery))

    def saved(self, folder: Path) -> Path:
        result.save(self.recovery, self.prepared.clip, self.settings, folder)
        return folder


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    with coarse_elements():
        yield


@pytest.fixture(scope="module")
def found(coarse: None, half_sample: Path) -> Found:
    source, settings = half_sample / "clip.mcap", config.layered([half_sample / "given.yaml"], FLAGS)
    prepared, splats, recovery = finished(run(source, settings))
    recovery = finished(predicted(source, prepared, splats, recovery, settings))
    return Found(source, settings, prepared, splats, recovery, held_out(source, prepared, settings))


def test_a_sound_answer_predicts_far_better_than_a_still_picture(found: Found) -> None:
    prediction = Figures(**found.recovery.metrics["prediction"])  # type: ignore[arg-type]
    assert (len(found.recovery.trajectory), prediction.frames, prediction.force_at_end) == (FITTED, KEPT_BACK, False)
    assert prediction.over_rms_motion == prediction.rms_m / prediction.rms_motion_m < 0.1
    assert min(prediction.over_rms_motion_at_rest, prediction.over_rms_motion_last_frame) > 0.9
    assert prediction.psnr_masked > max(prediction.psnr_masked_frozen_frame, prediction.psnr_masked_last_frame) + 1
    assert room.STILL_ACTING not in found.recovery.notes
    assert "10 frames, misfit 0." in prediction.described()


@pytest.mark.parametrize("scale", [1 / 1.5, 1.5])
def test_a_wrong_stiffness_predicts_clearly_worse(found: Found, scale: float) -> None:
    assert found.predicting(found.recovery, young_scale=scale).over_rms_motion > 10 * found.predicting(found.recovery).over_rms_motion


def test_black_frames_in_the_place_of_those_kept_back_change_nothing_of_the_fit(found: Found, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = read_clip(found.source, config.build({}))
    assert clip.depth is not None
    seen = (np.arange(len(clip)) < FITTED)[:, None, None]
    write_recording(tmp_path / "clip.mcap", clip_messages(clip.camera, clip.frames * seen[..., None], clip.depth * seen))
    words = ["recover", str(tmp_path / "clip.mcap"), "--out", str(tmp_path / "dark"), "--config", str(found.source.parent / "given.yaml")]
    assert main([*words, *WORDS]) == 0
    assert (tmp_path / "dark" / result.RECOVERY).read_bytes() == (found.saved(tmp_path) / result.RECOVERY).read_bytes()
    assert "prediction: 10 frames; no point that was fitted is seen to move in them\n" in capsys.readouterr().out


def test_a_force_that_still_acts_at_the_end_is_said(found: Found) -> None:
    force = found.recovery.force.copy()
    force[FITTED - 2] = force[np.abs(force).sum((1, 2)).argmax()]
    assert room.force_at_end(replace(found.recovery, force=force))
    force[FITTED - 2], force[FITTED - 1] = 0, force.max()  # acts after the last frame, where nothing was seen
    assert not room.force_at_end(replace(found.recovery, force=force))


def test_a_prediction_that_leaves_the_grid_is_a_note(found: Found, monkeypatch: pytest.MonkeyPatch) -> None:
    def leave(*_: object, **__: object) -> None:
        raise SimulationError("it left the grid")

    monkeypatch.setattr(room, "simulate_again", leave)
    monkeypatch.setattr(room, "held_out", lambda *_: found.held)
    bare = replace(found.recovery, metrics={})
    after = finished(predicted(found.source, found.prepared, found.splats, bare, found.settings))
    assert after.notes[-1] == "nothing was predicted: it left the grid"
    assert "prediction" not in after.metrics


def test_a_truth_of_more_frames_scores_it_and_the_summary_has_a_column(found: Found, tmp_path: Path) -> None:
    scored = score_folder(found.saved(tmp_path), sample_folder() / "truth.npz")
    assert abs(scored["young_log10_error"][0]) < found.recovery.log10_young_sd.max() < 0.15  # type: ignore[index]
    assert scored["trajectory_rmse_over_rms_motion"] < 0.1  # type: ignore[operator]
    assert figures_of(tmp_path)[PREDICTED] == found.recovery.metrics["prediction"]["over_rms_motion"]  # type: ignore[index]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--frames.fit 30 --frames.predict 10", "has 36 frames, frames.fit 30 and frames.predict 10 need 40; lower one of them, or record a longer clip"),
        ("--frames.fit 37", "has 36 frames, frames.fit 37 and frames.predict 0 need 37; lower one of them"),
        ("--frames.predict 36", "has 36 frames, of which frames.predict 36 leaves 0 to the fit, at least 2 are needed; lower it"),
        ("--frames.predict 30", "has 6 frame(s), needs at least 8; record a longer clip, or leave more to the fit (frames.fit, frames.predict)"),
        ("--frames.predict -1", "frames.predict is -1, must be"),
    ],
)
def test_frames_that_are_not_there_are_refused(half_sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, said: str) -> None:
    assert main(["recover", str(half_sample / "clip.mcap"), "--out", str(tmp_path / "out"), *words.split()]) == 2
    assert said in capsys.readouterr().err


def test_a_prepared_clip_has_no_frames_to_predict(half_sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ingest", str(half_sample / "clip.mcap"), "--out", str(tmp_path / "clip.npz"), "--frames.predict", "4"]) == 2
    assert "frames.predict is 4, must be 0 for a prepared .npz" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
