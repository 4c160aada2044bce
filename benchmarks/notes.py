"""Tables of measured figures: from the rows that benchmarks stored to docs/measurements.

    python benchmarks/notes.py           # writes the tables
    python benchmarks/notes.py --check   # exit 1 where a table is not that of its rows

A table stands between `<!-- rows NAME -->` and `<!-- end rows NAME -->`, where NAME is one of TABLES. Below it stands what it was measured
on. Rows come from `make bench`, `make accuracy` and `python benchmarks/front_end.py SCENE... --record NAME`.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
RESULTS, NOTES = ROOT / "benchmarks" / "results", ROOT / "docs" / "measurements"
PROCESSOR, ONE_CORE, GPU = "intel-r-xeon-r-processor", "intel-r-xeon-r-processor-one-core", "nvidia-h200"
ACCURACY = "amd-epyc"  # whose processor `make accuracy` ran on

KINDS = {"bend_z": "bending across z", "bend_y": "across y", "twist": "twisting", "stretch": "stretching"}
SCENES = {"clean": "three scenes", "degraded": "*degraded*", "generated": "ten generated", "generated_degraded": "*degraded*"}
STAGES = {"masks": "masks", "parts": "parts", "depth": "depth", "tracks": "tracks", "body": "body", "splats": "Gaussians", "motion": "masks from motion"}
FRONT_END = {  # what, and the rows' names with their formats
    "masks, IoU least / mean over frames": "iou_min:.3f iou_mean:.3f",
    "from motion alone": "motion_iou_min:.3f motion_iou_mean:.3f",
    "parts by colour: too many or too few / least IoU": "parts_wrong:.0f parts_iou_min:.3f",
    "depth of frame 0, median / 90 % [mm]": "depth_median_mm:.2f depth_p90_mm:.2f",
    "tracks": "tracks:.0f",
    "of the frames in which they hold [%]": "valid_pct:.0f",
    "error of a displacement [mm]": "track_mm:.3f",
    "common / own part [mm]": "common_mm:.3f own_mm:.3f",
    "along the line of sight [mm]": "sight_mm:.2f",
    "as the tracks claim [mm]": "claimed_mm:.2f",
    "error over claim of single positions: across / along": "z_across:.2f z_sight:.2f",
    "worst tenth of that: across / along": "tenth_across:.1f tenth_sight:.1f",
    "share of the motion [%]": "track_pct:.1f",
    "volume of the body over the truth [%]": "volume_pct:+.2f",
    "particles": "particles:.0f",
    "Gaussians": "gaussians:.0f",
    "their PSNR in frame 0 [dB]": "frame0_db:.1f",
}
SUBSTEPS = {  # case: the file of its rows, their unit, their name, whether frames of a rollout are told apart
    "1,335 particles, 32^3, one CPU core": (ONE_CORE, "ms", "cpu_1335_32"),
    "1,335, 64^3": (GPU, "us", "single_1335_64"),
    "128 of them in a batch, each": (GPU, "us", "batch128_1335_64"),
    "20,000, 64^3": (GPU, "us", "20k_64"),
    "100,000, 64^3": (GPU, "us", "100k_64"),
    "100,000, 128^3": (GPU, "us", "100k_128"),
}
PICTURES = {f"{size} px, {count}": f"raster_{count}_{size}" for size in ("480x360", "1024x576") for count in ("5k", "20k", "100k")} | {
    "1024x576 px, 20k, colours of degree 3": "raster_20k_1024x576_sh3"
}

CHANGED = ("halved", "doubled")
SHOWN = 0.1  # of what counts is said as well
DECIDING = {  # change of an answer: from where it counts, and its words
    "young": (0.01, "log10 E by {:.3f}"), "sd": (0.1, "its sd by {:.0%}"), "flags": (1, "identified flips {:d} times"), "frames": (1, "{:d} forced frames"), "doubts": (1, "{:d} doubts"), "force": (0.05, "force by {:.0%}")
}  # fmt: skip

Lines = list[list[str]]
Row = dict[str, Any]


class Rows(dict[str, dict[str, Any]]):
    """The rows of a device by name; calling gives a figure as a cell, empty where there is none."""

    used: set[tuple[str, ...]]

    @classmethod
    def of(cls, name: str) -> Rows:
        """Those of a file of RESULTS."""
        rows = cls({row["name"]: row for row in json.loads((RESULTS / f"{name}.json").read_text())})
        rows.used = set()
        return rows

    def __call__(self, name: str, form: str = ".3g", unit: str = "") -> str:
        if name not in self:
            return ""
        self.used.add(tuple(self[name][key] for key in ("device", "versions", "commit")))
        return format(self[name]["value"], form) + (f" {unit}" if unit else "")


def joined(rows: Rows, prefix: str, figures: str) -> str:
    """Cells of the figures `name:format ...`, with slashes between them."""
    return " / ".join(rows(prefix + name, form) for name, form in (figure.split(":") for figure in figures.split()))


def beam(name: str, resolutions: tuple[float, ...]) -> tuple[Lines, list[Rows]]:
    """Ratios to Timoshenko's beam and the observed order between neighbours."""
    rows = Rows.of(ACCURACY)
    lines = [["", *(f"{cells:g} cells" for cells in resolutions), "observed order"]]
    for lay in ("plain", "fitted"):
        names = [f"timoshenko_{name}_{lay}_{cells:g}c" for cells in resolutions]
        off = [abs(rows[n]["value"] - 1) for n in names]
        orders = (math.log(a / b) / math.log(fine / coarse) for (a, b), (coarse, fine) in zip(pairwise(off), pairwise(resolutions), strict=True))
        lines.append([lay, *(rows(n, ".4f") for n in names), ", ".join(f"{order:.1f}" for order in orders)])
    return lines, [rows]


