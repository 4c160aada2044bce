"""How sure is it? Stated standard deviations against truths that nobody chose.

    python benchmarks/calibration.py OUT --seeds 200-229        # choices are made on these
    python benchmarks/calibration.py OUT --confirm 60           # seeds that follow from the commit: run once
    python benchmarks/calibration.py OUT --confirm 60 --first   # their first answers alone, without any simulation
    python benchmarks/calibration.py OUT --seeds 300-304 --kinds hook,cord    # other bodies than the generator's, other starts
    python benchmarks/calibration.py OUT --seeds 202-221 --kinds colour,plain_depth,plain    # points against outlines
    python benchmarks/calibration.py OUT --seeds 202-211 --kinds nothing_colour,nothing_colour_mask,nothing_depth,nothing_depth_mask,clamp,thickness,mass,told    # what each thing that is told buys
    python benchmarks/calibration.py --record OUT...            # rows into benchmarks/results, table and figure into docs
    python benchmarks/calibration.py --tables | --check         # from the stored rows; exit 1 where a table is not theirs

A run makes the clips of each seed (the generator of the folder that DIFFPHYS_SCENES names, MuJoCo), recovers them with `diffphys batch`
and scores them. It goes on where it was interrupted; --shard I/N runs a part of the seeds, and --record takes the folders of all
parts. Rows name the commit; they are recorded from a clean checkout of the same sources alone.
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

import calibration_known
from calibration_clips import KINDS, Maker, clips_of, confirmation_seeds, facts_of
from calibration_table import FREE, MATERIALS, draw, in_short, kinds_in, markdown, said, table
from clips import ROOT, batched, this_commit
from notes import RESULTS, refilled

from diffphys_ros.batch import read_status
from diffphys_ros.batch.key import program
from diffphys_ros.errors import InputError

CHOICE, CONFIRMATION, FIRST, OTHER_KINDS, EVIDENCE, KNOWN = "choice", "confirmation", "first", "kinds", "evidence", "known"
SETS = (CHOICE, CONFIRMATION, FIRST, OTHER_KINDS, EVIDENCE, KNOWN)
OF_COMMITS = (CONFIRMATION, FIRST)  # sets whose seeds follow from a commit
NOT_SIMULATED = ("--experiment.schedule", "linear")  # words for the batch, of first answers
ABOUT = "run.json"  # in OUT: which seeds, and of which commit
NAMED = (*FREE, "never_free", "held_out")  # kinds whose rows make the table of the generator's own scenes
OF_EVIDENCE = ("colour", "plain_depth", "plain")  # kinds whose rows tell kinds of evidence apart, beside those of the same seeds with texture and depth
OF_KNOWLEDGE = ("nothing_colour", "nothing_colour_mask", "nothing_depth", "nothing_depth_mask", "clamp", "thickness")  # kinds that are told less
BESIDE = {EVIDENCE: ("told",), KNOWN: ("mass", "told")}  # kinds of the choice whose rows, of the same seeds, stand beside those of a set
PAGE, IN_SHORT = ROOT / "docs" / "measurements" / "calibration.md", ROOT / "docs" / "how_sure.md"  # all figures, and those that say most
FIGURES = ROOT / "docs" / "figures"


def run(options: argparse.Namespace) -> int:
    """Makes and recovers the clips of a shard; returns the exit status of the batch."""
    commit = options.commit or _full(this_commit(dirty=True).rstrip("+"))
    seeds = confirmation_seeds(commit, options.confirm) if options.confirm else _seeds(options.seeds)
    out: Path = options.out[0]
    out.mkdir(parents=True, exist_ok=True)
    about = {"set": (FIRST if options.first else CONFIRMATION) if options.confirm else CHOICE, "commit": commit, "seeds": seeds}
    if (out / ABOUT).exists() and json.loads((out / ABOUT).read_text())["seeds"] != seeds:
        raise InputError(f"{out}: holds a run of other seeds; give another folder")
    (out / ABOUT).write_text(json.dumps(about))
    first, count = options.shard
    kinds = [KINDS[name].quick if options.quick else KINDS[name] for name in options.kinds.split(",")]
    jobs = len(os.sched_getaffinity(0))
    clips = clips_of(seeds[first - 1 :: count], kinds, out, Maker(_generator(options.generator), options.mujoco), jobs)
    print(f"{len(clips)} clips of {len(seeds[first - 1 :: count])} seeds", flush=True)
    if options.make_only:
        return 0
    return batched(clips, out / "results", [*(NOT_SIMULATED if options.first else ()), *options.batch])


def rows_of(out: Path, sources: str, *, clean: bool = True) -> tuple[str, list[dict[str, Any]]]:
    """Name of the set, and a row for every clip of a run. Raises InputError for other sources, seeds that nobody may choose, unfinished runs."""
    about = json.loads((out / ABOUT).read_text())
    if clean and about["set"] in OF_COMMITS and about["seeds"] != confirmation_seeds(_full(about["commit"]), len(about["seeds"])):
        raise InputError(f"{out}: its seeds are not those of commit {about['commit'][:7]}")
    rows = []
    for folder in sorted((out / "results").glob("g*-*")):
        status = read_status(folder)
        name = re.sub(r"-[0-9a-f]{8}$", "", folder.name)
        if status is None or status.state in ("running", "interrupted") or (status.state == "done" and not status.scored):
            raise InputError(f"{folder}: has not ended, or was not scored; run the same command again")
        if clean and status.version != sources:
            raise InputError(f"{folder}: was recovered by other sources than this checkout's; run it again")
        measured = {"state": status.state, "reason": status.reason, "seconds": status.seconds, "processor_s": status.processor_s}
        origin = {"device": status.device, "versions": status.versions, "commit": about["commit"][:7]}
        rows.append({"name": name, **facts_of(out / "clips" / name), **measured, **status.figures, **origin})
    return about["set"], rows


def record(folders: Sequence[Path], *, dirty: bool) -> None:
    """Rows of the runs, in place of those of the same clips."""
    this_commit(dirty=dirty)
    found: dict[str, list[dict[str, Any]]] = {}
    for folder in folders:
        name, rows = rows_of(folder, program(), clean=not dirty)
        for row in rows:
            found.setdefault(_set_of(row["kind"]) if name == CHOICE else name, []).append(row)
    for name, made in found.items():
        rows = _merged(name, made)
        _path(name).write_text(json.dumps(sorted(rows, key=lambda row: row["name"]), indent=1) + "\n")
        if name not in (OTHER_KINDS, EVIDENCE, KNOWN):
            draw(rows, [kind for kind in kinds_in(rows) if kind in FREE], FIGURES / f"calibration_{name}.png")


def _set_of(kind: str) -> str:
    """Of rows of chosen seeds."""
    return CHOICE if kind in NAMED else EVIDENCE if kind in OF_EVIDENCE else KNOWN if kind in OF_KNOWLEDGE else OTHER_KINDS


def _merged(name: str, made: list[dict[str, Any]]) -> list[dict[str, Any]]:
    before = json.loads(_path(name).read_text()) if _path(name).exists() and name not in OF_COMMITS else []
    return list(({row["name"]: row for row in before} | {row["name"]: row for row in made}).values())


def filled(text: str) -> str:
    """A page with its tables made from the stored rows: a set's `<!-- calibration NAME -->`, and `<!-- calibration NAME in short -->`."""
    for name in _stored():
        for mark, tables in ((name, _known if name == KNOWN else _tables), (f"{name} in short", _in_short)):
            begin, end = _marks(mark)
            text = re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _, name=name, tables=tables, begin=begin, end=end: f"{begin}\n{tables(_shown(name))}\n{end}", text, flags=re.S)
    return text


