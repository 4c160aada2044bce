"""Answers, cached answers and files that are meant to harm are refused quickly, with a sentence or by asking anew."""

from __future__ import annotations

import json
import os
import time

import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.prior.cache import LARGEST_FILE, Cache
from diffphys_ros.prior.prompt import records_of
from diffphys_ros.prior.records import of_person
from diffphys_ros.prior.written import read_records

from .conftest import GOOD, STEM


@pytest.mark.parametrize("answer", ["```" + "a" * 400_000 + " " * 400_000, "```" * 200_000, "```" + " " * 10**6, "`" * 10**6, "```a```" * 100_000])
def test_fences_are_found_in_time_that_grows_with_the_answer_alone(answer: str) -> None:
    began = time.process_time()
    with pytest.raises(InputError, match="not valid JSON"):
        records_of(answer, parts=1)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize("answer", ["1" * 5000, f'[{{"E": {"9" * 4000}}}]', '[{"name": "a\\nb"}]', '[{"name": "\\ud800"}]', "[" * 500_000, json.dumps([{**STEM, "name": "x" * 10**5}]), json.dumps([{**STEM, "E": "2e6"}])])
def test_an_answer_that_is_meant_to_harm_is_refused_in_a_line(answer: str) -> None:
    with pytest.raises(InputError) as caught:
        records_of(answer, parts=1)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("text", ["[" * 100_000, '{"answer": 3}', "1" * 5000, "\ud800", '{"answer": "' + "a" * LARGEST_FILE + '"}'])
def test_a_poisoned_cached_answer_is_none(tmp_path, text: str) -> None:
    (tmp_path / "key.json").write_bytes(text.encode("utf-8", "surrogatepass"))
    assert Cache(tmp_path).get("key") is None


def test_a_cached_answer_that_is_a_pipe_is_not_waited_for_and_the_longest_one_is_read(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    assert Cache(tmp_path).get("pipe") is None
    Cache(tmp_path).put("long", "\0" * (1 << 20))
    assert Cache(tmp_path).get("long") == "\0" * (1 << 20)
    Cache(tmp_path).put("good", GOOD)
    assert Cache(tmp_path).get("good") == GOOD


def test_keys_of_several_kinds_are_refused() -> None:
    with pytest.raises(InputError, match="unknown key 1"):
        of_person({1: 2, "a": 3}, "entry 1", parts=1)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("parts: [{1: 2, a: 3}]", "unknown key '1'"),
        ("parts: [{material: wood}]\nparts: [{material: rubber}]", "'parts' stands twice"),
        ("parts: [{material: wood, E: 1:30}]", "E is '1:30', must be a number"),
        ("parts: [{material: wood, rho: 0900}]", "rho is '0900', must be a number"),
        ("parts: [&a {material: wood}, *a]", "anchors and aliases"),
        ("parts: " + "[" * 3000, "nested deeper"),
        ("parts: [" + "{material: wood}," * 300 + "]", "1 to 254 entries"),
        ('parts: [{material: "wo\\0od"}]', "printable characters"),
        ("parts: [{material: " + "x" * 5000 + "}]", "must be text of 1 to 80"),
    ],
)
def test_a_file_that_is_meant_to_harm_is_refused_in_a_line(tmp_path, text: str, told: str) -> None:
    path = tmp_path / "materials.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_records(path, parts=2)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


def test_a_file_that_is_a_pipe_is_not_waited_for(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(InputError, match="is no regular file"):
        read_records(tmp_path / "pipe.yaml", parts=1)
