"""Which of the first engine's numbers decide anything: each halved and doubled on prepared clips, one at a time.

    diffphys ingest CLIP --config given.yaml --out NAME.npz     # for each clip
    python benchmarks/sensitivity.py NAME.npz... FOLDER... [--truth NAME=truth.npz] [--jobs N] [--only NUMBER...] [--record [--dirty]]

Stiffness and force are computed anew from a clip's tracks and body (benchmarks/first_answer.py), as is and with each number of LISTED
(benchmarks/deciding.py) multiplied, in a process each, which needs 0.5 GB; one that crashes or takes longer than TIMEOUT_S is an outcome as well.
Numbers that act on plain objects alone are multiplied on folders of clip.mcap and given.yaml (benchmarks/painted.py), whose masks and tracks are made
anew each time.
--record keeps the rows in benchmarks/results/sensitivity.json and writes the tables of docs/measurements/sensitivity.md.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from clips import this_commit
from deciding import Number, numbers
from notes import NOTES, RESULTS, clips_of, effects, filled

from diffphys_ros import config, result, score
from diffphys_ros.batch.machine import device_name, versions
from diffphys_ros.errors import InputError, shown
from diffphys_ros.inverse.material_prior import of_parts

ROOT = Path(__file__).resolve().parent.parent
ROWS = RESULTS / "sensitivity.json"
FACTORS = {"halved": 0.5, "doubled": 2.0}
TIMEOUT_S = 120.0
FAILED = "failed"  # name of the reason in an answer that there is none

Answer = dict[str, Any]
Row = dict[str, Any]
Asked = tuple[str, Number | None, float]  # clip, number, factor


def told_of(path: Path) -> dict[str, Any]:
    """What the first engine is told of a prepared clip, or of a folder's recording. Raises InputError."""
    if path.is_dir():
        return {"recording": path / "clip.mcap", "settings": config.layered([path / "given.yaml"])}
    prepared, settings = result.load_prepared(path), config.layered(base=result.stored_settings(path))
    belief = None if prepared.prior is None else of_parts(prepared.prior, prepared.body, prepared.clip.camera)
    return {
        "body": prepared.body,
        "tracks": prepared.tracks,
        "period_s": prepared.clip.period_s,
        "settings": settings,
        "camera": prepared.clip.camera,
        "belief": belief,
    }


