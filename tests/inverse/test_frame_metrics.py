"""Figures over the moving frames, and LPIPS in the metrics or a sentence that it is absent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.choice import worse_than_still
from diffphys_ros.inverse.frame_metrics import Judge, moving_frames
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.metrics.image import psnr_masked
from diffphys_ros.types import Clip, Recovery, Tracks
from tests.metrics.test_lpips import TAPS, alexnet

STILL = 5  # frames before the object of `judged` moves


def tracks_of(shift_px: np.ndarray) -> Tracks:
    """Six tracks shifted by so much in every frame."""
    pixels = np.random.default_rng(0).uniform(10, 40, (1, 6, 2)) + np.stack([shift_px, 0 * shift_px], -1)[:, None]
    return Tracks(pixels, np.zeros((len(shift_px), 6, 3)), np.ones((len(shift_px), 6), bool), False, 1e-4)


@pytest.fixture
def case(prepared: Prepared, made_clip: Clip, made_recovery: Recovery) -> tuple[Prepared, Recovery]:
    """The clip stands still for some frames; the rendering is one grey level off everywhere."""
    frames, labels = made_clip.frames.copy(), made_clip.labels.copy()
    frames[:STILL], labels[:STILL] = frames[0], labels[0]
    clip = replace(made_clip, frames=frames, labels=labels)
    shift = np.where(np.arange(len(clip)) < STILL, 0.1, 2.0)
    own = replace(prepared, clip=clip, tracks=tracks_of(shift))
    return own, replace(made_recovery, frames=np.where(frames < 255, frames + 1, 254).astype(np.uint8))


def test_a_frame_moves_when_its_tracks_do() -> None:
    assert moving_frames(tracks_of(np.array([0, 0.4, 0.6, -3.0]))).tolist() == [False, False, True, True]


def test_lost_tracks_do_not_make_a_frame_move() -> None:
    tracks = tracks_of(np.array([0, 0.1, 9.0]))
    tracks.valid[2] = False
    assert moving_frames(tracks).tolist() == [False, False, False]


def test_still_frames_do_not_lift_the_psnr_of_the_moving_ones(case: tuple[Prepared, Recovery]) -> None:
    prepared, recovery = case
    metrics = Judge.of(build({}), device="cpu").judged(recovery, prepared).metrics
    clip, moving = prepared.clip, range(STILL, len(prepared.clip))
    assert metrics["moving_frames"] == len(moving)
    assert metrics["psnr_masked_moving"] == pytest.approx(20 * np.log10(255), abs=0.2)
    expected = [psnr_masked(clip.frames[0], clip.frames[k], clip.labels[k] > 0) for k in moving]
    assert metrics["psnr_masked_moving_frozen_frame"] == pytest.approx(np.mean(expected))
    assert metrics["psnr_masked_moving_frozen_frame"] < 40


def test_standing_still_is_compared_where_the_object_moves(case: tuple[Prepared, Recovery]) -> None:
    """While it rests, frame 0 is what the video shows, and no rendering comes as near: over all frames it would seem the better answer."""
    prepared, recovery = case
    clip, rendered = prepared.clip, recovery.frames
    own, frozen = (np.mean([psnr_masked(shown[k], clip.frames[k], clip.labels[k] > 0) for k in range(1, len(clip))]) for shown in (rendered, clip.frames[[0] * len(clip)]))
    near = replace(recovery, identified=np.zeros(len(recovery.identified), bool), metrics=recovery.metrics | {"track_rms_m": 1.0})
    assert own < frozen
    assert not worse_than_still(near, prepared)
    far = np.where(rendered < 128, rendered + 40, rendered - 40).astype(np.uint8)
    assert worse_than_still(replace(near, frames=far), prepared)


def test_pixels_that_an_arm_hides_do_not_count(case: tuple[Prepared, Recovery]) -> None:
    prepared, recovery = case
    frames, labels = recovery.frames.copy(), prepared.clip.labels.copy()
    labels[:, :24], frames[:, :24] = np.where(labels[:, :24] > 0, 255, 0), 0
    own = replace(prepared, clip=prepared.clip.with_labels(labels))
    metrics = Judge.of(build({}), device="cpu").judged(replace(recovery, frames=frames), own).metrics
    assert metrics["psnr_masked_moving"] == pytest.approx(20 * np.log10(255), abs=0.2)


def test_a_missing_lpips_is_stated_in_the_notes(case: tuple[Prepared, Recovery]) -> None:
    judged = Judge.of(build({}), device="cpu").judged(case[1], case[0])
    assert "lpips_masked" not in judged.metrics
    assert any("experiment.lpips_weights" in note for note in judged.notes)


def test_lpips_stands_beside_the_frozen_first_frames(case: tuple[Prepared, Recovery], tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = alexnet()
    torch.save({f"features.{k}": v for k, v in network.state_dict().items()}, tmp_path / "backbone.pth")
    heads = [torch.ones(1, network[tap - 1].out_channels, 1, 1) for tap in TAPS["alex"]]
    torch.save({f"lin{k}.model.1.weight": head for k, head in enumerate(heads)}, tmp_path / "heads.pth")
    settings = build({"experiment.lpips_weights": str(tmp_path)})
    metrics = Judge.of(settings, device="cpu").judged(case[1], case[0]).metrics
    assert 0 < metrics["lpips_masked"] < metrics["lpips_masked_frozen_frame"]


def test_a_folder_without_weights_is_refused_before_the_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"experiment\.lpips_weights .* has no backbone\.pth"):
        Judge.of(build({"experiment.lpips_weights": str(tmp_path)}), device="cpu")
