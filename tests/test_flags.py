"""Claims about the flags of the command line."""

from __future__ import annotations

import os

import pytest

from diffphys_ros.__main__ import _parse, main
from diffphys_ros.config import flags_of
from diffphys_ros.errors import InputError


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--scene.mass_kg 2 --scene.mass_kg 3", "--scene.mass_kg is given twice; keep one"),
        ("--scene.mass_kg=2 --scene.mass_kg=2", "--scene.mass_kg is given twice; keep one"),
        ("--conf x.yaml", "--conf is no flag; did you mean --config?"),
        ("--scene.mas_kg 2", "did you mean --scene.mass_kg?"),
        ("--scene.mass_kg", "--scene.mass_kg has no value; give mass of the object, such as `--scene.mass_kg 1`"),
        ("--scene.mass_kg --experiment.seed 3", "--scene.mass_kg has no value"),
        ("stray", "'stray' is not a flag"),
        ("--", "-- is no flag"),
        ("--scene.mass_kg 1:30", "scene.mass_kg is '1:30', must be a number in kg, written like 2, 0.8 or 1e-3"),
        ("--scene.mass_kg 1" + "0" * 400, "scene.mass_kg is inf, must be finite"),
        ("--scene.clamp_box_m 1,2", "has 2 numbers, needs 6; give box around the clamped face"),
        ("--fit.device gpu", "fit.device is 'gpu', must be auto, cpu or cuda:0"),
        ("--experiment.track_weight 0 --experiment.image_weight 0 --experiment.depth_weight 0", "are all 0, so that nothing would be fitted"),
        ("--fit.seed 3", "--fit.seed is called experiment.seed since version 0.2; rename it"),
        ("--prior.file a.yaml --prior.materials wood", "prior.file and prior.materials are both given, must be one prior"),
        ("--" + "x" * 5000 + " 1", "is no flag"),
        ("--\ud800\n 1", "is no flag"),
    ],
)
def test_settings_that_mean_nothing_or_two_things_are_refused(words, told):
    with pytest.raises(InputError) as caught:
        flags_of(words.split(" "))
    assert told in str(caught.value)
    assert len(str(caught.value)) < 300
    assert str(caught.value).isprintable()


def test_settings_are_taken_with_a_blank_or_an_equals_sign_and_lists_without_brackets():
    assert flags_of(["--scene.mass_kg", "1e-3", "--segment.point_px=680,800", "--topics.image=/a=b", "--scene.floor_z_m", "-0.5"]) == {
        "scene.mass_kg": 1e-3,
        "segment.point_px": [680, 800],
        "topics.image": "/a=b",
        "scene.floor_z_m": -0.5,
    }


def test_settings_may_stand_before_the_clip():
    options = _parse(["recover", "--scene.mass_kg", "2", "clip.mcap", "--out", "there", "--experiment.seed=3", "--resume"])
    assert (options.clip, str(options.out), options.resume) == ("clip.mcap", "there", True)
    assert options.flags == {"scene.mass_kg": 2, "experiment.seed": 3}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("recover c --out a --out b", "--out is given twice; keep one"),
        ("simulate f --out a --device cpu --device cpu", "--device is given twice; keep one"),
        ("recover c --out a --conf b", "did you mean --config?"),
        ("recover c --out a --capture.every 2", "capture.every is not read here but by diffphys capture; give it there"),
        ("batch c --out a --playback.rate 2", "playback.rate is not read here but by fit_node; give it there"),
        ("recover clip.npz --out a --guess_scale 2", "clip.npz"),
        ("recover c.mcap --out a --start_scale 2", "--start_scale is for a prepared .npz, 'c.mcap' is none; leave it out"),
        ("recover c.mcap --out a --guess_scale 1e3", "--guess_scale is 1000, must be in 0.01 .. 100"),
        ("recover c.mcap --out a --guess_scale nan", "--guess_scale is nan, must be in 0.01 .. 100"),
        ("score f --tru t --truth t", "'--tru' is unknown here"),
        ("score f --truth t --scene.mass_kg 2", "'--scene.mass_kg' is unknown here"),
        ("simulate f --out a --young_scale " + "x" * 5000, "must be a number"),
        ("score f --truth " + "x" * 5000, "no such file or folder"),
        ("score f --truth a\0b", "holds control characters or broken Unicode"),
        ("recover \ud800 --out o", "holds control characters or broken Unicode"),
        ("recover c --out a\nb", "holds control characters or broken Unicode"),
    ],
)
def test_a_commands_own_flags_are_never_guessed_nor_lost(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words.split(" ")) == 2
    said = capsys.readouterr().err.strip()
    assert told in said
    assert len(said) < 600
    assert not os.listdir(tmp_path)


def test_files_of_settings_may_be_several():
    assert [str(path) for path in _parse(["ingest", "c", "--out", "o", "--config", "a", "--config", "b"]).config] == ["a", "b"]
