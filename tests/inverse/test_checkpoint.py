"""Claims about the file of a checkpoint."""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config, store
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.checkpoint import Checkpoint, Stored
from diffphys_ros.inverse.descent import Descent, Rules
from diffphys_ros.inverse.unknowns import Layout
from diffphys_ros.types import Clip

SETTINGS = config.Settings()


@pytest.fixture(scope="module")
def layout(prepared) -> Layout:
    return Layout.of(prepared.start, prepared.body, force_unit=1.0, initial_modes=0, motion_unit=np.ones((2, prepared.modal.modes)), held=())


@pytest.fixture(scope="module")
def state(layout: Layout) -> Stored:
    rng = np.random.default_rng(0)
    descent = Descent(rng.normal(size=6), 0.4, rng.normal(size=6), rng.normal(size=(2, 6)), rng.normal(size=(2, 6)), 3, 1)
    return Stored(1, rng.normal(size=layout.size), descent, np.array([1e5, 2e4]), {"fit": [0.9, 0.5], "fields": [0.5, 0.4]})


@pytest.fixture
def path(tmp_path: Path, made_clip: Clip, state: Stored) -> Path:
    return written(tmp_path / "c.npz", made_clip, state)


def written(path: Path, clip: Clip, value: Stored) -> Path:
    checkpoint = Checkpoint(path, every_s=0.0)
    checkpoint.bind(clip, SETTINGS)
    checkpoint.offer(value)
    return path


def resumed(path: Path, clip: Clip, layout: Layout) -> Stored:
    checkpoint = Checkpoint(path, resume=True)
    checkpoint.bind(clip, SETTINGS)
    found = checkpoint.load(layout, 3)
    assert found is not None
    return found


def test_a_state_comes_back_as_it_was(path: Path, made_clip: Clip, layout: Layout, state: Stored) -> None:
    back = resumed(path, made_clip, layout)
    assert (back.stage, back.losses) == (state.stage, state.losses)
    for name, value in [*vars(state.descent).items(), ("z", state.z), ("captured", state.captured)]:
        np.testing.assert_array_equal(getattr(back.descent if hasattr(back.descent, name) else back, name), value)


def test_a_fit_that_could_not_begin_comes_back_too(tmp_path: Path, made_clip: Clip, layout: Layout, state: Stored) -> None:
    value = dataclasses.replace(state, descent=dataclasses.replace(state.descent, value=np.inf), losses={"fit": [np.inf]})
    assert resumed(written(tmp_path / "c.npz", made_clip, value), made_clip, layout).descent.done(Rules())


def test_a_state_of_other_unknowns_is_refused(tmp_path: Path, made_clip: Clip, layout: Layout, state: Stored) -> None:
    for changes in ({"z": state.z[:-1]}, {"stage": 3}):
        other = written(tmp_path / "c.npz", made_clip, dataclasses.replace(state, **changes))
        with pytest.raises(InputError, match="belongs to another clip or other settings"):
            resumed(other, made_clip, layout)


@pytest.mark.parametrize(
    "changes", [{"z": np.zeros((2, 3))}, {"captured": np.zeros(2)}, {"captured": np.zeros(0)}, {"stage": -1}], ids=lambda changes: next(iter(changes))
)
def test_a_state_that_no_fit_has_is_refused_though_its_digest_is_right(tmp_path: Path, made_clip: Clip, state: Stored, changes: dict) -> None:
    path = written(tmp_path / "c.npz", made_clip, dataclasses.replace(state, **changes))
    with pytest.raises(InputError, match="damaged"):
        Checkpoint(path, resume=True)


@pytest.mark.parametrize("name", ["array_000", "array_001", "outline", "key", "extra"])
def test_a_checkpoint_with_other_arrays_is_refused(path: Path, name: str) -> None:
    arrays = store.read_arrays(path, "checkpoint")
    was = arrays.get(name, np.zeros(1))
    arrays[name] = np.array(str(was) + " ") if was.dtype.kind == "U" else was + 3
    store.write_arrays(path, arrays)
    with pytest.raises(InputError, match=f"checkpoint {path}: damaged .its arrays are not those that were written.; leave out --resume"):
        Checkpoint(path, resume=True)


def test_a_checkpoint_whose_every_byte_may_be_spoiled_is_taken_whole_or_refused(path: Path, made_clip: Clip, layout: Layout, state: Stored) -> None:
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        with suppress(InputError):
            np.testing.assert_array_equal(resumed(path, made_clip, layout).z, state.z)


def test_a_checkpoint_of_an_older_version_is_refused(path: Path) -> None:
    arrays = store.read_arrays(path, "checkpoint")
    store.write_arrays(path, {name: value for name, value in arrays.items() if name not in ("version", "digest")})
    with pytest.raises(InputError, match=r"written by version 'none' of diffphys_ros, must be .*; leave out --resume"):
        Checkpoint(path, resume=True)


def test_no_checkpoint_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is none to resume from; leave out --resume"):
        Checkpoint(tmp_path / "none.npz", resume=True)


@pytest.mark.parametrize("change", ["clip", "settings", "start"])
def test_the_checkpoint_of_another_job_is_refused_as_soon_as_the_clip_is_read(path: Path, made_clip: Clip, change: str) -> None:
    clip = dataclasses.replace(made_clip, frames=made_clip.frames // 2) if change == "clip" else made_clip
    settings = config.build({"experiment.image_weight": 0.123}) if change == "settings" else SETTINGS
    with pytest.raises(InputError, match="belongs to another clip or other settings"):
        Checkpoint(path, resume=True).bind(clip, settings, begun=1.3 if change == "start" else 1.0)