def by_kind(prefix: str, what: str, cases: Iterable[tuple[str, str]]) -> tuple[Lines, list[Rows]]:
    """Ratios to finite elements by kind of motion; `cases`: what stands in front, end of the rows' names."""
    rows = Rows.of(ACCURACY)
    return [[what, *KINDS.values()], *([said, *(rows(f"{prefix}_{kind}_{end}", ".3f") for kind in KINDS)] for said, end in cases)], [rows]


def one_line(cases: Iterable[tuple[str, str]]) -> tuple[Lines, list[Rows]]:
    """Single figures; `cases`: what stands above, the row's name."""
    rows, pairs = Rows.of(ACCURACY), list(cases)
    return [[said for said, _ in pairs], [rows(name, ".3f") for _, name in pairs]], [rows]


def grids(prefix: str, cells: tuple[float, ...], per_cell: tuple[float, ...]) -> tuple[Lines, list[Rows]]:
    """By cells over the thickness and particles per cell and axis."""
    return by_kind(prefix, "cells, particles per cell and axis", [(f"{c:g}, {p:g}", f"{c:g}c_{p:g}ppc") for c in cells for p in per_cell])


def front_end() -> tuple[Lines, list[Rows]]:
    """Medians of the stages over scenes with a truth."""
    rows = Rows.of(GPU)
    body = ([what, *(joined(rows, f"front_end_{scene}_", figures) for scene in SCENES)] for what, figures in FRONT_END.items())
    return [["medians", *SCENES.values()], *body], [rows]


def seconds() -> tuple[Lines, list[Rows]]:
    """Of the stages."""
    found = {"one processor core": Rows.of(PROCESSOR), "H200 and its host": Rows.of(GPU)}
    return [["", *STAGES.values()], *([who, *(rows(f"front_end_clean_{s}_s", ".1f") for s in STAGES)] for who, rows in found.items())], list(found.values())


def substeps() -> tuple[Lines, list[Rows]]:
    """Of the simulator, forward and backward."""
    files = {name: Rows.of(name) for name in (ONE_CORE, GPU)}
    lines = [["case", "one frame", "frames of a rollout", "replayed", "forward only", "plain Warp prototype", "times the floor"]]
    for case, (file, unit, name) in SUBSTEPS.items():
        rows = files[file]
        own = [rows(f"substep_{name}{suffix}", ".2g" if unit == "ms" else ".3g", unit) for suffix in ("", "_rollout", "_replayed", "_forward")]
        lines.append([case, *own, rows(f"prototype_{name}", ".3g", unit), rows(f"substep_{name}_over_floor", ".1f")])
    return lines, list(files.values())


