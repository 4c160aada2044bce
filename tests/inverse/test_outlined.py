"""A plain strip that hangs from a clamp beyond the picture: its modulus, its clamp and its scale from its outline alone."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from diffphys_ros import config, inverse
from diffphys_ros.body.leaving import FOUND
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import prepare
from diffphys_ros.inverse.outlined import DEPTH_SD, FURTHEST, INDEPENDENT, _best, _contradicted_px, _Trials, outlined
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.progress import finished
from diffphys_ros.start.hang import Hung
from diffphys_ros.types import Clip
from tests.plain_strips import Strip, Tapered

from .test_solve import drive

STRIP = Strip(frames=100)
DENSITY = 1070.0


def prepared_of(clip: Clip, strip: Strip = STRIP) -> Prepared:
    """As the start of a fit, without what the answer predicts of the large swing (tests/inverse/test_swing.py)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules[prepare.__module__], "swing_of", lambda *_: None)
        return drive(prepare(clip, told_of(strip)))[-1]


def told_of(strip: Strip) -> Settings:
    """What is told of a strip."""
    return config.layered([], {"scene.density_kg_m3": [DENSITY], "scene.size_m": strip.length_px / strip.px_per_m, "scene.poisson_ratio": [0.3]})


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    return prepared_of(STRIP.clip())


def test_the_outline_is_chosen_where_there_is_no_texture(prepared: Prepared) -> None:
    assert prepared.hanging is not None
    assert prepared.tracks.normals is not None
    assert any("by the object's outline" in note for note in prepared.clip.notes)


def test_the_modulus_of_the_beam_is_found_and_its_sd_covers_it(prepared: Prepared) -> None:
    start = prepared.start
    error = float(np.log10(start.young[0] / DENSITY / STRIP.specific))
    assert start.identified.all()
    assert abs(error) < 0.015
    assert 0.015 < start.log10_young_sd[0] < 0.04
    assert abs(error) < 2 * start.log10_young_sd[0]
    assert start.observed_hz[0] == pytest.approx(STRIP.hz, rel=2e-3)


def test_the_clamp_beyond_the_picture_is_found_with_the_scale(prepared: Prepared) -> None:
    hanging = prepared.hanging
    assert hanging.behind_px == pytest.approx(STRIP.behind_px, abs=2.0)
    assert hanging.px_per_m == pytest.approx(STRIP.px_per_m, rel=0.015)
    assert hanging.length_told


def test_a_clamp_in_the_picture_has_a_share_in_the_stated_sd() -> None:
    """As much as E is off where the line lies one deviation too far out."""
    strip = Strip(frames=100, length_px=130.0, behind_px=-20.0, size=(160, 110))
    told = {"scene.density_kg_m3": [DENSITY], "scene.size_m": strip.length_px / strip.px_per_m, "scene.poisson_ratio": [0.3], "scene.thickness_m": 0.008, "tracks.evidence": "outline"}
    seen = finished(outlined(strip.clip(), config.layered([], told)))
    assert seen.hanging.behind_px == 0
    sd_px = seen.hanging.behind_px_sd
    assert sd_px == pytest.approx(FOUND * np.hypot(130, 16), rel=0.05)
    trials = _Trials(seen.clip, seen.settings)
    off = sd_px / 4 * np.log10(trials.hung(4.0).young / trials.hung(0.0).young)  # of elements cut anew, whose own error is that of half a pixel
    assert seen.hanging.log10_young_sd == pytest.approx(abs(off), rel=0.25)
    assert seen.hanging.log10_young_sd > 0.004


def test_a_strip_that_is_narrower_beyond_the_picture_has_its_modulus_and_is_less_sure() -> None:
    """Held as wide as it is at the picture's edge, it came out .14 too soft in log10 E at a stated .02."""
    strip = Tapered(frames=100, behind_px=30.0, width_px=14.0)
    seen = finished(outlined(strip.clip(), told_of(strip)))
    young = _Trials(seen.clip, seen.settings).hung(seen.hanging.behind_px).young
    error = abs(np.log10(young / DENSITY / strip.specific))
    assert error < 0.1
    assert error < 1.5 * seen.hanging.log10_young_sd
    assert abs(seen.hanging.behind_px - strip.behind_px) < 2 * seen.hanging.behind_px_sd


def test_parallel_sides_are_not_tried_twice() -> None:
    seen = finished(outlined(STRIP.clip(), told_of(STRIP)))
    assert not _Trials(seen.clip, seen.settings).lean()
    assert seen.hanging.log10_young_sd < 2 * DEPTH_SD


@pytest.mark.parametrize("share", [0.12, 0.62])
def test_the_clamp_is_looked_for_as_far_out_as_it_lies(share: float) -> None:
    places, found = searched(share)
    best, sd, _ = _best(places, found)
    assert best == pytest.approx(100 * share, abs=0.5)
    assert sd == pytest.approx(np.sqrt(0.01 / INDEPENDENT) * 100)


