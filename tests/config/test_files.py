"""Claims about files and words of settings."""

from __future__ import annotations

import os

import pytest

from diffphys_ros import config
from diffphys_ros.config.files import LARGEST_FILE
from diffphys_ros.errors import InputError


def write(folder, text, name="given.yaml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    return path


def test_later_files_win_flags_win_over_files_and_paths_are_relative_to_their_file(tmp_path):
    write(tmp_path, "scene: {mass_kg: 1.0, first_mask: mask.png}\nexperiment: {seed: 1}\n", "a.yaml")
    write(tmp_path, "experiment: {seed: 2}\n", "b.yaml")
    settings = config.layered([tmp_path / "a.yaml", tmp_path / "b.yaml"], {"scene.mass_kg": 2.0})
    assert (settings.experiment.seed, settings.scene.mass_kg) == (2, 2.0)
    assert settings.scene.first_mask == str(tmp_path / "mask.png")


def test_a_tilde_is_the_home_folder_in_files_and_flags(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    path = write(tmp_path, "scene: {first_mask: ~/mask.png}\n")
    assert config.layered([path]).scene.first_mask == str(tmp_path / "home" / "mask.png")
    assert config.layered(flags={"prior.file": "~/wood.yaml"}).prior.file == str(tmp_path / "home" / "wood.yaml")
    assert config.layered(flags={"prior.model": "~/seer"}).prior.model == "~/seer"


def test_numbers_as_tables_and_messages_print_them_are_numbers(tmp_path):
    path = write(tmp_path, "scene: {mass_kg: 1e-06}\nexperiment: {max_splats: 1e+05}\n")
    assert (config.layered([path]).scene.mass_kg, config.layered([path]).experiment.max_splats) == (1e-6, 100_000)
    for leaf in config.leaves().values():
        if leaf.low is not None and leaf.high is not None and not leaf.choices:
            for text in leaf.range_text.split(" .. "):
                assert config.build({leaf.name: config.parse_text(leaf, ",".join([text] * (leaf.length or 1)))})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("scene: [", "not valid YAML"),
        ("- 1\n", "must hold groups"),
        ("scene: 3\n", "must be a group"),
        ("scene: {mass_kg: -1}\n", "must be in 1e-06"),
        ("scene: {mass_kg: 2.5}\nscene: {thickness_m: 0.1}\n", "'scene' stands twice"),
        ("scene: {mass_kg: 2.5}\nscene.mass_kg: 3\n", "'scene.mass_kg' stands twice"),
        ("scene: {mass_kg: 1:30}\n", "scene.mass_kg is '1:30', must be a number in kg, written like 2, 0.8 or 1e-3"),
        ("scene: {mass_kg: 010}\n", "scene.mass_kg is '010', must be a number"),
        ("scene: {mass_kg: 2020-01-02}\n", "scene.mass_kg is '2020-01-02', must be a number"),
        ("scene: {mass_kg: yes}\n", "scene.mass_kg is True, must be a number"),
        ("scene: {1: 2}\n", "unknown setting 'scene.1'"),
        ('scene: {first_mask: "a\\0b"}\n', "must be text without control characters"),
        ('topics: {image: "/a\\nb"}\n', "must be text without control characters"),
        (b"scene: {mass_kg: 1} # \xff\n", "not valid UTF-8"),
        ("#" * (LARGEST_FILE + 1), f"has more than {LARGEST_FILE} bytes"),
    ],
)
def test_a_bad_file_is_one_sentence_that_names_it(tmp_path, text, told):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        config.layered([path])
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert str(caught.value).isprintable()


def test_what_is_no_readable_regular_file_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "circle.yaml").symlink_to("circle.yaml")
    for path in (tmp_path / "nowhere.yaml", tmp_path, tmp_path / "pipe.yaml", "/dev/zero", tmp_path / "circle.yaml", tmp_path / ("x" * 5000), "a\0b", "\ud800"):
        with pytest.raises(InputError, match="; give "):
            config.layered([path])


def test_a_path_that_leads_in_a_circle_is_refused(tmp_path):
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(InputError, match="leads nowhere"):
        config.read_yaml(write(tmp_path, "scene: {first_mask: circle/mask.png}\n"))


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("scene.gravity_m_s2", "[0, 0, -9.81]", [0, 0, -9.81]),
        ("scene.gravity_m_s2", "0,0,-9.81", [0, 0, -9.81]),
        ("segment.point_px", "680, 800", [680.0, 800.0]),
        ("scene.density_kg_m3", "1e3", [1000.0]),
        ("scene.density_kg_m3", "null", None),
        ("scene.density_kg_m3", "[]", None),
        ("prior.materials", "polyurethane foam, wood", ["polyurethane foam", "wood"]),
        ("scene.at_rest", "true", True),
        ("scene.mass_kg", "1e-3", 1e-3),
        ("scene.mass_kg", "null", None),
        ("topics.depth", "none", "none"),
        ("topics.depth", "null", None),
        ("segment.model", "[", "["),
        ("fit.device", "cuda:0", "cuda:0"),
    ],
)
def test_command_line_words_stand_for_what_a_person_means(name, text, value):
    leaf = config.leaves()[name]
    group, key = name.split(".")
    assert getattr(getattr(config.build({name: config.parse_text(leaf, text)}), group), key) == value


@pytest.mark.parametrize("text", ["2020-13-45", "0x_", "!!int foo", "!!timestamp x", "[" * 3000, "1" + "0" * 400, "1e999", "&a 1", "{a: 1}", "\ud800", "nan", ".nan", ""])
def test_a_word_that_is_no_number_is_refused_for_a_number(text):
    leaf = config.leaves()["experiment.track_round_trip_px"]
    with pytest.raises(InputError, match=r"experiment\.track_round_trip_px") as caught:
        config.build({leaf.name: config.parse_text(leaf, text)}, "command line")
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("text", ["[" * 3000, "[1, 2", "&a 1, *a", "!!int 1", "{a: 1, a: 2}"])
def test_a_broken_list_is_refused(text):
    leaf = config.leaves()["scene.density_kg_m3"]
    with pytest.raises(InputError, match=r"command line: --scene\.density_kg_m3"):
        config.build({leaf.name: config.parse_text(leaf, text)}, "command line")