def pictures() -> tuple[Lines, list[Rows]]:
    """Of the renderer beside gsplat, forward and backward [ms]."""
    rows, batch = Rows.of(GPU), "_8_frames"
    head = ["picture, Gaussians", *(word for frames in ("one frame", "eight frames") for word in (f"{frames} [ms]", "gsplat 1.5.3", "ratio"))]
    ends = [part + end for part in ("", batch) for end in ("", "_gsplat", "_vs_gsplat")]
    return [head, *([case, *(rows(name + end, ".2f") for end in ends)] for case, name in PICTURES.items())], [rows]


def effects(rows: Iterable[Row]) -> Lines:
    """Numbers halved and doubled, the strongest first: failures, flags of what is identified, stiffness, force (benchmarks/sensitivity.py)."""
    ordered = ranked(rows)
    clips = sorted(set().union(*map(clips_of, ordered)))
    head = ["number", "value", "what it is", "where it comes from", *CHANGED, f"decides in (of {', '.join(clips)})"]
    said = ([str(r.get(word, "")).replace("|", "\\|") for word in ("what", "source")] for r in ordered)
    return [head, *([f"`{r['name']}`", f"{r['value']:.3g}", *words, *(effect(r, w) for w in CHANGED), ", ".join(decided(r)) or "-"] for r, words in zip(ordered, said, strict=True))]


def ranked(rows: Iterable[Row]) -> list[Row]:
    """The strongest first."""
    return sorted(rows, key=lambda row: max(strength(row, word) for word in CHANGED), reverse=True)


def strength(row: Row, word: str) -> tuple[int, int, float, float]:
    """What `ranked` goes by."""
    found = row[word]["clips"].values()
    worst = (max((abs(c.get(name, 0)) for c in found), default=0) for name in ("young", "force"))
    return (sum("failed" in c for c in found), sum(c.get("flags", 0) for c in found), *worst)  # type: ignore[return-value]


def effect(row: Row, word: str) -> str:
    """What a number so changed does at the most, in words."""
    found = row[word]["clips"]
    if not found:
        return "stays as it is"
    failed = [f"fails in {name}: {c['failed']}" for name, c in found.items() if "failed" in c]
    told = {name: max((abs(c.get(name, 0)) for c in found.values()), default=0) for name in DECIDING}
    said = [words.format(told[name]) for name, (least, words) in DECIDING.items() if told[name] >= SHOWN * least]
    errors = [(after - before, f"error {before:.3f} to {after:.3f}") for c in found.values() for before, after in [c.get("error", (None, None))] if before is not None and after is not None]
    worse = [max(errors)[1]] if said and errors else []
    return "; ".join([*failed, *said, *worse]) or "nothing"


def clips_of(row: Row) -> set[str]:
    """Clips that a number was changed on."""
    return {name for word in CHANGED for name in row[word]["clips"]}


def decided(row: Row) -> list[str]:
    """Clips in which a number decides something."""
    found = {name for word in CHANGED for name, c in row[word]["clips"].items() if "failed" in c or any(abs(c.get(n, 0)) >= least for n, (least, _) in DECIDING.items())}
    return sorted(found)


def sensitivity(*, deciding: bool) -> tuple[Lines, list[Rows]]:
    """Numbers that decide something, with what; or by module those that decide nothing."""
    path = RESULTS / "sensitivity.json"
    rows = Rows.of(path.stem) if path.exists() else Rows()
    rows.used = {tuple(row[key] for key in ("device", "versions", "commit")) for row in rows.values()}
    if not rows:
        return [["no rows yet"]], [rows]
    kept = [row for row in rows.values() if bool(decided(row)) == deciding]
    if deciding:
        return effects(kept), [rows]
    modules = dict.fromkeys(row["name"].rpartition(".")[0] for row in kept)
    names = {m: ", ".join(f"`{row['name'].rpartition('.')[2]}`" for row in kept if row["name"].rpartition(".")[0] == m) for m in modules}
    return [["module", "numbers that decide nothing"], *([m, said] for m, said in names.items())], [rows]


