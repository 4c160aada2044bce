"""Spoiled files of our own making: recovery.npz, checkpoint, prepared clip, capture, LPIPS weights, truth.npz."""

from __future__ import annotations

import io
import json
import os
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch

from diffphys_ros import config, result, score, shapes, store
from diffphys_ros.depth.capture import FILE, ClipView, read_clip_view
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.checkpoint import Checkpoint, Stored
from diffphys_ros.inverse.descent import Descent
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.unknowns import Layout
from diffphys_ros.metrics.lpips import ALEX, Lpips
from tests.conftest import make_clip, make_recovery
from tests.inverse.test_checkpoint import SETTINGS, written
from tests.prepared import make_prepared

COUNT = 25_000
KINDS = ("f8", "f4", "f2", "i8", "u1", "i1", "?", "c16", "U3", "S2", ">f8", "M8[s]", "O")
NUMBERS = (np.nan, np.inf, -np.inf, 0, -1, 1e308, -1e308, 1e-308, 2**62, 7)
SHAPES = ("(1000000000000,)", "(-3,)", "(0, 1000000000000)", "(1000000000000, 0)", "(99999999999999999999999,)", "(" + "1, " * 70 + ")", "(2, 3", "None", "(True,)", "(1e3,)")
JUNK: tuple[Any, ...] = (
    None, True, -1, 10**30, 1.5, float("nan"), "", "x" * 5000, "\x00\n", [], {}, [[]],
    {"array": "none"}, {"array": ["a"]}, {"class": "ModalModel"}, {"class": "Clip", "fields": {}}, {"dict": []}, {"tuple": 3},
)  # fmt: skip


def case(seed: int, folder: Path) -> str:
    """One spoiled file, given to the door that reads it."""
    rng = np.random.default_rng(seed)
    door = DOORS[str(rng.choice(list(DOORS), p=[0.25, 0.15, 0.25, 0.15, 0.05, 0.15]))]
    name, read = door
    path = folder / name
    if rng.random() < 0.02:
        odd_file(rng, path)
    elif rng.random() < 0.3:
        path.write_bytes(spoiled_bytes(rng, WHOLE[name]))
    else:
        path.write_bytes(spoiled_members(rng, WHOLE[name]) if name != "net.pth" else spoiled_weights(rng))
    if rng.random() < 0.1:
        (folder / result.METRICS).write_bytes(spoiled_json(rng, {"notes": ["a"], "loss": [1.0, None]}))
    try:
        read(path)
    except InputError as error:
        said = str(error)
    else:
        return "taken"
    assert said.isprintable(), "not printable"  # nor more than a line
    assert 0 < len(said) < 600, f"a long sentence: {said[:200]}"
    return "refused"


def odd_file(rng: np.random.Generator, path: Path) -> None:
    """What is no regular file, or an empty one."""
    kind = rng.integers(4)
    if kind == 0:
        os.mkfifo(path)
    elif kind == 1:
        path.mkdir()
    elif kind == 2:
        path.symlink_to(path.name)
    else:
        path.write_bytes(b"")


def spoiled_bytes(rng: np.random.Generator, whole: bytes) -> bytes:
    data = bytearray(whole)
    for _ in range(rng.integers(1, 9)):
        kind, at = rng.integers(5), int(rng.integers(len(data)))
        if kind <= 1:
            data[at] ^= int(rng.integers(1, 256))
        elif kind == 2:
            data[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"PK\x01\x02", b"PK\x05\x06"])
        elif kind == 3:
            at = int(rng.integers(max(0, len(data) - 200), len(data)))  # the directory of the archive
            data[at] ^= int(rng.integers(1, 256))
        else:
            del data[max(at, 1) :]
    return bytes(data)


