"""Claims about dataclasses on disk."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import store
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera, Clip


@dataclass(frozen=True)
class Shelf:
    width: float
    books: tuple[str, ...]
    table: np.ndarray
    inner: Shelf | None = None
    words: dict[str, str] = field(default_factory=dict)


class Model:
    def __init__(self, basis: np.ndarray) -> None:
        self.basis = basis

    def to_arrays(self) -> dict[str, np.ndarray]:
        return {"basis": self.basis}

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> Model:
        return cls(arrays["basis"])


def test_nested_dataclasses_come_back_as_they_were(tmp_path: Path) -> None:
    inner = Shelf(np.float64(0.5), (), np.arange(3, dtype=np.uint8))
    store.save(tmp_path / "a.npz", Shelf(float("nan"), ("x", "y"), np.eye(2), inner, {"a": "b"}))
    back = store.load(tmp_path / "a.npz", (Shelf,))
    assert np.isnan(back.width)
    assert (back.books, back.words, back.inner.width, back.inner.inner) == (("x", "y"), {"a": "b"}, 0.5, None)
    assert back.inner.table.dtype == np.uint8
    np.testing.assert_array_equal(back.table, np.eye(2))


def test_a_clip_keeps_its_camera_and_its_missing_depth(tmp_path: Path, made_clip: Clip) -> None:
    back = store.load(store.save(tmp_path / "a.npz", made_clip), (Clip, Camera))
    assert back.depth is None
    assert back.camera.world_frame_id == "world"
    np.testing.assert_array_equal(back.frames, made_clip.frames)


def test_a_class_with_to_arrays_takes_part(tmp_path: Path) -> None:
    back = store.load(store.save(tmp_path / "a.npz", {"model": Model(np.ones((2, 3)))}), (Model,))
    np.testing.assert_array_equal(back["model"].basis, np.ones((2, 3)))


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
