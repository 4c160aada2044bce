"""make paper: rows, tables and page."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros.inverse.prepared import LEAST_FRAMES
from tools.paper import __main__ as command
from tools.paper import page, rows
from tools.paper.pictures import frozen, moving, scores, warped
from tools.paper.rows import Row
from tools.paper.tables import table
from tools.paper.variants import VARIANTS, Variant

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def video() -> np.ndarray:
    """A textured square that goes right by a pixel a frame, over an even ground."""
    texture = np.random.default_rng(0).integers(60, 250, (6, 6, 3)).repeat(5, 0).repeat(5, 1).astype(np.uint8)
    frames = np.full((6, 64, 80, 3), 40, np.uint8)
    for k, frame in enumerate(frames):
        frame[15:45, 20 + k : 50 + k] = texture
    return frames


def test_pixels_that_stay_as_they_are_do_not_count(video: np.ndarray):
    mask = moving(video)
    assert mask[30, 20:54].any()
    assert not mask[:10].any()
    assert not mask[:, 62:].any()


def test_a_flow_warp_is_nearer_to_a_moving_square_than_its_first_frame(video: np.ndarray):
    mask = moving(video)
    assert scores(warped(video), video, mask)[0] > scores(frozen(video), video, mask)[0] + 3


def test_a_row_takes_the_place_of_its_own_kind_alone(tmp_path: Path):
    path = tmp_path / "rows.json"
    rows.merged(path, [Row("hat", "paper", "cpu", False, psnr=20.0, ssim=0.5), Row("hat", "paper", "cuda:0", False, psnr=30.0, ssim=0.5)])
    rows.merged(path, [Row("hat", "paper", "cpu", False, psnr=25.0, ssim=0.5, young_log10_error=(0.1, None))])
    assert {(row.device, row.psnr) for row in rows.read(path)} == {("cpu", 25.0), ("cuda:0", 30.0)}


def test_printed_rows_say_so_and_a_run_that_failed_says_why():
    text = table(1, [Row("hat", "paper", "cpu", False, why="out of <memory>")])
    assert "out of &lt;memory&gt;" in text
    assert text.count("(printed)") == 4


def test_rows_stand_by_clip_in_the_order_of_the_table_and_a_picture_that_stands_still_says_so():
    found = [Row("hat", "material_only", "cpu", True, psnr=20.0, ssim=0.5, still=True), Row("alocasia", "paper", "cpu", False, psnr=20.0, ssim=0.5), Row("hat", "paper", "cpu", False, psnr=20.0, ssim=0.5)]
    text = table(2, found)
    assert text.index("alocasia") < text.index("<td>hat</td><td>paper</td>") < text.index("material_only (quick, stands still)")


def test_a_quick_run_keeps_what_its_row_is_about():
    by_name: dict[str, Variant] = {variant.name: variant for variant in VARIANTS}
    settings = by_name["grid_128"].settings(device="cpu", quick=True)
    assert settings["experiment.grid_nodes"] == "128"
    assert by_name["grid_128"].scored == 5
    assert settings["fit.device"] == "cpu"


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_no_row_asks_for_fewer_frames_than_can_be_fitted(variant: Variant):
    assert int(variant.settings(device="cpu", quick=True)["frames.fit"]) >= LEAST_FRAMES


def test_no_clock_ends_a_quick_run_of_the_published_schedule_before_it_has_a_force():
    assert all(("fit.time_budget_s" in variant.settings(device="cpu", quick=True)) != variant.published for variant in VARIANTS)


def test_the_page_needs_no_other_file(tmp_path: Path):
    png = tmp_path / "a.png"
    png.write_bytes(PNG)
    text = page.write(tmp_path / "paper.html", [Row("hat", "paper", "cpu", False, psnr=25.0, ssim=0.5)], [("Figure 1", "What it shows.", png)]).read_text()
    assert all(source.startswith("data:") for source in re.findall(r'(?:src|href)="([^"]*)', text))
    assert "25.00" in text
    assert "What it shows." in text


def test_frames_that_are_frame_0_again_do_not_count() -> None:
    """A picture that stands still would else be perfect in them."""
    rng = np.random.default_rng(0)
    still = np.repeat(rng.integers(0, 255, (1, 16, 16, 3), dtype=np.uint8), 4, 0)
    video = still.copy()
    video[3] = rng.integers(0, 255, (16, 16, 3), dtype=np.uint8)
    mask = np.ones((16, 16), bool)
    assert scores(frozen(video), video, mask)[0] < 12
    assert np.isnan(scores(frozen(still), still, mask)[0])


def test_a_quick_run_leaves_out_what_takes_minutes_on_two_cores_and_a_named_row_is_run() -> None:
    def asked(*words: str) -> list[Variant]:
        return command._chosen(command._options(words))

    names = [variant.name for variant in asked("--quick")]
    assert "grid_128" not in names
    assert {variant.table for variant in asked("--quick")} == {1, 2, 3, 4}
    assert [variant.name for variant in asked("--quick", "--only", "grid_128")] == ["grid_128"]
    assert asked() == list(VARIANTS)
