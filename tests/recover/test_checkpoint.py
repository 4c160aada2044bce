"""Claims about the file of a checkpoint."""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import torch

from diffphys_ros import config, store
from diffphys_ros.errors import InputError
from diffphys_ros.recover.checkpoint import Checkpoint, Stored, Training
from diffphys_ros.recover.limited_memory import Descent
from diffphys_ros.recover.minimise import Iterate, lost
from diffphys_ros.types import Clip

SIZE, PARTS = 4, 2
SETTINGS = config.Settings()


def state() -> Stored:
    rng = np.random.default_rng(0)
    iterate = Iterate(rng.normal(size=SIZE), 0.5, rng.normal(size=SIZE), np.eye(SIZE), 3, 1, (0.9, 0.5))
    at, slope, step, change = (torch.from_numpy(rng.normal(size=6)) for _ in range(4))
    return Stored(iterate, np.array([1e5, 2e4]), Training(True, Descent(at, 0.4, slope, (step,), (change,)), (0.5, 0.4)))


@pytest.fixture
def path(tmp_path: Path, made_clip: Clip) -> Path:
    return written(tmp_path / "c.npz", made_clip, state())


def written(path: Path, clip: Clip, value: Stored) -> Path:
    checkpoint = Checkpoint(path, every_s=0.0)
    checkpoint.bind(clip, SETTINGS)
    checkpoint.offer(value)
    return path


def resumed(path: Path, clip: Clip) -> Stored:
    checkpoint = Checkpoint(path, resume=True)
    checkpoint.bind(clip, SETTINGS)
    found = checkpoint.load(SIZE, PARTS)
    assert found is not None
    return found


def test_a_state_comes_back_as_it_was(path: Path, made_clip: Clip) -> None:
    back, was = resumed(path, made_clip), state()
    for name, value in vars(was.state).items():
        np.testing.assert_array_equal(getattr(back.state, name), value)
    assert back.training is not None
    assert was.training is not None
    for name, value in was.training.arrays().items():
        np.testing.assert_array_equal(back.training.arrays()[name], value)


def test_a_search_that_could_not_begin_comes_back_too(tmp_path: Path, made_clip: Clip) -> None:
    value = dataclasses.replace(state(), state=lost(np.zeros(SIZE)), training=None)
    assert resumed(written(tmp_path / "c.npz", made_clip, value), made_clip).state.finished


@pytest.mark.parametrize(
    "changes",
    [
        {"z": state().state.z + 3},
        {"z": np.full(SIZE, np.nan)},
        {"captured": 1e6 * state().captured},
        {"captured": np.zeros(0)},
        {"inverse": None},
        {"iteration": np.array("many")},
        {"field_steps": np.zeros((1, 5))},
        {"extra": np.zeros(1)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_checkpoint_with_other_numbers_is_refused(path: Path, changes: dict) -> None:
    arrays = store.read_arrays(path, "checkpoint") | changes
    store.write_arrays(path, {name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(InputError, match=f"checkpoint {path}: damaged .its arrays are not those that were written.; leave out --resume"):
        Checkpoint(path, resume=True)


def test_a_checkpoint_whose_every_byte_may_be_spoiled_is_taken_whole_or_refused(path: Path, made_clip: Clip) -> None:
    whole, was = path.read_bytes(), state().state.z
    for place in range(0, len(whole), 7):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        with suppress(InputError):
            np.testing.assert_array_equal(resumed(path, made_clip).state.z, was)


def test_a_checkpoint_of_an_older_version_is_refused(path: Path) -> None:
    arrays = store.read_arrays(path, "checkpoint")
    store.write_arrays(path, {name: value for name, value in arrays.items() if name not in ("version", "digest")})
    with pytest.raises(InputError, match=r"written by version 'none' of diffphys_ros, must be .*; leave out --resume"):
        Checkpoint(path, resume=True)


def test_no_checkpoint_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is none to resume from; leave out --resume"):
        Checkpoint(tmp_path / "none.npz", resume=True)


@pytest.mark.parametrize("change", ["clip", "settings"])
def test_the_checkpoint_of_another_job_is_refused_as_soon_as_the_clip_is_read(path: Path, made_clip: Clip, change: str) -> None:
    clip = dataclasses.replace(made_clip, frames=made_clip.frames // 2) if change == "clip" else made_clip
    settings = config.build({"fit.image_weight": 0.123}) if change == "settings" else SETTINGS
    with pytest.raises(InputError, match="belongs to another clip or other settings"):
        Checkpoint(path, resume=True).bind(clip, settings)
