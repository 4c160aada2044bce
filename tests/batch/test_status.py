"""Claims about status.json, the summary, the lock and the words of a batch."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from diffphys_ros.batch import Status, parse_shard, positive, read_status
from diffphys_ros.batch.lock import owned
from diffphys_ros.batch.status import write_status
from diffphys_ros.batch.summary import as_csv, as_markdown
from diffphys_ros.errors import InputError

DONE = Status(
    state="done",
    seconds=61.0,
    scored="a",
    figures={"identified": [True, False], "young_pa": [1e5, None], "log10_young_sd": [0.02, None], "young_log10_error": [-0.01, None], "net_force_cosine": 0.99},
)


def test_a_status_comes_back_from_its_file(tmp_path: Path) -> None:
    write_status(tmp_path, DONE)
    assert read_status(tmp_path) == DONE


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"state": "odd"}', '{"state": ["done"]}', '{"state": "done", "hash": 3}', "[" * 10000, '{"state": "done", "figures": 1}', "\xff"])
def test_a_damaged_status_counts_for_nothing(text: str, tmp_path: Path) -> None:
    (tmp_path / "status.json").write_bytes(text.encode("latin-1"))
    assert read_status(tmp_path) is None


def test_the_summary_has_a_line_for_each_clip_and_a_column_for_each_part() -> None:
    rows = [("a", "/a.mcap", DONE), ("b", "/b, c.mcap", Status(state="failed", reason='no "clip", at all'))]
    table = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert [row["clip"] for row in table] == ["a", "b"]
    assert (table[0]["young_pa_1"], table[0]["young_pa_2"], table[0]["identified_2"], table[0]["young_log10_error_1"]) == ("100000", "", "False", "-0.01")
    assert (table[1]["path"], table[1]["reason"], table[1]["young_pa_1"]) == ("/b, c.mcap", 'no "clip", at all', "")


def test_the_table_for_people_counts_states_and_gives_medians() -> None:
    text = as_markdown([("a", "", DONE), ("b", "", DONE), ("c", "", Status(state="timed_out", reason="a | b"))])
    assert text.startswith("# 3 clips: 2 done, 1 timed out")
    assert "not identified" in text
    assert "| force cosine | 0.990 | 0.990 |" in text
    assert "of 4 parts 2 were identified" in text
    assert "a \\| b" in text


def test_one_batch_owns_a_folder(tmp_path: Path) -> None:
    with owned(tmp_path, None), pytest.raises(InputError, match="another batch is at work in it"), owned(tmp_path, None):
        pass
    with owned(tmp_path, None):
        pass


def test_shards_of_one_division_share_a_folder(tmp_path: Path) -> None:
    with owned(tmp_path, (1, 2)), owned(tmp_path, (2, 2)):
        for shard in ((1, 2), (1, 3), None):
            with pytest.raises(InputError, match="another batch"), owned(tmp_path, shard):
                pass
    with owned(tmp_path, (1, 3)):
        pass


@pytest.mark.parametrize("text", ["", "0/2", "3/2", "1", "1/2/3", "a/b", "-1/2", "1/" + "9" * 40, "¹/2"])
def test_a_shard_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--shard"):
        parse_shard(text)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "1e400", "x", "1.5", "9" * 5000])
def test_a_number_of_workers_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--workers") as refused:
        positive("workers", text, int)
    assert len(str(refused.value)) < 200
