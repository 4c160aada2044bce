"""The vision-language model, against a real HTTP server that also misbehaves."""

from __future__ import annotations

import base64
import dataclasses
import json
import logging
import time

import cv2
import numpy as np
import pytest

from diffphys_ros.config import Settings, build
from diffphys_ros.errors import InputError
from diffphys_ros.prior import material_prior
from diffphys_ros.prior.model import NoAnswerError, ask

from .conftest import FLOWER, GOOD, STEM
from .server import ChatServer, dripping, hang_up, raw, says, silent, status

KEY = "sk-very-secret-0123456789"


@pytest.fixture(autouse=True)
def environment(monkeypatch, tmp_path):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("MY_KEY", KEY)


def settings(url: str | None, **changes) -> Settings:
    values = {"prior.base_url": url, "prior.model": "seer-1", "prior.api_key_env": "MY_KEY", "experiment.prior_timeout_s": 5.0}
    return build(values | {f"experiment.prior_{k}" if k in ("timeout_s", "attempts", "cache") else f"prior.{k}": v for k, v in changes.items()})


def asked(server: ChatServer, frame, labels, **changes):
    waits: list[float] = []
    records = ask(frame, labels, settings(server.url, **changes), wait=waits.append)
    return records, waits


def changed(**values) -> str:
    return json.dumps([STEM, {**FLOWER, **values}])


def test_a_good_answer_becomes_records(frame, labels) -> None:
    with ChatServer(says(GOOD)) as server:
        (stem, flower), waits = asked(server, frame, labels)
    assert (stem.name, stem.young, stem.poisson, stem.density, stem.box) == ("stem", 2e8, 0.35, 900.0, (0.4, 0.5, 0.6, 1.0))
    assert flower.material == "petal"
    assert not waits
    assert server.paths == ["/v1/chat/completions"]
    assert server.headers[0]["Authorization"] == f"Bearer {KEY}"


def test_the_model_is_shown_the_object_alone_and_its_masks_as_png_data_urls(frame, labels) -> None:
    with ChatServer(says(GOOD)) as server:
        asked(server, frame, labels)
    request = server.requests[0]
    assert request["model"] == "seer-1"
    text, first, masks = request["messages"][0]["content"]
    assert all(word in text["text"] for word in ('"box"', '"E"', "Pa", "kg/m^3", "JSON array", "1 red, 2 blue", "rubber"))
    image = decoded(first)
    np.testing.assert_array_equal(image[labels == 1], frame[labels == 1])
    assert (image[(labels == 0) | (labels == 255)] == 127).all()
    assert len(np.unique(decoded(masks).reshape(-1, 3), axis=0)) == 3


def decoded(part: dict) -> np.ndarray:
    head, data = part["image_url"]["url"].split(",")
    assert head == "data:image/png;base64"
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


@pytest.mark.parametrize("text", [f"```json\n{GOOD}\n```", f"Here you are:\n```\n{GOOD}\n```\nAnything else?", f"\n  {GOOD}\n"])
def test_markdown_around_the_array_does_no_harm(frame, labels, text: str) -> None:
    with ChatServer(says(text)) as server:
        assert len(asked(server, frame, labels)[0]) == 2


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        (GOOD[:-5], "not valid JSON"),
        (json.dumps({"parts": [STEM]}), "JSON dict, must be an array"),
        ("[]", "holds 0 objects"),
        (json.dumps(["stem"]), "Object 1: is 'stem', must be an object"),
        (changed(E=2.0), "Object 2: E is 2.0, must be a number in 100 .. 1e+12 Pa"),
        (changed(E=2e11), "petal has 100000 .. 5e+07 Pa"),
        (changed(E="stiff"), "E is 'stiff'"),
        (changed(E=None), "E is None"),
        (changed(nu=0.5), "nu is 0.5, must be a number in 0 .. 0.49"),
        (changed(rho=0.6), "rho is 0.6, must be a number in 1 .. 30000 kg/m^3"),
        (changed(box=[20, 6, 60, 30]), "shares of its width and height"),
        (changed(box=[0.8, 0.1, 0.2, 0.5]), "left < right"),
        (changed(box="top"), "box is 'top'"),
        (changed(name=""), "name is ''"),
        (changed(part=3), "part is 3, must be a whole number in 1 .. 2"),
        ('[{"E": 1e999}]', "name is None"),
        ("[" * 100_000, "not valid JSON"),
    ],
)
def test_an_answer_that_breaks_the_contract_is_told_why_and_asked_again(frame, labels, bad: str, told: str) -> None:
    with ChatServer(says(bad), says(GOOD)) as server:
        records, waits = asked(server, frame, labels)
    assert [record.name for record in records] == ["stem", "flower"]
    question, answer, complaint = server.requests[1]["messages"]
    assert question == server.requests[0]["messages"][0]
    assert answer == {"role": "assistant", "content": bad}
    assert told in complaint["content"]
    assert not waits


@pytest.mark.parametrize("bad", [status(500), status(503), status(429), raw(b"<html>busy</html>"), raw(b"{}"), raw(b'{"choices": []}'), hang_up])
def test_a_server_that_stumbles_is_asked_again_after_a_while(frame, labels, bad) -> None:
    with ChatServer(bad, bad, says(GOOD)) as server:
        records, waits = asked(server, frame, labels)
    assert len(records) == 2
    assert waits == [1.0, 2.0]
    assert server.requests[2] == server.requests[0]


