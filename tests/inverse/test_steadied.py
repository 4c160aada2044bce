"""A hand that holds the camera before a scene without contrast: its motion is read from the outline of what swings, and does not end in the modulus."""

from __future__ import annotations

import re
import sys
from functools import cache

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.inverse import outlined, prepare
from diffphys_ros.inverse import steadied as steady
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.outline import Sway
from diffphys_ros.tracks import CameraMotion
from tests.plain_strips import Strip

from .test_solve import drive

DENSITY = 1070.0
STRIP = Strip(frames=100, noise=1.0, size=(156, 110))
TIMES_S = np.arange(STRIP.frames)[:, None] / STRIP.fps


def swaying(px: tuple[float, float], hz: tuple[float, float]) -> np.ndarray:
    """Shifts sideways and up (T, 2)."""
    return np.array(px) * np.sin(2 * np.pi * np.array(hz) * TIMES_S)


WAYS = {
    "tripod": swaying((0.0, 0.0), (1.0, 1.0)),
    "by hand": swaying((2.0, 1.2), (0.9, 1.3)),
    "as fast as the strip": swaying((0.6, 0.0), (0.9 * STRIP.hz, 1.0)) + swaying((1.0, 0.0), (0.3, 1.0)),
}


@cache
def seen(way: str) -> Prepared:
    told = {"scene.density_kg_m3": [DENSITY], "scene.size_m": STRIP.length_px / STRIP.px_per_m, "scene.poisson_ratio": [0.3]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[prepare.__module__], "swing_of", lambda *_: None)  # what the answer predicts is asked elsewhere
        return drive(prepare(STRIP.clip(WAYS[way]), config.layered([], told)))[-1]


def log_young(way: str) -> float:
    return float(np.log10(seen(way).start.young[0]))


def filmed(way: str) -> np.ndarray:
    """The shifts of the frames that were fitted."""
    first = seen(way).hanging.rest_frame
    return WAYS[way][first : first + len(seen(way).clip)]


def said(way: str) -> list[str]:
    return [note for note in seen(way).clip.notes if "the camera" in note]


def test_a_hand_before_a_plain_scene_does_not_change_the_modulus_of_a_strip_and_its_size_is_said() -> None:
    assert abs(log_young("by hand") - log_young("tripod")) < 0.005
    assert seen("by hand").start.identified.all()
    far = np.linalg.norm(filmed("by hand") - filmed("by hand")[0], axis=1).max()
    (note,) = said("by hand")
    assert float(re.search(r"what holds the object, moves by up to ([\d.]+) px", note)[1]) == pytest.approx(far, abs=0.2)


def test_the_frame_nearest_to_rest_is_chosen_without_the_hand() -> None:
    first, aside = seen("by hand").hanging.rest_frame, np.abs(STRIP.sway())
    assert aside[first] == aside[first - 3 : first + 4].min()


def test_a_camera_on_a_tripod_before_a_plain_scene_is_not_said_to_move() -> None:
    still = seen("tripod")
    first = still.hanging.rest_frame
    assert not said("tripod")
    assert (still.clip.frames == STRIP.clip().frames[first : first + len(still.clip)]).all()


def test_a_hand_that_moves_as_fast_as_the_strip_swings_makes_its_modulus_less_sure() -> None:
    """What of the hand goes with the swing nothing tells; the clamp's place may be off by it."""
    off, sd = (log_young("as fast as the strip") - log_young("tripod")), seen("as fast as the strip").start.log10_young_sd[0]
    assert sd > 1.5 * seen("tripod").start.log10_young_sd[0]
    assert abs(off) < 2 * sd
    assert said("as fast as the strip")


def shifted(px: np.ndarray, along_sd_px: float = 0.0) -> Sway:
    return Sway(px, 2.0, 0.05, np.array([1.0, 0.0]), 0, along_sd_px, 0.0)


def test_an_outline_that_says_another_motion_than_the_background_is_not_believed() -> None:
    px = 2 * np.column_stack([np.arange(8.0), np.zeros(8)])
    background = CameraMotion(np.arange(1, 8), px[1:])
    assert steady._agree(shifted(px), background)
    assert not steady._agree(shifted(-px), background)


def test_an_end_that_is_not_seen_leaves_scale_and_modulus_open_by_what_the_hand_may_have_moved_it() -> None:
    """E of a beam goes with 2.5 powers of its scale: of 150 px, 2 px are 1.3 % and .0144 of log10 E."""
    known, open_ = (outlined._doubts(1.0, 0.01, 150.0, shifted(np.zeros((8, 2)), sd), depth_told=True) for sd in (0.0, 2.0))
    assert np.sqrt(open_[0] ** 2 - known[0] ** 2) == pytest.approx(2 / 150)
    assert known[1] == pytest.approx(0.01)
    assert np.sqrt(open_[1] ** 2 - known[1] ** 2) == pytest.approx(2.5 * np.log10(152 / 150))
