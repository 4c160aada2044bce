"""A camera in a hand, and an exposure that drifts, end up neither in the stiffness nor in the force."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.exposure import with_steady_exposure
from diffphys_ros.bags.read import read_clip
from diffphys_ros.inverse import prepare
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.segment import label_clip
from diffphys_ros.start import start_values
from diffphys_ros.tracks import follow
from diffphys_ros.types import Clip, StartValues

from .test_solve import drive

HAND_PX, ROLL, DRIFT = 1.0, 1e-3, 0.05  # standard deviation of the shifts [px], of the rolls [rad]; amplitude of the log gain
MOST_E, MOST_FORCE = 0.01, 0.03  # by which log10 E, and the forces over their rms, may differ from those of a tripod


@dataclass(frozen=True)
class Filmed:
    """The bundled bar before a patterned wall."""

    settings: config.Settings
    tripod: Clip
    hand: Clip
    by_tripod: Prepared
    by_hand: Prepared


@pytest.fixture(scope="module")
def filmed(half_sample: Path) -> Filmed:
    settings = config.layered([half_sample / "given.yaml"], {"scene.density_kg_m3": [600.0, 600.0], "scene.mass_kg": None, "depth.source": "inflate"})
    clip = replace(read_clip(half_sample / "clip.mcap", settings), depth=None)
    labels = label_clip(clip, settings)
    pattern = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 1, clip.frames.shape[1:3]).astype(np.float32), (0, 0), 1.5)
    wall = np.clip(120 + 40 * pattern / pattern.std(), 20, 200)[..., None]
    tripod = replace(clip, frames=np.where(labels[..., None] == 0, wall, clip.frames).astype(np.uint8))
    hand = held(tripod)
    return Filmed(settings, tripod, hand, *(drive(prepare(c, settings))[-1] for c in (tripod, hand)))


def held(clip: Clip) -> Clip:
    """As a phone in a hand films it, and brings its exposure to nought only in part."""
    rng, size = np.random.default_rng(1), clip.frames.shape[2:0:-1]
    shift, roll = HAND_PX * rng.normal(size=(len(clip), 2)), ROLL * rng.normal(size=len(clip))
    centre, frames = (np.array(size) - 1) / 2, clip.frames.copy()
    for k in range(1, len(clip)):
        turn = np.array([[1, -roll[k]], [roll[k], 1]])
        matrix = np.c_[turn, shift[k] + centre - turn @ centre]
        moved = cv2.warpAffine(clip.frames[k].astype(np.float32), matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        frames[k] = np.clip(np.rint(moved * np.exp(DRIFT * np.sin(k / 5))), 0, 255)
    return replace(clip, frames=with_steady_exposure(frames)[0])  # as reading does


def off(found: StartValues, true: StartValues) -> tuple[float, float]:
    """How far log10 E and the forces are off, the latter over their rms."""
    force = np.sqrt(((found.force - true.force) ** 2).mean() / (true.force**2).mean())
    return float(np.abs(np.log10(found.young / true.young)).max()), float(force)


def test_a_hand_and_a_drifting_exposure_change_neither_stiffness_nor_force(filmed: Filmed) -> None:
    young, force = off(filmed.by_hand.start, filmed.by_tripod.start)
    assert young < MOST_E
    assert force < MOST_FORCE
    assert not filmed.by_hand.doubts


def test_without_compensation_they_would(filmed: Filmed) -> None:
    p = filmed.by_tripod
    tracks = follow(filmed.hand.with_labels(p.clip.labels), p.depth0, filmed.settings)
    young, force = off(start_values(p.body, tracks, p.clip.period_s, filmed.settings, camera=p.clip.camera)[0], p.start)
    assert young > 2 * MOST_E or force > 2 * MOST_FORCE


def test_the_frames_are_those_of_the_tripod_and_the_tracks_know_that_they_are_less_sure(filmed: Filmed) -> None:
    by_hand, by_tripod = filmed.by_hand, filmed.by_tripod
    inner = np.s_[1:, 12:-12, 12:-12]
    before, after = (np.abs(c.frames[inner].astype(float) - filmed.tripod.frames[inner]).mean() for c in (filmed.hand, by_hand.clip))
    assert after < 0.3 * before
    assert any("the camera moves by up to" in note and "laid over frame 0" in note for note in by_hand.clip.notes)
    assert by_hand.tracks.noise_m > by_tripod.tracks.noise_m
    assert not any("camera" in note for note in by_tripod.clip.notes)
