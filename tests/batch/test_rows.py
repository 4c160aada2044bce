"""Claims about the rows and tables of accuracy."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from diffphys_ros.batch import Status
from diffphys_ros.batch.status import write_status
from diffphys_ros.errors import InputError
from tests.script import loaded

ROOT = Path(__file__).resolve().parent.parent.parent
DONE = Status(
    state="done", version="v", scored="t", device="A (R) GPU", versions="python 3", processor_s=44.4,
    figures={"young_log10_error": [-0.005, None], "net_force_cosine": 0.9996, "psnr_masked": 39.5, "psnr_masked_frozen_frame": 27.7},
)  # fmt: skip


@pytest.fixture(scope="module")
def clips() -> ModuleType:
    return loaded(ROOT / "benchmarks" / "clips.py")


@pytest.fixture
def batch(tmp_path: Path) -> Path:
    for name, status in (("beam-00000001", DONE), ("bar-00000001", DONE), ("bar-00000002", DONE), ("bad-00000001", replace(DONE, state="failed"))):
        write_status(tmp_path / "batch" / name, status)
    return tmp_path / "batch"


def test_rows_are_of_the_clips_that_were_scored_and_say_what_made_them(clips: ModuleType, batch: Path) -> None:
    rows = clips.rows_of(batch, "abc1234", "v")
    assert [row["name"] for row in rows] == ["bar-00000001", "bar-00000002", "beam"]
    assert {(row["device"], row["versions"], row["commit"]) for row in rows} == {("A (R) GPU", "python 3", "abc1234")}


def test_a_clip_of_other_sources_gives_no_row(clips: ModuleType, batch: Path) -> None:
    with pytest.raises(InputError, match="other sources than this checkout's"):
        clips.rows_of(batch, "abc1234", "w")


def test_a_new_row_takes_the_place_of_the_old_one_and_the_table_follows(clips: ModuleType, batch: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    clips.record(clips.rows_of(batch, "old", "v"), results)
    (path,) = clips.record(clips.rows_of(batch, "new", "v")[2:], results)
    assert path.name == "clips-a-r-gpu.json"
    assert [row["commit"] for row in json.loads(path.read_text())] == ["old", "old", "new"]
    text = clips.filled("before\n<!-- clips-a-r-gpu -->\nold\n<!-- end clips-a-r-gpu -->\nafter", results)
    assert "| beam | -0.005, - | 1.000 | - | - | 39.5 (27.7) dB | 44 s |" in text
    assert text.endswith("after")
    assert "commit new" in text
    assert clips.filled(text, results) == text


def test_rows_are_not_taken_from_a_checkout_that_differs_from_its_commit(clips: ModuleType, tmp_path: Path) -> None:
    def git(*words: str) -> None:
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], cwd=tmp_path, check=True, capture_output=True)

    git("init")
    git("commit", "--allow-empty", "-m", "first")
    assert not clips.this_commit(dirty=False, root=tmp_path).endswith("+")
    (tmp_path / "new.py").write_text("")
    with pytest.raises(InputError, match="1 files differ from commit"):
        clips.this_commit(dirty=False, root=tmp_path)
    assert clips.this_commit(dirty=True, root=tmp_path).endswith("+")


def test_the_tables_of_the_documents_are_those_of_the_stored_rows(clips: ModuleType) -> None:
    assert clips.main(["--check"]) == 0, "run: python benchmarks/clips.py --tables"