@pytest.mark.parametrize("bad", [silent(60.0), dripping(60.0)])
def test_no_answer_takes_much_longer_than_the_timeout(frame, labels, bad) -> None:
    with ChatServer(bad) as server:
        began = time.monotonic()
        with pytest.raises(NoAnswerError, match=r"no whole answer within 0.3 s"):
            asked(server, frame, labels, timeout_s=0.3, attempts=2)
        assert time.monotonic() - began < 30.0
    assert len(server.requests) == 2


def test_an_endless_answer_is_cut_off(frame, labels) -> None:
    with ChatServer(raw(b" " * (3 << 20))) as server, pytest.raises(NoAnswerError, match="longer than 1048576 bytes"):
        asked(server, frame, labels, attempts=1)


@pytest.mark.parametrize("code", [400, 401, 403, 404])
def test_a_refusal_is_not_repeated(frame, labels, code: int) -> None:
    with ChatServer(status(code)) as server, pytest.raises(NoAnswerError, match=f"HTTP status {code}"):
        asked(server, frame, labels)
    assert len(server.requests) == 1


def test_redirects_are_not_followed_so_that_key_and_image_stay_with_the_named_server(frame, labels) -> None:
    with ChatServer(says(GOOD)) as other, ChatServer(status(302, Location=f"{other.url}/elsewhere")) as server:
        with pytest.raises(NoAnswerError, match="HTTP status 302"):
            asked(server, frame, labels)
        assert not other.requests


def test_the_same_question_is_asked_once_and_another_frame_anew(frame, labels) -> None:
    with ChatServer(says(GOOD)) as server:
        first, _ = asked(server, frame, labels)
        second, _ = asked(server, frame, labels)
        assert second == first
        assert len(server.requests) == 1
        asked(server, frame // 2, labels)
        asked(server, frame, labels, model="seer-2")
        assert len(server.requests) == 3


def test_a_broken_cache_file_is_asked_anew_and_an_unwritable_cache_does_no_harm(frame, labels, tmp_path) -> None:
    folder = tmp_path / "answers"
    with ChatServer(says(GOOD)) as server:
        asked(server, frame, labels, cache=str(folder))
        (stored,) = folder.iterdir()
        for broken in ("{", json.dumps({"answer": "[]"}), json.dumps([1])):
            stored.write_text(broken)
            asked(server, frame, labels, cache=str(folder))
        assert len(server.requests) == 4
        (tmp_path / "file").write_text("")
        assert len(asked(server, frame, labels, cache=str(tmp_path / "file" / "below"))[0]) == 2


def test_nothing_bad_is_ever_remembered(frame, labels, tmp_path) -> None:
    with ChatServer(says("no idea")) as server, pytest.raises(NoAnswerError, match="breaks the contract"):
        asked(server, frame, labels, cache=str(tmp_path / "answers"))
    assert len(server.requests) == 3
    assert not (tmp_path / "answers").exists()


def test_the_key_is_in_no_log_error_note_repr_or_file(clip, frame, labels, caplog, capfd, tmp_path) -> None:
    caplog.set_level(logging.DEBUG)
    with ChatServer(status(401)) as server:
        prior = material_prior(clip, settings(server.url))
        assert server.headers[0]["Authorization"].endswith(KEY)
    with ChatServer(says(GOOD)) as server:
        asked(server, frame, labels, cache=str(tmp_path / "answers"))
    assert prior is not None
    written = "".join(path.read_text() for path in (tmp_path / "answers").iterdir())
    everything = [caplog.text, *capfd.readouterr(), repr(prior), str(dataclasses.asdict(settings(server.url))), written]
    assert not any(KEY in text for text in everything)


def test_without_a_key_none_is_sent(frame, labels) -> None:
    with ChatServer(says(GOOD)) as server:
        asked(server, frame, labels, api_key_env="NO_SUCH_VARIABLE")
    assert "Authorization" not in server.headers[0]


def test_where_the_model_is_of_no_help_the_database_steps_in_and_says_so(clip) -> None:
    with ChatServer(status(404)) as server:
        named = material_prior(clip, settings(server.url, materials=["wood", "petal"]))
        unnamed = material_prior(clip, settings(server.url))
    assert named is not None
    assert unnamed is not None
    assert named.name == ("wood", "petal")
    assert unnamed.name == ("soft solid",)
    assert "HTTP status 404" in named.notes[0]
    assert "wood, petal" in named.notes[0]
    assert "for want of" in unnamed.source


def test_a_server_that_is_not_there_costs_a_note_and_not_the_run(clip, monkeypatch) -> None:
    with ChatServer(says(GOOD)) as server:
        gone = server.url
    prior = material_prior(clip, settings(gone, attempts=1))
    assert prior is not None
    assert "no connection" in prior.notes[0]


@pytest.mark.parametrize(
    ("changes", "says_so"),
    [({"base_url": None}, "prior.base_url is not set"), ({"model": None}, "prior.model is not set"), ({"base_url": "ftp://x"}, "must begin with https://")],
)
def test_settings_that_name_no_endpoint_are_refused(clip, changes: dict, says_so: str) -> None:
    with pytest.raises(InputError, match=says_so):
        material_prior(clip, settings("http://127.0.0.1:1/v1", **changes) if "base_url" not in changes else settings(changes["base_url"]))
