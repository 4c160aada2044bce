"""Claims about dataclasses on disk."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import store
from diffphys_ros.damping import Damping
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera, Clip, Grid


@dataclass(frozen=True)
class Shelf:
    width: float
    books: tuple[str, ...]
    table: np.ndarray
    inner: Shelf | None = None
    words: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Swing:
    period_s: float
    damping: Damping[float]
    bodies: int


@dataclass(frozen=True)
class Scene:
    grid: Grid
    camera: Camera
    name: str
    depth: np.ndarray | None = None


def test_nested_dataclasses_come_back_as_they_were(tmp_path: Path) -> None:
    inner = Shelf(np.float64(0.5), (), np.arange(3, dtype=np.uint8))
    store.save(tmp_path / "a.npz", Shelf(float("nan"), ("x", "y"), np.eye(2), inner, {"a": "b"}))
    back = store.load(tmp_path / "a.npz", (Shelf,))
    assert np.isnan(back.width)
    assert (back.books, back.words, back.inner.width, back.inner.inner) == (("x", "y"), {"a": "b"}, 0.5, None)
    assert back.inner.table.dtype == np.uint8
    np.testing.assert_array_equal(back.table, np.eye(2))


def test_damping_lies_beside_the_fields_of_what_is_damped(tmp_path: Path) -> None:
    swing = Swing(0.5, Damping(0.1, 1e-3), 2)
    path = store.save(tmp_path / "a.npz", swing)
    outline = json.loads(str(store.read_arrays(path, "swing")["outline"]))
    assert list(outline["fields"].items()) == [("period_s", 0.5), ("mass_damping", 0.1), ("stiffness_damping", 1e-3), ("bodies", 2)]
    assert store.load(path, (Swing,)) == swing


@pytest.mark.parametrize(
    "change", [{"mass_damping": "small"}, {"mass_damping": None}, {"mass_damping": True}, {"damping": 0.1}, {"stiffness": 0.1}], ids=lambda change: str(change)
)
def test_damping_of_another_kind_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    fields = {"period_s": 0.5, "mass_damping": 0.1, "stiffness_damping": 1e-3, "bodies": 2} | change
    path = store.write_arrays(tmp_path / "a.npz", {"outline": np.array(json.dumps({"class": "Swing", "fields": fields}))})
    with pytest.raises(InputError, match="written by another version"):
        store.load(path, (Swing,))


def test_a_clip_keeps_its_camera_and_its_missing_depth(tmp_path: Path, made_clip: Clip) -> None:
    back = store.load(store.save(tmp_path / "a.npz", made_clip), (Clip, Camera))
    assert back.depth is None
    assert back.camera.world_frame_id == "world"
    np.testing.assert_array_equal(back.frames, made_clip.frames)


def test_a_flat_dataclass_comes_back_as_it_was() -> None:
    camera = Camera(np.eye(3), np.eye(4), 4, 3, "optical")
    grid = Grid(np.arange(3.0), 0.25, (4, 5, 6))
    arrays = store.flat(Scene(grid, camera, "a bar"), "of_")
    assert list(arrays) == ["of_name", *(f"of_grid_{n}" for n in vars(grid)), *(f"of_camera_{n}" for n in vars(camera))]
    assert not any(array.dtype.hasobject for array in arrays.values())
    back = store.built(Scene, arrays, "of_")
    assert (back.name, back.depth) == ("a bar", None)
    assert (back.grid.dx, back.grid.size, back.grid.clamp_index, back.camera.frame_id) == (0.25, (4, 5, 6), -1, "optical")
    np.testing.assert_array_equal(back.camera.world_from_camera, camera.world_from_camera)


def test_only_an_array_with_a_default_may_be_missing_from_a_flat_dataclass() -> None:
    arrays = store.flat(Grid(np.zeros(3), 0.1, (2, 2, 2)), "grid_")
    without = {name: {k: v for k, v in arrays.items() if k != name} for name in ("grid_clamp_index", "grid_dx")}
    assert store.built(Grid, without["grid_clamp_index"], "grid_").clamp_index == -1
    with pytest.raises(KeyError, match="grid_dx"):
        store.built(Grid, without["grid_dx"], "grid_")


def test_equal_content_gives_equal_bytes(tmp_path: Path, made_clip: Clip) -> None:
    first, second = (store.save(tmp_path / name, made_clip).read_bytes() for name in ("a.npz", "b.npz"))
    assert first == second


@pytest.mark.parametrize(
    ("content", "reason"), [(None, "no such file"), (b"not a zip", "not a readable .npz"), (b"PK\x03\x04 cut short", "not a readable .npz")]
)
def test_a_missing_or_broken_file_is_refused_in_one_sentence(tmp_path: Path, content: bytes | None, reason: str) -> None:
    path = tmp_path / "clip.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=reason) as caught:
        store.load(path, (Clip, Camera))
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_an_npz_of_another_kind_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=np.zeros(3))
    with pytest.raises(InputError, match="diffphys ingest"):
        store.load(tmp_path / "a.npz", (Clip, Camera))


def test_a_class_that_was_not_asked_for_is_not_built(tmp_path: Path) -> None:
    store.save(tmp_path / "a.npz", Shelf(1.0, (), np.zeros(1)))
    with pytest.raises(InputError, match="another version"):
        store.load(tmp_path / "a.npz", (Clip,))


def test_a_failed_write_leaves_nothing_behind(tmp_path: Path) -> None:
    def fail(path: Path) -> None:
        path.write_text("half")
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError, match="interrupted"):
        store.write_whole(tmp_path / "a.txt", fail)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file_whole(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(TypeError):
        store.write_whole(tmp_path / "a.txt", lambda path: path.write_text(3))  # type: ignore[arg-type]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_objects_of_python_are_refused_and_no_file_is_left(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="arrays odd hold Python objects"):
        store.write_arrays(tmp_path / "a.npz", {"good": np.zeros(3), "odd": np.array([{}])})
    assert list(tmp_path.iterdir()) == []


def test_a_file_holds_the_arrays_that_were_given_and_nothing_else(tmp_path: Path) -> None:
    assert set(store.read_arrays(store.write_arrays(tmp_path / "a.npz", {"x": np.zeros(3), "word": np.array("a")}), "a test")) == {"x", "word"}
