"""A model's answers, remembered and fresh, a person's file of materials, and what a server may send instead of an answer."""

from __future__ import annotations

import json
import os
import socket
import threading
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.prior import material_prior
from diffphys_ros.prior.cache import Cache, key_of
from diffphys_ros.prior.model import endpoint_of
from diffphys_ros.prior.prompt import question, records_of
from diffphys_ros.prior.records import Record
from diffphys_ros.prior.written import read_records
from diffphys_ros.types import Camera, Clip, MaterialPrior
from tests.fuzz._spoil import LONGEST_SENTENCE, checked_sentence, deep, spoiled_bytes, words_of

COUNT = 15_000
os.environ["NO_PROXY"] = os.environ["no_proxy"] = "127.0.0.1"
SOCKETS = 0.02  # share of the cases that go through a real socket
TIMEOUT_S = 0.2
PARTS, HEIGHT, WIDTH = 2, 12, 16

STEM = {"name": "stem", "box": [0.4, 0.5, 0.6, 1.0], "material": "green stem", "E": 2e8, "nu": 0.35, "rho": 900, "part": 1}
FLOWER = {"name": "flower", "box": [0.2, 0.1, 0.8, 0.5], "material": "petal", "E": 2e6, "nu": 0.4, "rho": 600}
KEYS = ("name", "part", "box", "material", "E", "nu", "rho", "within", "E ", "", "parts")
WRITTEN = "parts:\n- {part: 1, material: wood}\n- {name: leaf, box: [0.4, 0.1, 0.8, 0.5], E: 2e6, nu: 0.4, rho: 900, within: 3}\n- {part: 2, material: rubber, rho: 1234}\n"
BITS = ("1:30", "010", "1e-3", ".nan", "1" * 5000, "wood", "~", "[0, 0, 1, 1]", "[1e308, -1, .inf]", "{a: 1, a: 2}", "&a 1", "*a", "<<", "!!int x", "[" * 500, "\0", "\ud800", "x" * 500, "yes", "-1", "3", "255")  # fmt: skip


@lru_cache(1)
def clip() -> Clip:
    """An upright stem (part 1) that carries a flower (part 2)."""
    labels = np.zeros((1, HEIGHT, WIDTH), np.uint8)
    labels[0, 6:, 7:9], labels[0, 1:6, 4:12], labels[0, 0] = 1, 2, 255
    frames = np.broadcast_to(labels[..., None] * np.uint8(60), (1, HEIGHT, WIDTH, 3)).copy()
    return Clip(frames, 0, 1 / 30, Camera(np.eye(3), np.eye(4), WIDTH, HEIGHT), labels=labels, source="made up")


def case(seed: int, folder: Path) -> str:
    rng = np.random.default_rng(seed)
    if rng.random() < SOCKETS:
        return by_socket(rng, folder)
    return (by_answer, by_answer, by_cache, by_file, by_file)[rng.integers(5)](rng, folder)


def by_answer(rng: np.random.Generator, folder: Path) -> str:
    try:
        records = records_of(answer(rng), parts=PARTS)
    except InputError as error:
        return checked_sentence(error)
    check(records)
    return "taken"


def answer(rng: np.random.Generator) -> str:
    """What a model may say: good, with values changed, spoiled, fenced, or nonsense."""
    entries: Any = [changed(rng, entry) for entry in (STEM, FLOWER)][: rng.integers(0, 3)] * int(rng.choice([1, 1, 1, 1, 40]))
    if rng.random() < 0.1:
        entries = deep(int(rng.integers(10, 900))) if rng.random() < 0.3 else as_json(words_of(rng))
    text = json.dumps(entries, ensure_ascii=bool(rng.random() < 0.5))
    if rng.random() < 0.05:
        text = "".join(rng.choice(["```", "`", "a", " ", "\n", "[", "{", '"'], 300)) * int(rng.integers(1, 1000))
    if rng.random() < 0.05:
        text = text.replace("2000000.0", str(rng.choice(["1e999", "NaN", "-Infinity", "1" * 5000, "1e400", '"2e6"', "true"])))
    text = spoiled_bytes(rng, text.encode("utf-8", "surrogatepass")).decode("utf-8", "replace") if rng.random() < 0.4 else text
    return f"Here:\n```{rng.choice(['', 'json', 'json5', ' '])}\n{text}{rng.choice(['', chr(10)])}```\nMore?" if rng.random() < 0.2 else text