def _check_places() -> None:
    """Raises InputError where a set of rows has no table in any page."""
    pages = "".join(page.read_text() for page in (PAGE, IN_SHORT))
    for name in _stored():
        begin, end = _marks(name)
        if not re.search(f"{re.escape(begin)}.*?{re.escape(end)}", pages, flags=re.S):
            raise InputError(f"{PAGE.name}, {IN_SHORT.name}: have no place {begin} ... {end}; put one where the rows of {name} belong")


def _marks(name: str) -> tuple[str, str]:
    """Between which a table stands."""
    return f"<!-- calibration {name} -->", f"<!-- end calibration {name} -->"


def _stored() -> list[str]:
    """Sets that have rows."""
    return [name for name in SETS if _path(name).exists()]


def _shown(name: str) -> list[dict[str, Any]]:
    """The stored rows of a set, beside those of BESIDE on the same seeds."""
    rows: list[dict[str, Any]] = json.loads(_path(name).read_text())
    if name in BESIDE and _path(CHOICE).exists():
        seeds = {row["seed"] for row in rows}
        rows += [row for row in json.loads(_path(CHOICE).read_text()) if row["kind"] in BESIDE[name] and row["seed"] in seeds]
    return rows


def _known(rows: list[dict[str, Any]]) -> str:
    kinds = [kind for kind in (*OF_KNOWLEDGE, *BESIDE[KNOWN]) if kind in kinds_in(rows)]
    return _with_origin(calibration_known.table(rows, kinds), rows)


