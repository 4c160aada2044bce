"""Parts that only stiffness tells apart become the parts of the clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import diffphys_ros.start
from diffphys_ros.inverse import prepare
from diffphys_ros.progress import finished
from diffphys_ros.start.borders import Parted
from diffphys_ros.types import Clip
from tests.boxes import bar, bar_settings, box_clip, camera_at, turned


@pytest.fixture
def swinging() -> Clip:
    """A bar of one colour."""
    return box_clip(bar(), [turned(0.06 * np.sin(0.7 * k)) for k in range(12)], camera_at((0.12, -0.6, 0.0), (0.12, 0, 0)))


def said_to_be_free(monkeypatch: pytest.MonkeyPatch, free: bool) -> None:
    """Start values say that there is a free tail, or none."""
    first = diffphys_ros.start.start_values

    def start_values(*told: object, **more: object):
        start, modal = first(*told, **more)
        return replace(start, has_free_tail=free), modal

    monkeypatch.setattr(diffphys_ros.start, "start_values", start_values)


@pytest.fixture
def seen_parts(monkeypatch: pytest.MonkeyPatch, swinging: Clip):
    """How many parts a swinging bar is prepared with, whose free motion is said to ask for a border in its middle."""
    said_to_be_free(monkeypatch, True)

    def halved(body, tracks, period_s, settings, start, modal, *, camera, draws):
        assert draws
        part = np.where(body.front.points[:, 0] > 0.1, 2, 1)
        return Parted(replace(body.with_parts(part, np.full(2, 500.0), np.full(2, 0.3)), sources=body.sources | {"parts": "by stiffness"}), replace(start, density=np.full(2, 500.0), poisson=np.full(2, 0.3)), modal)

    monkeypatch.setattr(diffphys_ros.start, "parted_by_stiffness", halved)
    return lambda **told: finished(prepare(swinging, bar_settings(**told))).body.parts


@pytest.mark.slow
def test_a_border_that_the_free_motion_asks_for_parts_the_body(seen_parts):
    assert seen_parts() == 2


@pytest.mark.slow
def test_none_is_asked_for_where_one_part_is_wanted(seen_parts):
    assert seen_parts(segment__max_parts=1) == 1


@pytest.mark.slow
def test_what_follows_the_last_force_of_a_joint_fit_is_asked_for_the_stiffness(monkeypatch: pytest.MonkeyPatch, swinging: Clip) -> None:
    said_to_be_free(monkeypatch, False)

    def freed(body, tracks, period_s, settings, start, modal, *, camera):
        assert start.reasons == ("jointly",)
        return replace(start, reasons=("freed",), has_free_tail=True), modal

    monkeypatch.setattr(diffphys_ros.start, "joint_values", lambda *told, **more: replace(told[4], reasons=("jointly",)))
    monkeypatch.setattr(diffphys_ros.start, "freed_values", freed)
    asked = []
    monkeypatch.setattr(diffphys_ros.start, "parted_by_stiffness", lambda *told, **more: asked.append(more["draws"]))
    assert finished(prepare(swinging, bar_settings())).start.reasons[0].startswith("freed")
    assert asked == [False]