def changed(rng: np.random.Generator, entry: dict[str, Any]) -> dict[str, Any]:
    """An entry as it is, or with one key changed, missing or more."""
    entry = dict(entry)
    if rng.random() < 0.5:
        return entry
    key = str(rng.choice(KEYS))
    if rng.random() < 0.2:
        entry.pop(key, None)
    elif key in ("E", "nu", "rho") and rng.random() < 0.5:
        entry[key] = float(10 ** rng.uniform(-4, 13))
    elif key == "box" and rng.random() < 0.7:
        entry[key] = np.round(rng.uniform(-0.2, 1.2, int(rng.choice([4, 4, 4, 3, 5]))), 2).tolist()
    else:
        entry[key] = as_json(words_of(rng))
    return entry


def as_json(value: Any) -> Any:
    """A value, or its name where JSON has none such."""
    try:
        json.dumps(value)
        return value
    except (TypeError, ValueError, RecursionError):
        return type(value).__name__


def check(records: list[Record]) -> None:
    """Everything inside the bounds of solids."""
    assert records
    for r in records:
        assert 1e2 <= r.young <= 1e12
        assert 0 <= r.poisson <= 0.49
        assert 1 <= r.density <= 3e4
        assert 0 < r.log10_young_sd < 4
        assert r.part is None or 1 <= r.part <= PARTS
        assert r.name.isprintable()
        assert 0 < len(r.name) <= 80
        assert r.box is None or all(0 <= c <= 1 for c in r.box)


def check_prior(prior: MaterialPrior | None) -> None:
    assert prior is not None
    assert prior.index.shape == (HEIGHT, WIDTH)
    assert prior.index.min() >= 0
    assert prior.index.max() < len(prior.name)
    for values in (prior.young, prior.poisson, prior.density, prior.log10_young_sd):
        assert np.isfinite(values).all()
    for note in prior.notes:
        assert note.isprintable(), repr(note)
        assert len(note) < LONGEST_SENTENCE, len(note)


def asked(url: str, folder: Path) -> MaterialPrior | None:
    values = {"prior.base_url": url, "prior.model": "seer-1", "experiment.prior_cache": str(folder / "cache"), "experiment.prior_timeout_s": TIMEOUT_S, "experiment.prior_attempts": 1}
    return material_prior(clip(), build(values))


def by_cache(rng: np.random.Generator, folder: Path) -> str:
    """A poisoned file where the answer to this very question would stand; what is not read from it is asked of a server that is not there."""
    settings = build({"prior.base_url": "http://127.0.0.1:9/v1", "prior.model": "seer-1"})
    endpoint = endpoint_of(settings)
    key = key_of(endpoint.base_url, endpoint.model, question(clip().frames[0], clip().labels[0]))
    cache = Cache(folder / "cache")
    cache.put(key, answer(rng).encode("utf-8", "replace").decode())
    file = folder / "cache" / f"{key}.json"
    _poison(rng, file)
    remembered = cache.get(key)
    assert remembered is None or isinstance(remembered, str)
    if rng.random() < 0.9:
        return "refused" if remembered is None else "taken"
    prior = asked("http://127.0.0.1:9/v1", folder)
    check_prior(prior)
    return "refused" if prior is not None and prior.notes else "taken"


