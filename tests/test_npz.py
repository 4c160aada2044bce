"""Claims about .npz files whose writer is unknown: a sentence for each, at once and in little memory."""

from __future__ import annotations

import io
import os
import resource
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from diffphys_ros import npz, store
from diffphys_ros.errors import InputError


def header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def promising(shape: str, kind: str = "'<f8'") -> bytes:
    return header(f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}")


def archive(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError, match=r"not a readable \.npz") as caught:
        store.read_arrays(path, "clip")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400
    return str(caught.value)


@pytest.mark.parametrize(
    "array",
    [
        *(np.arange(6).reshape(2, 3), np.asfortranarray(np.eye(3)[:2]), np.float32(2), np.array(["ab", "ü"])),
        *(np.zeros((3, 0, 2)), np.ones(2, ">f8"), np.array(""), np.array([True])),
    ],
)
def test_what_numpy_writes_comes_back(tmp_path: Path, array: np.ndarray) -> None:
    np.savez_compressed(tmp_path / "a.npz", x=array)
    back = npz.read(tmp_path / "a.npz")["x"]
    np.testing.assert_array_equal(back, array)
    assert back.dtype == np.asarray(array).dtype.newbyteorder("=")


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(0, 1000000000000)", "(1000000000000, 0)", "(99999999999999999999999999,)", "(-3,)", "(2, 3", "None"])
def test_a_header_that_promises_what_is_not_there_is_refused_before_memory_is_given_to_it(tmp_path: Path, shape: str) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refusal(archive(tmp_path / "a.npz", {"x.npy": promising(shape) + bytes(80)}))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # KiB


@pytest.mark.parametrize("kind", ["'|O'", "'<U0'", "'<U4294967295'", "[('a', '<f8')]", "'<f3'", "__import__('os')", "[" * 5000])
def test_a_header_of_another_kind_of_array_is_refused(tmp_path: Path, kind: str) -> None:
    refusal(archive(tmp_path / "a.npz", {"x.npy": promising("(1,)", kind) + bytes(8)}))


@pytest.mark.parametrize(
    "members",
    [
        {"x.npy": b""},
        {"x.npy": b"no array"},
        {"x.txt": b"text"},
        {"x.npy": promising("(2,)", "'|b1'") + b"\x02\x00"},
        {"x.npy": promising("(1,)", "'<U1'") + b"\xff\xff\xff\xff"},
        {"x.npy": promising("(1,)", "'<U1'") + b"\x00\xd8\x00\x00"},
    ],
)
def test_content_that_is_no_array_of_its_kind_is_refused(tmp_path: Path, members: dict[str, bytes]) -> None:
    refusal(archive(tmp_path / "a.npz", members))


def test_a_bomb_is_refused_by_what_it_says_that_it_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = archive(tmp_path / "a.npz", {"x.npy": promising("(100000000,)", "'|u1'") + bytes(100_000_000)})
    assert len(npz.read(path)["x"]) == 100_000_000
    monkeypatch.setattr(npz, "FREE_BYTES", 2**26)
    assert "would unpack to more" in refusal(path)


def test_a_bomb_that_lies_about_its_size_is_cut_there(tmp_path: Path) -> None:
    content = promising("(60000000,)", "'|u1'") + bytes(60_000_000)
    path = archive(tmp_path / "a.npz", {"x.npy": content})
    data = path.read_bytes()
    small = (len(content) - 59_000_000).to_bytes(4, "little")
    path.write_bytes(data.replace(len(content).to_bytes(4, "little"), small))
    refusal(path)


def test_every_byte_of_a_file_may_be_spoiled(tmp_path: Path) -> None:
    """36 of 200 places once ended in an error of zlib."""
    whole, path = io.BytesIO(), tmp_path / "a.npz"
    np.savez_compressed(whole, x=np.arange(300.0), words=np.array(["one", "two"]))
    data = whole.getvalue()
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :])
        with suppress(InputError):
            store.read_arrays(path, "clip")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_another_compression_is_refused(tmp_path: Path, method: int) -> None:
    refusal(archive(tmp_path / "a.npz", {"x.npy": promising("(1,)") + bytes(8)}, method))


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.npz")
    assert "no regular file" in refusal(tmp_path / "a.npz")


def test_a_folder_and_a_name_that_no_file_can_have_are_refused(tmp_path: Path) -> None:
    refusal(tmp_path)
    with pytest.raises(InputError):
        store.read_arrays("a\0b.npz", "clip")
