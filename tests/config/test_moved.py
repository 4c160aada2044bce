"""Claims about settings of earlier versions: each is still one, or is refused with what it is called now, at every door."""

from __future__ import annotations

from pathlib import Path

import pytest

from diffphys_ros import config
from diffphys_ros.__main__ import main
from diffphys_ros.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
VERSION_0_1 = {
    "scene": "mass_kg density_kg_m3 poisson_ratio thickness_m size_m thickness_axis gravity_m_s2 clamp_box_m floor_z_m floor_friction first_mask at_rest",
    "camera": "fov_deg fps",
    "topics": "image depth camera_info mask",
    "segment": "method model box_px point_px max_parts",
    "depth": "source capture model",
    "capture": "every max_side_px lens same_camera matching positions max_gaussians",
    "tracks": "spacing_px window_px round_trip_px",
    "particles": "cells per_cell grid_nodes downsample_ratio",
    "prior": "source file materials base_url model api_key_env timeout_s attempts cache",
    "modes": "start_scale count",
    "splats": "max_count iterations refine_frames view_iterations",
    "fit": "time_budget_s iterations schedule law material_field force_field force_frame field_iterations force_smoothness max_substeps start_scale image_weight ssim_weight track_weight depth_weight image_every checkpoint_every_s device seed",
    "metrics": "lpips_backbone lpips_heads",
    "playback": "rate loop",
    "publish": "max_points max_markers",
}  # fmt: skip
NAMES = [f"{group}.{key}" for group, keys in VERSION_0_1.items() for key in keys.split()]
GONE = [name for name in NAMES if name not in config.leaves()]


def test_every_setting_of_version_0_1_is_one_or_has_an_answer() -> None:
    assert len(NAMES) == 80
    assert set(GONE) == {*config.RENAMED, *config.REMOVED}
    assert set(config.RENAMED.values()) <= set(config.leaves())


@pytest.mark.parametrize("name", GONE)
def test_an_old_name_in_a_file_or_a_flag_is_refused_with_what_says_it_now(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    group, key = name.split(".")
    path = tmp_path / "old.yaml"
    path.write_text(f"{group}: {{{key}: 1}}\n")
    with pytest.raises(InputError) as caught:
        config.layered([path])
    assert main(["recover", "clip.mcap", "--out", str(tmp_path / "out"), f"--{name}", "1"]) == 2
    for said in (str(caught.value), capsys.readouterr().err):
        assert f"{name} is " in said
        assert config.RENAMED.get(name, config.REMOVED.get(name)) in said
        assert len(said) < 300


def test_what_stands_in_place_of_a_removed_setting_exists(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit):
        main(["recover", "--help"])
    known = capsys.readouterr().out + " ".join(config.leaves())
    for words in config.REMOVED.values():
        named = [word.strip(".,:;`") for word in words.split() if word.startswith(("--", "prior.", "publish.", "experiment."))]
        assert named
        assert all(word in known for word in named), words


def test_the_changelog_says_where_each_went() -> None:
    rows = [line for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    for name in GONE:
        row = next(line for line in rows if line.startswith(f"| `{name}` "))
        assert config.RENAMED.get(name, "") in row