def _poison(rng: np.random.Generator, file: Path) -> None:
    data, kind = file.read_bytes(), rng.integers(8)
    if kind == 0:
        return
    if kind == 1:
        file.write_bytes(b"[" * int(rng.integers(1, 10**6)))
    elif kind == 2:
        file.write_text(json.dumps({"answer": as_json(words_of(rng))}))
    elif kind == 3:
        file.unlink()
        (os.mkfifo, os.mkdir, lambda path: os.symlink(path, path), lambda path: os.symlink("/dev/zero", path))[rng.integers(4)](file)  # type: ignore[operator]
    elif kind == 4 and rng.random() < 0.1:
        with file.open("r+b") as stream:
            stream.truncate(1 << 31)
    else:
        file.write_bytes(spoiled_bytes(rng, data))


def by_file(rng: np.random.Generator, folder: Path) -> str:
    """A person's file, spoiled; half of those that can be read go on to the image of the prior."""
    path = folder / "materials.yaml"
    text = WRITTEN
    for _ in range(rng.integers(0, 3)):
        words = text.split(" ")
        words[rng.integers(len(words))] = str(rng.choice(BITS)) + str(rng.choice(["", ",", "}", "\n"]))
        text = " ".join(words)
    path.write_bytes(spoiled_bytes(rng, text.encode("utf-8", "surrogatepass")))
    try:
        check(read_records(path, parts=PARTS))
        if rng.random() < 0.5:
            check_prior(material_prior(clip(), build({"prior.file": str(path)})))
    except InputError as error:
        return checked_sentence(error)
    return "taken"


def by_socket(rng: np.random.Generator, folder: Path) -> str:
    """Bytes of a server, good or spoiled, whole or dripped; the database steps in where they are no answer."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        sent = response(rng)
        server = threading.Thread(target=_serve, args=(listening, sent, bool(rng.random() < 0.3), bool(rng.random() < 0.5)), daemon=True)
        server.start()
        prior = asked(f"http://127.0.0.1:{listening.getsockname()[1]}/v1", folder)
        server.join(5.0)
        assert not server.is_alive(), "the connection outlives the request"
    check_prior(prior)
    return "refused" if prior is not None and prior.notes else "taken"


def response(rng: np.random.Generator) -> bytes:
    body = json.dumps({"choices": [{"message": {"content": answer(rng) if rng.random() < 0.5 else json.dumps([STEM, FLOWER])}}]}).encode()
    length = len(body) if rng.random() < 0.7 else int(rng.choice([0, 1, 10**12, len(body) + 5]))
    head = rng.choice(["200 OK", "200 OK", "200 OK", "200 OK", "500 No", "302 Found", "999 ?", "100 Continue", "-1", "204 x"])
    chunked = f"{len(body):x}{rng.choice(['', ';x=y'])}\r\n".encode() + body + b"\r\n0\r\n\r\n"
    if rng.random() < 0.3:
        return spoiled_bytes(rng, f"HTTP/1.1 {head}\r\nTransfer-Encoding: chunked\r\n\r\n".encode() + chunked)
    more = str(rng.choice(["", "Location: http://127.0.0.1:9/\r\n", "X: y\r\n" * 200, "X: " + "y" * 70_000 + "\r\n", "Content-Encoding: gzip\r\n"]))
    return spoiled_bytes(rng, f"HTTP/1.1 {head}\r\nContent-Length: {length}\r\n{more}\r\n".encode() + body)


def _serve(listening: socket.socket, sent: bytes, dripped: bool, closes: bool) -> None:
    """Sends and, where it does not close, waits for the other side to."""
    try:
        connection, _ = listening.accept()
        with connection:
            connection.settimeout(4.0)
            connection.recv(1 << 16)
            for k in range(0, len(sent), 64) if dripped else (0,):
                connection.sendall(sent[k : k + 64] if dripped else sent)
            while not closes and connection.recv(1 << 16):
                pass
    except OSError:
        pass