def answered(told: Path, number: Number | None, factor: float, timeout_s: float = TIMEOUT_S) -> Answer:
    """The answer of a process of its own to a pickle of `told_of`; with nothing but FAILED in it where that crashed or took too long."""
    words = [] if number is None else [number.module, number.path, str(factor)]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    command = [sys.executable, str(ROOT / "benchmarks" / "first_answer.py"), str(told), *words]
    environment = os.environ | threads | {"PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, env=environment, check=False)
    except subprocess.TimeoutExpired:
        return {FAILED: f"no answer within {timeout_s:g} s"}
    if done.returncode:
        return {FAILED: (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1][:80]}
    return json.loads(done.stdout.splitlines()[-1])


def change(before: Answer, after: Answer, truth: np.ndarray | None) -> dict[str, Any]:
    """What became of an answer: largest change of log10 E of a part that is identified in either, flags, forced frames and doubts that changed,
    rms change of the net force over its rms, change of the stated deviations, and with a truth (log10 E by part) the largest error of an identified
    part, before and after."""
    if FAILED in after:
        return {FAILED: after[FAILED]}
    flags = [np.array(a["identified"]) for a in (before, after)]
    told = flags[0] | flags[1]
    moved = np.abs(np.subtract(after["log10_young"], before["log10_young"]))[told]
    wider = np.abs(np.log(np.divide(after["sd"], before["sd"])))[told]
    force = [np.array(a["net_force_n"]) for a in (before, after)]
    return {
        "young": round(float(moved.max(initial=0.0)), 4),
        "sd": round(float(np.expm1(wider.max(initial=0.0))), 4),
        "flags": int((flags[0] != flags[1]).sum()),
        "frames": after["forced"] - before["forced"],
        "doubts": len(set(before["doubts"]) ^ set(after["doubts"])),
        "force": round(float(np.linalg.norm(force[1] - force[0]) / max(np.linalg.norm(force[0]), 1e-300)), 4) if force[0].any() else float(force[1].any()),
        **({} if truth is None else {"error": [error(a, truth) for a in (before, after)]}),
    }


def error(answer: Answer, truth: np.ndarray) -> float | None:
    """Largest |log10 of found over true E| of the identified parts; None where none is."""
    told = np.array(answer["identified"])
    return round(float(np.abs(np.array(answer["log10_young"]) - truth)[told].max()), 4) if told.any() else None


def measured(clips: dict[str, dict[str, Any]], chosen: Sequence[Number], truths: dict[str, np.ndarray], jobs: int) -> list[Row]:
    """A row for each number, without what it was measured on. Raises InputError where a clip has no answer as it is, or another number of
    parts than its truth."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        paths = {name: Path(folder) / f"{place}.pickle" for place, name in enumerate(clips)}
        for name, told in clips.items():
            paths[name].write_bytes(pickle.dumps(told))
        base = _all(pool, paths, [(clip, None, 1.0) for clip in clips])
        before = {clip: _sound(clip, base[clip, None, 1.0], truths.get(clip)) for clip in clips}
        suited = {n: [clip for clip, told in clips.items() if ("recording" in told) == n.of_plain] for n in chosen}
        asked = [(clip, n, factor) for n in chosen for factor in FACTORS.values() if _differs(n, factor) for clip in suited[n]]
        after = _all(pool, paths, asked)
    return [
        _row(n, {word: {c: change(before[c], after[c, n, factor], truths.get(c)) for c in clips if (c, n, factor) in after} for word, factor in FACTORS.items()})
        for n in chosen
    ]


def _all(pool: ThreadPoolExecutor, paths: dict[str, Path], asked: Iterable[Asked]) -> dict[Asked, Answer]:
    """The answers; each is told of as it comes."""
    running = {pool.submit(answered, paths[one[0]], *one[1:]): one for one in asked}
    found = {}
    for done in as_completed(running):
        one = running[done]
        found[one] = done.result()
        print(f"{len(found)}/{len(running)} {one[0]} {one[1] or 'as is'} x{one[2]:g}: {_said(found[one])}", file=sys.stderr)
    return found


def _said(answer: Answer) -> str:
    if FAILED in answer:
        return str(answer[FAILED])
    young = ", ".join(f"{e:.3f}{'' if known else '?'}" for e, known in zip(answer["log10_young"], answer["identified"], strict=True))
    return f"log10 E = {young}; {answer['forced']} forced frames"


def _sound(clip: str, answer: Answer, truth: np.ndarray | None) -> Answer:
    if FAILED in answer:
        raise InputError(f"clip {clip}: has no answer with the numbers as they are ({answer[FAILED]}); prepare it again or leave it out")
    if truth is not None and len(truth) != len(answer["log10_young"]):
        raise InputError(f"clip {clip}: has {len(answer['log10_young'])} parts, its truth {len(truth)}; give the truth of this clip")
    return answer


def _differs(number: Number, factor: float) -> bool:
    """False for a share at its bound, and for a one that is halved."""
    value = number.value()
    return number.once(value, factor) != value


def _row(number: Number, found: dict[str, dict[str, Any]]) -> Row:
    value = number.value()
    values = {word: number.once(value, factor) for word, factor in FACTORS.items()}
    return {"name": str(number), "value": value, "what": number.comment(), "source": number.source()} | {word: {"value": values[word], "clips": found[word]} for word in FACTORS}


def record(rows: list[Row], *, dirty: bool) -> None:
    """Keep the rows in place of older ones of the same numbers, without those of numbers that are listed no more or that act where the new ones do and
    were changed on other clips, and fill the page."""
    about = {"device": device_name("cpu"), "versions": versions(), "commit": this_commit(dirty=dirty)}
    plain = {str(n): n.of_plain for n in numbers()}
    clips = {kind: set().union(*(clips_of(row) for row in rows if plain[row["name"]] == kind)) for kind in (False, True)}
    older = [row for row in json.loads(ROWS.read_text()) if row["name"] in plain] if ROWS.exists() else []
    known = {row["name"]: row for row in older if clips[plain[row["name"]]] in (set(), clips_of(row))}
    known |= {row["name"]: row | about for row in rows}
    for number in numbers():
        known.get(str(number), {}).update(what=number.comment(), source=number.source())
    ROWS.write_text(json.dumps([known[str(n)] for n in numbers() if str(n) in known], indent=1) + "\n")
    page = NOTES / "sensitivity.md"
    page.write_text(filled(page.read_text()))


def _chosen(words: list[str]) -> list[Number]:
    """Numbers whose names hold one of the words; all for none. Raises InputError."""
    unknown = [word for word in words if not any(word in str(n) for n in numbers())]
    if unknown:
        raise InputError(f"--only {shown(unknown[0])}: no listed number is called so; benchmarks/deciding.py holds the list")
    return [n for n in numbers() if not words or any(word in str(n) for word in words)]


def _truths(pairs: list[str], clips: Iterable[str]) -> dict[str, np.ndarray]:
    """log10 E by part of NAME=truth.npz. Raises InputError."""
    found = {}
    for pair in pairs:
        name, _, path = pair.partition("=")
        if name not in clips or not path:
            raise InputError(f"--truth {shown(pair)}: must be NAME=truth.npz, where NAME.npz is one of the clips")
        found[name] = np.log10(score.read_truth(path)["part_E"])
    return found


def main() -> int:
    """Measures, prints the table and keeps it where that is asked for; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="+", type=Path, help="that diffphys ingest prepared, or folders of recordings; a clip is called as its file or folder")
    parser.add_argument("--truth", action="append", default=[], metavar="NAME=TRUTH", help="what is known of a clip")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="processes at once; all cores where left out")
    parser.add_argument("--only", nargs="+", default=[], metavar="NUMBER", help="those whose names hold a word")
    parser.add_argument("--record", action="store_true", help="keep the rows and write the page")
    parser.add_argument("--dirty", action="store_true", help="record although files differ from the commit; the rows say so")
    options = parser.parse_args()
    try:
        chosen, names = _chosen(options.only), [path.stem for path in options.clips]
        if len(set(names)) < len(names):
            raise InputError("clips: two are called alike; give their files different names")
        truths = _truths(options.truth, names)
        if options.record:
            this_commit(dirty=options.dirty)
        rows = measured({path.stem: told_of(path) for path in options.clips}, chosen, truths, max(1, options.jobs))
        if options.record:
            record(rows, dirty=options.dirty)
    except InputError as problem:
        print(f"sensitivity: {problem}", file=sys.stderr)
        return 2
    print(*(" | ".join(line) for line in effects(rows)), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
