#!/usr/bin/env python3
"""Kills nodes of a running graph with SIGKILL, each alone and in pairs, starts them again, and says what came of the clip and of the next one.

Exit status 0 only if after every kill the next clip has its own result.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from itertools import combinations
from pathlib import Path

from clip_rig import NODES, SILENCE_S, START_S, Rig, rigged
from processes import run

CLIP_S, MOMENT_S, GONE_S = 600.0, 300.0, 20.0  # longest waits; the last one for the result of a clip of which nothing more is heard
MOMENTS = {"sent": ("ingest_node", "ends: "), "labelled": ("segment_node", "label images"), "fit": ("fit_node", "modes: ")}  # who then says what
WAITS = re.compile(r"waiting for (.*)")


def read(arguments: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", nargs="*", help="such as segment_node, or fit_node+splat_node for a pair; each alone and all pairs where none is named")
    parser.add_argument("--moments", nargs="*", choices=MOMENTS, default=list(MOMENTS), help="when: the clip has ended, is labelled, is fitted")
    parser.add_argument("--out", type=Path, default=Path("out/kills"), help="folder for the logs")
    return parser.parse_args(arguments)


def work(graph: Rig, options: argparse.Namespace) -> bool:
    """Prints the table; whether after every kill the next clip had its own result."""
    cases = [tuple(word.split("+")) for word in options.nodes or []] or [*((name,) for name in NODES), *combinations(NODES, 2)]
    print(f"{'killed':32}{'when':10}{'its clip':40}{'the next clip':24}waited for", flush=True)
    rows = ((moment, names) for names in cases for moment in options.moments)
    went_on = [one_kill(graph, names, moment, 2 * number) for number, (moment, names) in enumerate(rows)]
    return all(went_on)


def one_kill(graph: Rig, names: tuple[str, ...], moment: str, number: int) -> bool:
    """A row of the table; whether the next clip has its own result."""
    who, words = MOMENTS[moment]
    marks = {name: len(graph.said(name)) for name in NODES}
    told = graph.send(number)
    graph.spin(lambda: words in graph.said(who, marks[who]), MOMENT_S)
    ears = graph.ears()
    began = time.monotonic()
    graph.kill(*names)
    graph.start(*names)
    if "ingest_node" in names:
        graph.spin(lambda: len(graph.ears() - ears) >= 3, START_S)
    others = set(names) - {"ingest_node", "inspect_node"}
    gone = "ingest_node" in names and (others or moment == "sent")  # with the images
    graph.spin(lambda: told.whole, GONE_S if gone else CLIP_S)
    waits = {name: WAITS.findall(graph.said(name, marks[name])) for name in NODES}
    after = graph.send(number + 1)
    graph.spin(lambda: after.whole, CLIP_S)
    first = f"its own result after {told.whole_s - began:.0f} s" if told.whole_s is not None else "gone"  # or while the next one was waited for
    second = f"its own result, {after.whole_s - after.sent_s:.0f} s" if after.whole_s is not None else "NO RESULT"
    said = "; ".join(f"{name.removesuffix('_node')}: {found[-1]}" for name, found in waits.items() if found) if not told.whole else ""
    print(f"{' '.join(name.removesuffix('_node') for name in names):32}{moment:10}{first:40}{second:24}{said}", flush=True)
    graph.spin(lambda: False, SILENCE_S)
    return after.whole


if __name__ == "__main__":
    options = read(sys.argv[1:])
    run(lambda: rigged(options.out, lambda graph: work(graph, options)))