def spoiled_members(rng: np.random.Generator, whole: bytes) -> bytes:
    """The archive with some arrays replaced, renamed, left out or described wrongly."""
    with np.load(io.BytesIO(whole)) as file:
        arrays = {name: file[name] for name in file.files}
    raw: dict[str, bytes] = {}
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        name = str(rng.choice(list(arrays)))
        kind = rng.integers(10)
        if kind == 0 and len(arrays) > 1:
            del arrays[name]
        elif kind == 1:
            arrays[name] = arrays[str(rng.choice(list(arrays)))]
        elif kind == 2:
            raw[name] = spoiled_header(rng, arrays[name])
        elif kind == 3 and "outline" in arrays:
            arrays["outline"] = np.array(spoiled_json(rng, json.loads(OUTLINE)).decode("utf-8", "replace"))
        elif kind == 4:
            raw[str(rng.choice([name, "x\n" * 400, "../up", ""]))] = bomb()
        else:
            arrays[name] = spoiled_array(rng, arrays[name])
    return packed(rng, arrays, raw)


def spoiled_array(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    kind = rng.integers(10)
    if kind == 0 and array.size:
        return array.reshape(-1)[: rng.integers(array.size)]
    if kind == 1:
        return array[None]
    if kind == 2:
        return array.T
    if kind == 3:
        return array[..., :0] if array.ndim else np.zeros((0,))
    if kind == 4:
        return np.asarray(rng.choice(["words", "", "\udcff", "a\0b"])) if array.dtype.kind != "U" else np.zeros(3)
    if kind == 5:
        return array * array.dtype.type(1) if array.dtype.kind in "fiu" else array  # as it was
    if kind >= 7 and array.size and array.dtype.kind in "fiub":
        changed = array.astype(float) if rng.random() < 0.5 else array.copy()
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            changed.reshape(-1)[rng.integers(changed.size)] = np.array(rng.choice(NUMBERS)).astype(changed.dtype)
        return changed
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return array.astype(str(rng.choice(KINDS)))
        except (TypeError, ValueError):
            return np.zeros(array.shape)


def spoiled_header(rng: np.random.Generator, array: np.ndarray) -> bytes:
    """A member of an .npz whose header promises something else."""
    kind = str(rng.choice(["'<f8'", "'|O'", "'<U4294967295'", "'<U0'", "[('a', '<f8')]", "'|b1'", "'<f3'", "'" + "<" * 300 + "'"]))
    header = f"{{'descr': {kind}, 'fortran_order': {rng.choice(['True', 'False', '0'])}, 'shape': {rng.choice(SHAPES)}, }}"
    header = str(rng.choice([header, "[" * 9000, "{" * 100, "(" + "9" * 8000 + ")", "__import__('os')", header]))
    content = header.encode() + b"\n"
    version = bytes(rng.choice([[1, 0], [2, 0], [3, 0], [9, 9]]).tolist())
    length = len(content) if rng.random() < 0.8 else int(rng.integers(2**16))
    return b"\x93NUMPY" + version + struct.pack("<H" if version[0] == 1 else "<I", length) + content + array.tobytes()[:1000]


@cache
def bomb() -> bytes:
    """Sixty million zeros, as an array."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "|u1", "fortran_order": False, "shape": (60_000_000,)})
    return header.getvalue() + bytes(60_000_000)


@cache
def deflated_bomb() -> tuple[bytes, int]:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(bomb()) + packer.flush(), zlib.crc32(bomb())


def packed(rng: np.random.Generator, arrays: dict[str, np.ndarray], raw: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    method = zipfile.ZIP_STORED if rng.random() < 0.3 else zipfile.ZIP_DEFLATED
    if rng.random() < 0.02:
        method = zipfile.ZIP_LZMA if rng.random() < 0.5 else zipfile.ZIP_BZIP2
    big = [name for name, content in raw.items() if content is bomb()]
    with warnings.catch_warnings(), zipfile.ZipFile(out, "w", method, compresslevel=1) as archive:
        warnings.simplefilter("ignore")  # of names twice
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asarray(array), allow_pickle=True)
            archive.writestr(f"{name}.npy", raw[name] if name in raw and name not in big else content.getvalue())
        for name in big:
            archive.writestr(f"{name}.npy", b"")
    data = out.getvalue()
    return promised(data, int(rng.choice([2**20, 2**31, 2**32 - 2]))) if big else data


def promised(data: bytes, size: int) -> bytes:
    """The last member of the archive holds the bomb and says that it is of `size` bytes."""
    content, check = deflated_bomb()
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        last, start = archive.infolist()[-1], archive.start_dir
    body = bytearray(data[:start])
    body[last.header_offset + 8 : last.header_offset + 10] = struct.pack("<H", 8)
    directory = bytearray(data[start:])
    at = directory.rfind(b"PK\x01\x02")
    directory[at + 10 : at + 12] = struct.pack("<H", 8)
    directory[at + 16 : at + 28] = struct.pack("<III", check, len(content), size)
    end = directory.rfind(b"PK\x05\x06")
    directory[end + 16 : end + 20] = struct.pack("<I", len(body) + len(content))
    return bytes(body) + content + bytes(directory)


def spoiled_json(rng: np.random.Generator, value: Any) -> bytes:
    kind = rng.integers(6)
    if kind == 0:
        depth = int(rng.choice([100, 5000, 200_000]))
        return rng.choice(["[", '{"a":', '{"list":[', '{"dict":{"a":']).encode() * depth
    if kind == 1:
        text = bytearray(json.dumps(value).encode())
        text[rng.integers(len(text))] = rng.integers(256)
        return bytes(text)
    for _ in range(rng.integers(1, 4)):
        value = with_junk(rng, value)
    return json.dumps(value).encode()


def with_junk(rng: np.random.Generator, value: Any) -> Any:
    """One place of nested JSON replaced."""
    inner = list(value.items()) if isinstance(value, dict) else list(enumerate(value)) if isinstance(value, list) else []
    if not inner or rng.random() < 0.15:
        return JUNK[rng.integers(len(JUNK))]
    key, item = inner[rng.integers(len(inner))]
    if isinstance(value, dict) and rng.random() < 0.1:
        return {k: v for k, v in value.items() if k != key} | ({"extra": item} if rng.random() < 0.5 else {})
    new = with_junk(rng, item)
    return {**value, key: new} if isinstance(value, dict) else [*value[:key], new, *value[key + 1 :]]


def spoiled_weights(rng: np.random.Generator) -> bytes:
    """A state dict of AlexNet with something wrong, or something else."""
    whole = weights()
    found: Any = dict(whole)
    for _ in range(rng.integers(0, 3)):
        name = str(rng.choice(list(whole)))
        tensor = whole[name]
        found[name] = [
            tensor[:0], tensor[None], torch.zeros(()), torch.zeros(1).expand(10**6, 10**6), [1.0], "text", tensor.to(torch.complex64).conj(), tensor.int(),
            torch.full((1,), float("nan")).expand(tensor.shape), torch.zeros(3).to_sparse(), tensor.half(), None, torch.zeros(0),
        ][rng.integers(13)]  # fmt: skip
    found = [found, found, found, [found], torch.zeros(3), 5, "text", {1: 2}, {}][rng.integers(9)]
    out = io.BytesIO()
    torch.save(found, out, _use_new_zipfile_serialization=bool(rng.random() < 0.8))
    return out.getvalue() if rng.random() < 0.8 else spoiled_bytes(rng, out.getvalue())


@cache
def weights() -> dict[str, torch.Tensor]:
    """A network of AlexNet's shapes in a few numbers."""
    before, found = 3, {}
    for layer in ALEX:
        found[f"features.{layer.index}.weight"] = torch.full((1,), 0.01).expand(layer.channels, before, layer.kernel, layer.kernel)
        found[f"features.{layer.index}.bias"] = torch.zeros(1).expand(layer.channels)
        before = layer.channels
    return found


def heads() -> dict[str, torch.Tensor]:
    return {f"lin{k}.model.1.weight": torch.ones(1, layer.channels, 1, 1) for k, layer in enumerate(ALEX)}


def wholes(folder: Path) -> dict[str, bytes]:
    """One whole file for every door, made in an empty folder."""
    clip = make_clip()
    recovery = make_recovery(clip)
    result.save(recovery, clip, config.Settings(), folder)
    written(folder / "checkpoint.npz", clip, state())
    result.save_prepared(folder / "clip.npz", make_prepared(clip), config.Settings())
    view = ClipView(clip.frames[0], clip.camera, np.zeros(4), np.ones(clip.frames.shape[1:3], np.float32), "pictures", "topic", 0.05, np.array([0.0, 1.0, 0.0]))
    store.write_arrays(folder / FILE, view.arrays())
    vertices, frames = recovery.points, len(clip)
    truth = {
        "rest_vertices": vertices, "positions": recovery.trajectory, "part_E": np.array([8e4, 2e4]), "vertex_E": recovery.young, "vertex_part": recovery.part - 1,
        "interface": np.zeros(len(vertices), bool), "vertex_volume": recovery.volume, "clamped": recovery.clamped, "force_density": recovery.force[:frames],
    }  # fmt: skip
    store.write_arrays(folder / "truth.npz", truth)
    torch.save(weights(), folder / "net.pth")
    torch.save(heads(), folder / "heads.pth")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def read_recovery(path: Path) -> None:
    recovery = result.load(path.parent)
    assert np.isfinite(recovery.net_force()).all()
    assert np.isfinite(recovery.young_solver).all()


@cache
def layout() -> Layout:
    prepared = make_prepared(make_clip())
    return Layout.of(prepared.start, prepared.body, force_unit=1.0, initial_modes=0, motion_unit=np.ones((2, prepared.modal.modes)), held=())


def state() -> Stored:
    rng = np.random.default_rng(0)
    descent = Descent(rng.normal(size=6), 0.4, rng.normal(size=6), rng.normal(size=(2, 6)), rng.normal(size=(2, 6)), 3, 1)
    return Stored(1, rng.normal(size=layout().size), descent, np.full(layout().parts, 1e5), {"fit": [0.9, 0.5], "fields": [0.5, 0.4]})


def read_checkpoint(path: Path) -> None:
    checkpoint = Checkpoint(path, resume=True)
    checkpoint.bind(make_clip(), SETTINGS)
    found = checkpoint.load(layout(), 3)
    assert found is not None
    assert np.array_equal(found.z, state().z), "other numbers were taken"
    assert np.array_equal(found.descent.steps, state().descent.steps), "other numbers were taken"


def read_prepared(path: Path) -> None:
    prepared, settings = result.load_prepared(path), result.stored_settings(path)
    assert isinstance(prepared, Prepared)
    assert np.isfinite(prepared.modal.frequencies(prepared.start.young)).all()
    config.layered(base=settings)


def read_capture(path: Path) -> None:
    view = read_clip_view(path.parent)
    shapes.check(view.arrays(), {"frame": "pixel H W 3", "depth": "real H W"})


def read_weights(path: Path) -> None:
    image, linear = make_clip().frames[0], path.with_name("heads.pth")
    linear.write_bytes(WHOLE["heads.pth"])
    Lpips(path, linear).masked(image, image[::-1].copy(), np.ones(image.shape[:2], bool))


def read_truth(path: Path) -> None:
    recovery = path.with_name(result.RECOVERY)
    recovery.write_bytes(WHOLE[result.RECOVERY])
    figures = score.score(recovery, path)
    assert set(figures) >= {"young_log10_error", "trajectory_rmse_over_rms_motion"}


DOORS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "recovery": (result.RECOVERY, read_recovery),
    "checkpoint": (result.CHECKPOINT, read_checkpoint),
    "prepared": ("clip.npz", read_prepared),
    "capture": (FILE, read_capture),
    "weights": ("net.pth", read_weights),
    "truth": ("truth.npz", read_truth),
}
with TemporaryDirectory() as _folder:
    WHOLE = wholes(Path(_folder))
with np.load(io.BytesIO(WHOLE["clip.npz"])) as _file:
    OUTLINE = str(_file["outline"])
