"""How right recoveries are: rows and tables from batches with known truths.

    diffphys batch CLIPS... --out DIR             # a folder a clip, each with its score
    python benchmarks/clips.py DIR... [--dirty]   # rows into benchmarks/results/clips-DEVICE.json, tables into README.md and docs
    python benchmarks/clips.py --tables           # the tables alone, from the rows that are stored
    python benchmarks/clips.py --check            # exit 1 where a table is not that of its rows

A table stands between `<!-- clips-DEVICE -->` and `<!-- end clips-DEVICE -->`; clips-DEVICE names the file of its rows. A row
names the commit that made it: rows are taken from a clean checkout alone (--dirty: from any, and says so), and a clip that was
recovered by other sources than this checkout's is refused.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from notes import refilled

from diffphys_ros.batch import Status, read_status
from diffphys_ros.batch.key import program
from diffphys_ros.batch.summary import number
from diffphys_ros.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
HEAD = ("clip", "young", "force cosine", "false force", "trajectory", "PSNR (frozen frame)", "processor time")
SOURCE = ("device", "versions", "commit")

Row = dict[str, Any]


def batched(clips: Sequence[Path], out: Path, words: Sequence[str]) -> int:
    """Runs this checkout's `diffphys batch` on clips, or goes on with it; returns its exit status. `words`: more of the command's."""
    command = [sys.executable, "-m", "diffphys_ros", "batch", *map(str, clips), "--out", str(out), "--resume", *words]
    here = {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    return subprocess.run(command, env=os.environ | here, check=False).returncode


def rows_of(folder: Path, commit: str, sources: str) -> list[Row]:
    """A row for each clip of a batch that was scored. Raises InputError for clips of other sources, and where none was scored."""
    found = {path.parent.name: read_status(path.parent) for path in sorted(folder.glob("*/status.json"))}
    scored = {name: s for name, s in found.items() if s is not None and s.state == "done" and s.scored}
    if not scored:
        raise InputError(f"{folder}: holds no clip that is done and scored; run diffphys batch over clips with a truth.npz beside them")
    foreign = [name for name, s in scored.items() if s.version != sources]
    if foreign:
        raise InputError(f"{folder}: {len(foreign)} clips, {foreign[0]} first, were recovered by other sources than this checkout's; run the batch again")
    readable = [re.sub(r"-[0-9a-f]{8}$", "", name) for name in scored]
    names = [short if readable.count(short) == 1 else name for short, name in zip(readable, scored, strict=True)]
    return [_row(name, status, commit) for name, status in zip(names, scored.values(), strict=True)]


def _row(name: str, status: Status, commit: str) -> Row:
    measured = {"seconds": status.seconds, "processor_s": status.processor_s, "memory_mb": status.memory_mb}
    return {"name": name, **status.figures, **measured, "device": status.device, "versions": status.versions, "commit": commit}


def record(rows: list[Row], results: Path = RESULTS) -> list[Path]:
    """Put rows into their devices' files in place of older ones of the same name; returns the files."""
    paths = []
    for device in sorted({row["device"] for row in rows}):
        path = results / f"clips-{re.sub(r'[^a-z0-9]+', '-', device.lower()).strip('-') or 'unknown'}.json"
        known = {row["name"]: row for row in stored(path)} | {row["name"]: row for row in rows if row["device"] == device}
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps([known[name] for name in sorted(known)], indent=1) + "\n")
        paths.append(path)
    return paths


def stored(path: Path) -> list[Row]:
    """The rows of a file; none where there is no file."""
    return json.loads(path.read_text()) if path.exists() else []


def table(rows: list[Row]) -> str:
    """The table for people, and below it what it was measured on."""
    lines = [HEAD, ("---",) * len(HEAD), *(_cells(row) for row in rows)]
    said = sorted({tuple(row[name] for name in SOURCE) for row in rows})
    below = "; ".join(f"{device}, {versions}, commit {commit}" for device, versions, commit in said)
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + f"\n\n{below}"


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row["name"],
        ", ".join(number(e, "+.3f") for e in row.get("young_log10_error") or []) or "-",
        number(row.get("net_force_cosine"), ".3f"),
        number(row.get("false_force_ratio"), ".1%"),
        number(row.get("trajectory_rmse_over_rms_motion"), ".3f"),
        f"{number(row.get('psnr_masked'), '.1f')} ({number(row.get('psnr_masked_frozen_frame'), '.1f')}) dB",
        f"{number(row.get('processor_s'), '.0f')} s",
    )


def filled(text: str, results: Path = RESULTS) -> str:
    """A document with each of its tables made from the stored rows."""
    for path in sorted(results.glob("clips-*.json")):
        begin, end = f"<!-- {path.stem} -->", f"<!-- end {path.stem} -->"
        made = f"{begin}\n{table(stored(path))}\n{end}"
        text = re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _, made=made: made, text, flags=re.S)
    return text


def documents() -> list[Path]:
    """Where tables may stand."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def this_commit(*, dirty: bool, root: Path = ROOT) -> str:
    """Short name of the checkout's commit, with a + where files differ from it. Raises InputError where they do and `dirty` is not set."""
    name, changed = (_git(root, *words) for words in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain")))
    if changed and not dirty:
        raise InputError(f"{root}: {len(changed.splitlines())} files differ from commit {name}; commit them first, or mark the rows with --dirty")
    return name + ("+" if changed else "")


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"{root}: git says {done.stderr.strip()[:160]!r}; rows are taken in a clone of the repository")
    return done.stdout.strip()


def main(arguments: list[str] | None = None) -> int:
    """Takes rows and writes tables; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("batches", nargs="*", type=Path, help="folders that diffphys batch wrote")
    parser.add_argument("--dirty", action="store_true", help="take rows although files differ from the commit; they say so")
    parser.add_argument("--tables", action="store_true", help="write the tables alone")
    parser.add_argument("--check", action="store_true", help="only say whether the tables are those of the rows")
    options = parser.parse_args(arguments)
    if not (options.batches or options.tables or options.check):
        parser.error("give folders that diffphys batch wrote, or --tables, or --check")
    try:
        if options.batches:
            commit = this_commit(dirty=options.dirty)
            rows = [row for folder in options.batches for row in rows_of(folder, commit, program())]
            print(*record(rows), table(rows), sep="\n")
    except InputError as error:
        print(f"clips: {error}", file=sys.stderr)
        return 2
    return refilled(documents(), filled, check=options.check)


if __name__ == "__main__":
    sys.exit(main())
