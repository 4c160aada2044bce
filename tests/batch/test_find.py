"""Claims about what the words of a batch stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import config, store
from diffphys_ros.batch import run
from diffphys_ros.batch.find import find_recordings
from diffphys_ros.batch.key import run_key
from diffphys_ros.errors import InputError


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Recordings of every kind, and what must not be taken for one."""
    top = tmp_path / "all"
    for name in ("one/clip.mcap", "two/clip.mcap", "two/take.mp4", "bag/bag_0.db3", "bag/metadata.yaml", "done/recovery.mcap", "done/metadata.yaml", ".hidden/clip.mcap", "out/x/clip.mcap"):
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).write_bytes(b"")
    for name in ("one/truth.npz", "done/recovery.npz"):
        np.savez(top / name, a=1)
    store.save(top / "two" / "prepared.npz", {"prepared": 1})
    (top / "one" / "given.yaml").write_text("scene: {mass_kg: 1}\n")
    (top / "given.yaml").write_text("")
    return top


def names(found: list) -> list[str]:
    return sorted(recording.path.name for recording in found)


def test_a_folder_is_searched_for_recordings_and_results_are_passed_over(tree: Path) -> None:
    assert names(find_recordings([tree], out=tree / "out")) == ["bag", "clip.mcap", "clip.mcap", "prepared.npz", "take.mp4"]


def test_each_recording_comes_once_however_often_it_is_named(tree: Path) -> None:
    words = [tree / "one", tree / "one" / "clip.mcap", tree / "two" / ".." / "one"]
    assert names(find_recordings(words, out=tree / "out")) == ["clip.mcap"]


def test_equal_names_in_different_folders_get_different_folders_that_stay_the_same(tree: Path) -> None:
    together = {r.path: r.name for r in find_recordings([tree], out=tree / "out")}
    alone = find_recordings([tree / "two" / "clip.mcap"], out=tree / "out")[0]
    assert len(set(together.values())) == len(together)
    assert alone.name == together[alone.path]
    assert alone.name.startswith("two-")


def test_what_lies_beside_a_recording_is_its_own(tree: Path) -> None:
    found = {r.path.name + r.path.parent.name: r for r in find_recordings([tree], out=tree / "out")}
    assert found["clip.mcapone"].given == tree / "one" / "given.yaml"
    assert found["clip.mcapone"].truth == tree / "one" / "truth.npz"
    assert found["clip.mcaptwo"].given is None
    assert found["bagall"].given == tree / "given.yaml"


def test_a_folder_of_pictures_is_one_recording(tmp_path: Path) -> None:
    (tmp_path / "0.png").write_bytes(b"")
    assert [r.path for r in find_recordings([tmp_path], out=tmp_path / "out")] == [tmp_path]


def test_names_hold_nothing_that_a_shell_or_a_file_system_minds(tmp_path: Path) -> None:
    path = tmp_path / ("ä b;$(x)" + "y" * 200 + ".mcap")
    path.write_bytes(b"")
    name = find_recordings([path], out=tmp_path / "out")[0].name
    assert name.isascii()
    assert len(name) < 80
    assert not set(name) & set(" ;$()/")


@pytest.mark.parametrize("word", ["{tmp}/none.mcap", "{tmp}/empty", "{tmp}/a\0b", "{tmp}/" + "x" * 5000], ids=["missing", "empty", "NUL", "long"])
def test_a_path_that_holds_no_recording_is_refused(word: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError) as refused:
        find_recordings([word.format(tmp=tmp_path)], out=tmp_path / "out")
    assert len(str(refused.value)) < 400


def test_the_key_of_a_run_is_that_of_clip_settings_and_named_files(tmp_path: Path) -> None:
    clip, mask = tmp_path / "clip.mcap", tmp_path / "mask.png"
    clip.write_bytes(b"one")
    mask.write_bytes(b"mask")
    settings = config.build({"scene.first_mask": str(mask)})
    key = run_key(clip, settings)
    assert run_key(clip, settings) == key
    (tmp_path / "moved").mkdir()
    clip.rename(tmp_path / "moved" / "clip.mcap")
    assert run_key(tmp_path / "moved" / "clip.mcap", settings) == key
    assert run_key(tmp_path / "moved" / "clip.mcap", config.build({"scene.first_mask": str(mask), "scene.mass_kg": 2.0})) != key
    mask.write_bytes(b"msak")
    assert run_key(tmp_path / "moved" / "clip.mcap", settings) != key
    mask.write_bytes(b"mask")
    (tmp_path / "moved" / "clip.mcap").write_bytes(b"two")
    assert run_key(tmp_path / "moved" / "clip.mcap", settings) != key


@pytest.mark.parametrize(("told", "limit_s"), [({}, 2 * 3 * 450.0), ({"fit.time_budget_s": 120.0}, 2 * 3 * 120.0)])
def test_the_time_limit_on_a_gpu_leaves_a_clip_that_fields_carry_all_its_time(tree: Path, monkeypatch: pytest.MonkeyPatch, told: dict[str, float], limit_s: float) -> None:
    monkeypatch.setattr(run, "gpus", lambda: [80_000])
    request = run.Request(clips=(str(tree),), out=tree / "out", flags=told, workers=3)
    found = find_recordings([tree / "one", tree / "two"], out=tree / "out")
    batch = run._Batch(request, config.layered((), told), found, tree / "out")
    assert batch._job(found[0], tree / "out" / "a").timeout_s == limit_s
