"""The one tree of settings."""

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.errors import InputError


def test_settings_survive_flattening():
    settings = config.build({"scene.mass_kg": 0.5, "experiment.seed": 3, "scene.gravity_m_s2": [0, 0, -9.81]})
    assert config.build(config.flat(settings)) == settings


def test_every_default_passes_its_own_check():
    assert config.build({name: leaf.default for name, leaf in config.leaves().items()}) == config.Settings()


def test_every_setting_has_a_doc_and_numbers_with_dimension_name_their_unit():
    for leaf in config.leaves().values():
        assert leaf.doc, leaf.name
        for suffix, unit in (("_m", "m"), ("_kg", "kg"), ("_s", "s"), ("_px", "px"), ("_deg", "deg"), ("_m_s2", "m/s^2")):
            if leaf.name.endswith(suffix) and not leaf.name.endswith(f"_m{suffix}"):
                assert leaf.unit == unit or suffix in ("_m", "_s"), leaf.name


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("scene.mas_kg", 1, "did you mean 'scene.mass_kg'"),
        ("scene.mass_kg", -1, "must be in 1e-06 .. 100000 kg"),
        ("scene.mass_kg", float("nan"), "must be finite"),
        ("scene.mass_kg", "heavy", "must be a number in kg"),
        ("scene.at_rest", 1, "must be true or false"),
        ("scene.mass_kg", 10**400, "must be finite, in 1e-06 .. 100000 kg"),
        ("scene.mass_kg", "x" * 5000, "must be a number in kg, written like 2, 0.8 or 1e-3"),
        ("scene.mass_kg", [[1.0] * 10**6], "must be a number"),
        ("scene.mass_kg", {}, "must be a number"),
        ("scene.thickness_axis", np.zeros(3), "has 1 numbers, needs 3"),
        ("scene.density_kg_m3", np.zeros(0), "must be a number"),
        ("scene.clamp_box_m", [1, 2], "has 2 numbers, needs 6; give box around the clamped face: xmin ymin zmin"),
        ("scene.density_kg_m3", [1.0] * 300, "has 300 values, must have 1 to 254"),
        ("scene.first_mask", "a\0b", "must be text without control characters"),
        ("scene.first_mask", "\ud800", "must be text without control characters"),
        ("topics.image", "/" * 5000, "must be text of at most 512 characters"),
        ("prior.model", 3, "must be text; put it between quotes"),
        ("fit.device", "gpu", "must be auto, cpu or cuda:0"),
        ("fit.device", "cuda:", "must be auto, cpu or cuda:0"),
        ("scene.thickness_axis", [0, 0.0, 0], "must have a direction; give a world axis"),
        ("scene.clamp_box_m", [1e308] * 6, "must be in -1e+06 .. 1e+06 m"),
        ("experiment.seed", 1.5, "must be a whole number"),
        ("experiment.force_frame", "magic", "must be one of rest, current, nodes"),
        ("experiment.seed", None, "must not be null"),
    ],
)
def test_a_bad_value_is_named_with_its_bound(name, value, words):
    with pytest.raises(InputError) as caught:
        config.build({name: value})
    assert words in str(caught.value)
    assert name in str(caught.value)
    assert len(str(caught.value)) < 300


def test_an_empty_word_leaves_an_optional_text_out():
    assert config.build({"prior.model": ""}) == config.Settings()


def test_a_fit_of_nothing_is_refused():
    weights = {"experiment.image_weight": 0, "experiment.track_weight": 0, "experiment.depth_weight": 0}
    with pytest.raises(InputError, match=r"experiment\.track_weight, experiment\.image_weight, experiment\.depth_weight are all 0"):
        config.build(weights)
    assert config.build(weights | {"experiment.track_weight": 0.1})
