"""The one tree of settings."""

import pytest

from diffphys_ros import config
from diffphys_ros.errors import InputError


def test_settings_survive_flattening():
    settings = config.build({"scene.mass_kg": 0.5, "fit.seed": 3, "scene.gravity_m_s2": [0, 0, -9.81]})
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
        ("scene.clamp_box_m", [1, 2], "has 2 numbers, needs 6"),
        ("fit.seed", 1.5, "must be a whole number"),
        ("fit.schedule", "magic", "must be one of auto, modes, joint"),
        ("fit.seed", None, "must not be null"),
    ],
)
def test_a_bad_value_is_named_with_its_bound(name, value, words):
    with pytest.raises(InputError) as caught:
        config.build({name: value})
    assert words in str(caught.value)
    assert name in str(caught.value)


def test_later_files_win_flags_win_over_files_and_paths_are_relative_to_their_file(tmp_path):
    (tmp_path / "a.yaml").write_text("scene: {mass_kg: 1.0, first_mask: mask.png}\nfit: {seed: 1}\n")
    (tmp_path / "b.yaml").write_text("fit: {seed: 2}\n")
    settings = config.layered([tmp_path / "a.yaml", tmp_path / "b.yaml"], {"scene.mass_kg": 2.0})
    assert (settings.fit.seed, settings.scene.mass_kg) == (2, 2.0)
    assert settings.scene.first_mask == str(tmp_path / "mask.png")


@pytest.mark.parametrize("text", ["scene: [", "- 1\n", "scene: 3\n", "scene: {mass_kg: -1}\n"])
def test_a_bad_file_is_one_sentence_that_names_it(tmp_path, text):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        config.layered([path])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        config.layered([tmp_path / "nowhere.yaml"])


def test_command_line_words_are_read_as_yaml():
    known = config.leaves()
    assert config.parse_text(known["scene.gravity_m_s2"], "[0, 0, -9.81]") == [0, 0, -9.81]
    assert config.parse_text(known["scene.at_rest"], "true") is True
    assert config.parse_text(known["topics.depth"], "none") == "none"
    assert config.parse_text(known["topics.depth"], "null") is None