def test_a_clamp_further_out_than_is_looked_for_is_not_known() -> None:
    places, found = searched(1.5)
    assert max(places) == pytest.approx(100 * FURTHEST)
    assert _best(places, found)[1] == max(places)


def test_a_line_in_the_picture_that_the_swing_contradicts_is_known_no_better_than_by_how_far() -> None:
    """Drawn along the bar above a film that was made wider, it made E .11 too small in log10 at a stated .02."""
    for share, far_px in {0.3: 30.0, 0.04: 0.0, 0.0: 0.0}.items():
        places, found = searched(share, beyond=False)
        assert _contradicted_px(places, found, 1.0) == pytest.approx(far_px, abs=0.5)


def searched(share: float, *, beyond: bool = True) -> tuple[list[float], list[Hung]]:
    """Places that are tried for an object that shows 100 px and is held so far behind its line, over that, and how it hangs from them."""
    trials = SimpleNamespace(line=np.zeros((2, 2)), end_px=100.0, _beyond=lambda: beyond)
    places, found = [], []
    for place in _Trials.places(trials, found):
        places.append(place)
        found.append(Hung(1e5, 0.01 + (place / 100 - share) ** 2, 50))
    return places, found


def test_no_force_acts_on_a_strip_that_swings_freely(prepared: Prepared) -> None:
    weight = DENSITY * 9.81
    assert np.linalg.norm(prepared.start.force, axis=1).max() < 0.05 * weight


def test_the_decay_of_the_swing_is_the_damping(prepared: Prepared) -> None:
    damping, omega = prepared.start.damping, 2 * np.pi * STRIP.hz
    ratio = (damping.mass_per_s + damping.stiffness_s * omega**2) / (2 * omega)
    assert ratio == pytest.approx(STRIP.damping, rel=0.1)


def test_gaussians_of_frame_0_are_of_no_use_to_a_body_that_is_that_of_another_frame(prepared: Prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    assert prepared.hanging.rest_frame > 0
    used = []

    def solved(prepared: Prepared, splats: str, *_: object, **__: object) -> Iterator[SimpleNamespace]:
        used.append(splats)
        return SimpleNamespace(frames=None, metrics={})
        yield

    def returning(value: object) -> Callable[..., Iterator[None]]:
        def steps(*_: object, **__: object) -> Iterator[None]:
            return value
            yield

        return steps

    for name, stub in {"fit_gaussians": returning("own"), "solve": solved, "refine_gaussians": returning((None, None))}.items():
        monkeypatch.setattr(inverse, name, stub)
    judge = SimpleNamespace(judged=lambda recovery, prepared: None)
    for body in (prepared, replace(prepared, hanging=None)):
        finished(inverse._solved(body, config.build({"fit.iterations": 1}), judge, "those of frame 0", None, None))
    assert used == ["own", "those of frame 0"]


def test_an_object_whose_free_end_is_outside_the_picture_is_refused() -> None:
    """As long as it is told to be, it would be taken to end where the picture does: E came out .2 off in log10."""
    cut = Strip(frames=100, size=(125, 110)).clip()
    with pytest.raises(InputError, match=r"strip: the object leaves the picture at its lower edge too, away from its clamp, .*; film it whole"):
        finished(outlined(cut, config.layered([], {})))


def held_in_a_hand(clip: Clip) -> Clip:
    """Before a dim patterned scene, by a hand that shakes by 1 px."""
    rng, size = np.random.default_rng(0), clip.frames.shape[2:0:-1]
    pattern = cv2.GaussianBlur(rng.normal(0, 1, size[::-1]).astype(np.float32), (0, 0), 2)
    grey = clip.frames[..., 0].astype(np.float32)
    scene, strip = grey.min(), grey.max()
    grey += (strip - grey) / (strip - scene) * np.clip(8 * pattern / pattern.std(), -scene, 20)
    shift = rng.normal(size=(len(clip), 2)) * (np.arange(len(clip)) > 0)[:, None]
    moved = [cv2.warpAffine(g, np.c_[np.eye(2), s], size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for g, s in zip(grey, shift, strict=True)]
    noisy = np.stack(moved) + rng.normal(0, 1, grey.shape)
    return replace(clip, frames=np.repeat(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)[..., None], 3, 3))


def test_a_hand_that_holds_the_camera_is_taken_off_before_the_outline_is_read() -> None:
    """Without that no free swing is seen at all."""
    strip = Strip(frames=100, size=(150, 240), middle_px=120.0)
    held = prepared_of(held_in_a_hand(strip.clip()), strip)
    assert abs(np.log10(held.start.young[0] / DENSITY / strip.specific)) < 0.025
    assert any("the camera moves by up to" in note and "laid over frame 0" in note for note in held.clip.notes)
    assert not held.doubts