def whole_runs() -> tuple[Lines, list[Rows]]:
    """Whole recoveries with numbers halved and doubled (benchmarks/whole_runs.py)."""
    path = RESULTS / "whole_runs.json"
    rows = Rows.of(path.stem) if path.exists() else Rows()
    rows.used = {tuple(row[key] for key in ("device", "versions", "commit")) for row in rows.values()}
    if "" not in rows:
        return [["no rows yet"]], [rows]
    clips = list(rows[""]["as is"])
    lines = [["number", "", *(f"{clip}: error of log10 E, force cosine, trajectory" for clip in clips)]]
    for name, row in rows.items():
        lines += [[f"`{name}`" if name else "", word, *(_run(row[word][clip]) for clip in clips)] for word in ("as is", *CHANGED) if word in row]
    return lines, [rows]


def _run(found: dict[str, float | None] | str) -> str:
    """A cell of `whole_runs`."""
    return found if isinstance(found, str) else ", ".join("-" if value is None else f"{value:.3f}" for value in found.values())


TABLES: dict[str, Callable[[], tuple[Lines, list[Rows]]]] = {
    "beam frequency": lambda: beam("frequency", (2.7, 4, 6, 8)),
    "beam deflection": lambda: beam("deflection", (2, 3, 4, 6)),
    "pulse": lambda: one_line((f"{cells} cells", f"bar_wave_speed_{cells}c") for cells in (2, 3, 4)),
    "lattice": lambda: grids("apparent", (2.7, 3, 4, 6), (1, 1.5, 2)),
    "share of the Gaussians": lambda: grids("sparse", (3, 4), (1, 1.5, 2, 3)),
    "share of the Gaussians, deflection": lambda: one_line((f"{p} to a cell and axis", f"sparse_deflection_{p}ppc") for p in (1, 2)),
    "clamp": lambda: by_kind("apparent", "cells further in", [(f"{o:+g}", f"3c_{o:+g}") for o in (-0.5, -0.25, 0.0, 0.25, 0.5)]),
    "front end": front_end,
    "front end seconds": seconds,
    "substep": substeps,
    "pictures": pictures,
    "sensitivity": lambda: sensitivity(deciding=True),
    "sensitivity, nothing": lambda: sensitivity(deciding=False),
    "whole runs": whole_runs,
}


def table(name: str) -> str:
    """A table of TABLES, and below it what it was measured on."""
    lines, sources = TABLES[name]()
    lines.insert(1, ["---"] * len(lines[0]))
    below = "; ".join(f"{device}, {versions}, commit {commit}" for device, versions, commit in sorted(set().union(*(rows.used for rows in sources))))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + f"\n\n{below}"


def filled(text: str) -> str:
    """A note with each of its tables made from the stored rows. Raises KeyError for a table that is not in TABLES."""
    made = lambda found: f"<!-- rows {found[1]} -->\n{table(found[1])}\n<!-- end rows {found[1]} -->"  # noqa: E731
    return re.sub(r"<!-- rows (.+?) -->.*?<!-- end rows \1 -->", made, text, flags=re.S)


def refilled(pages: Iterable[Path], fill: Callable[[str], str], *, check: bool) -> int:
    """Writes what `fill` makes of pages, or only looks whether that would change any; returns the exit status."""
    changed = [(path, text) for path in pages if (text := fill(path.read_text())) != path.read_text()]
    if check:
        return 1 if changed else 0
    for path, text in changed:
        path.write_text(text)
        print(f"tables in {path}")
    return 0


def main() -> int:
    """Writes tables, or only says whether they are those of the rows; returns the exit status."""
    return refilled(sorted(NOTES.glob("*.md")), filled, check="--check" in sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