def _in_short(rows: list[dict[str, Any]]) -> str:
    return _with_origin(in_short(rows, kinds_in(rows)), rows)


def _tables(rows: list[dict[str, Any]]) -> str:
    kinds = kinds_in(rows)
    if set(kinds) <= set(KINDS) - {*NAMED, *OF_EVIDENCE}:
        return _with_origin(table(rows, kinds), rows)
    apart = [f"<details><summary>Clips of {words}</summary>\n\n{markdown(table(rows, kinds, n))}\n\n</details>" for n, words in MATERIALS.items() if any(row["materials"] == n for row in rows)]
    return _with_origin(table(rows, kinds), rows, *apart)


def _with_origin(lines: Sequence[Sequence[str]], rows: list[dict[str, Any]], *more: str) -> str:
    """A table, more of them, and what they were measured on."""
    return "\n\n".join([markdown(lines), *more, said(rows)])


def _path(name: str) -> Path:
    return RESULTS / f"calibration-{name}.json"


def _full(commit: str) -> str:
    done = subprocess.run(["git", "rev-parse", "--verify", f"{commit}^{{commit}}"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"commit {commit[:40]}: git does not know it here; give --commit where there is no repository")
    return done.stdout.strip()


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal()):
        raise InputError(f"--seeds is {text[:40]!r}, must be FIRST-LAST, such as 200-229")
    return list(range(int(first), int(last or first) + 1))


def _generator(given: Path | None) -> Path:
    folder = given or Path(os.environ.get("DIFFPHYS_SCENES", "")) / "generator"
    if not (folder / "make_scene.py").exists():
        raise InputError(f"{folder}: holds no make_scene.py; name the scenes' folder in DIFFPHYS_SCENES, or give --generator")
    return folder


def _shard(text: str) -> tuple[int, int]:
    first, _, count = text.partition("/")
    return int(first), int(count)


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="*", type=Path)
    parser.add_argument("--seeds", help="FIRST-LAST")
    parser.add_argument("--confirm", type=int, metavar="N", help="N seeds that follow from the commit")
    parser.add_argument("--first", action="store_true", help="with --confirm: first answers alone, without any simulation")
    parser.add_argument("--commit", help="its full name, where there is no repository")
    parser.add_argument("--kinds", default=",".join(FREE), help=f"of {', '.join(KINDS)}")
    parser.add_argument("--quick", action="store_true", help="of the generator's coarser mesh: scenes in a third of the time")
    parser.add_argument("--shard", type=_shard, default=(1, 1), metavar="I/N")
    parser.add_argument("--generator", type=Path, help="folder of make_scene.py and degrade.py")
    parser.add_argument("--mujoco", default=sys.executable, metavar="PYTHON", help="a Python that has MuJoCo")
    parser.add_argument("--make_only", action="store_true", help="make the clips, recover none")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--dirty", action="store_true", help="record although files or sources differ")
    parser.add_argument("--tables", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--batch", nargs=argparse.REMAINDER, default=[], help="further words for diffphys batch; last")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str]) -> int:
    """Runs, records or writes; returns the exit status."""
    options = _options(arguments)
    try:
        if options.record:
            record(options.out, dirty=options.dirty)
        elif not (options.tables or options.check):
            if len(options.out) != 1 or bool(options.seeds) == bool(options.confirm):
                raise InputError("give one folder, and --seeds or --confirm")
            if options.first and not options.confirm:
                raise InputError("--first goes with --confirm, not with --seeds")
            return run(options)
        _check_places()
    except InputError as error:
        print(f"calibration: {error}", file=sys.stderr)
        return 2
    return refilled([PAGE, IN_SHORT], filled, check=options.check)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
