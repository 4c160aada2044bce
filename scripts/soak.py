#!/usr/bin/env python3
"""A camera that sends clip after clip to the five nodes for as long as is wanted, each when the last fit is done, while nodes are killed and
started again: what came of every clip and frame, how long it took, how memory went.

Exit status 0 only if every clip that no kill hit has its own result, no frame is unaccounted for, and memory does not grow.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path

import numpy as np
from clip_rig import NODES, SILENCE_S, START_S, Rig, Told, rigged
from memory_figure import draw, watched, write
from processes import run

from diffphys_ros.nodes.memory import held_mib

CLIP_S = 300.0  # longest wait
KILLED = ("segment_node", "fit_node", "splat_node", "ingest_node")  # in turn
SETTLED = 3  # clips after which a process has imported and cached what it keeps
MOST_GROWTH_MIB = 8.0  # of a process per clip after that


@dataclass
class Soak:
    """What was seen."""

    clips: list[Told] = field(default_factory=list)
    hit: set[int] = field(default_factory=set)  # numbers of clips during which a node was killed
    kills: list[tuple[float, str]] = field(default_factory=list)  # seconds from the begin, node
    memory: dict[tuple[str, int], list[float]] = field(default_factory=dict)  # PSS of each process [MiB] after every clip


def read(arguments: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="how long clips are sent")
    parser.add_argument("--clips", type=int, default=1, help="so many at least")
    parser.add_argument("--kill-every", type=float, default=180.0, help="seconds from one kill to the next; 0: none")
    parser.add_argument("--out", type=Path, default=Path("out/soak"), help="folder for the logs, memory.csv and memory.png")
    return parser.parse_args(arguments)


def work(graph: Rig, options: argparse.Namespace) -> bool:
    """Sends and kills, writes memory.csv and memory.png; whether all is well."""
    with watched(graph.running) as samples:
        seen = soaked(graph, 60 * options.minutes, options.clips, options.kill_every)
    write(samples, options.out / "memory.csv")
    draw(samples, seen.kills, options.out / "memory.png")
    return summary(seen, len(graph.clip))


def soaked(graph: Rig, for_s: float, least: int, kill_every_s: float) -> Soak:
    """Clips until the time is over, `least` of them at least."""
    seen, turn, began = Soak(), cycle(KILLED), time.monotonic()
    next_kill = began + kill_every_s if kill_every_s else float("inf")
    while len(seen.clips) < least or time.monotonic() - began < for_s:
        told = graph.send(len(seen.clips))
        seen.clips.append(told)
        if time.monotonic() > next_kill:
            seen.kills.append((time.monotonic() - began, name := next(turn)))
            seen.hit.add(told.number)
            restarted(graph, name)
            next_kill += kill_every_s
        hit, marks = told.number in seen.hit, {name: len(graph.said(name)) for name in NODES}
        graph.spin(lambda told=told, hit=hit: told.whole or (told.over and not hit), 30.0 if hit else CLIP_S)
        graph.spin(lambda: False, 2 * SILENCE_S)
        for name, process in graph.running.items():
            seen.memory.setdefault((name, process.pid), []).append(held_mib(process.pid))
        print(f"clip {told.number}: {what_came(told)}{', ' + seen.kills[-1][1] + ' was killed' if hit else ''}", flush=True)
        if not (told.whole or hit):
            for name in NODES:
                print(f"{name} says:\n{graph.said(name, marks[name])[-2000:]}", flush=True)
    return seen


def what_came(told: Told) -> str:
    """Of a clip, in words."""
    return "its own result" if told.whole else f"none, of {told.frames} frames{', ' + told.how if told.how else ''}"


def restarted(graph: Rig, name: str) -> None:
    """Kill a node and start it again; wait until it hears the camera where it must."""
    ears = graph.ears()
    graph.kill(name)
    graph.start(name)
    if name == "ingest_node":
        graph.spin(lambda: len(graph.ears() - ears) >= 3, START_S)
    graph.wait_for_nodes(START_S)


def growth(values: list[float]) -> float:
    """MiB per clip, once a process has settled."""
    kept = values[SETTLED:]
    return float(np.polyfit(np.arange(len(kept)), kept, 1)[0]) if len(kept) > SETTLED else 0.0


def summary(seen: Soak, per_clip: int) -> bool:
    """Prints what came of it; whether all is well."""
    lost = [told.number for told in seen.clips if not told.whole and told.number not in seen.hit]
    short = [told.number for told in seen.clips if told.frames != per_clip and told.number not in seen.hit]
    took = [told.done_s - told.sent_s for told in seen.clips if told.done_s is not None and told.number not in seen.hit]
    grown = {name: growth(values) for (name, pid), values in seen.memory.items()}
    print(f"{len(seen.clips)} clips, {len(seen.kills)} kills ({', '.join(name for _, name in seen.kills) or 'none'}); {sum(told.whole for told in seen.clips)} have their own result; without one and without a kill: {lost or 'none'}")
    if took:
        print(f"from the first image to the end of the fit: median {np.median(took):.1f} s, longest {max(took):.1f} s")
    print(f"{sum(told.frames for told in seen.clips)} of {per_clip * len(seen.clips)} frames are in clips that were published; clips with others than their own, and without a kill: {short or 'none'}")
    for name in NODES:
        last = [values[-1] for (who, _), values in seen.memory.items() if who == name]
        print(f"{name:14} {last[-1] if last else 0:6.0f} MiB at the end, {grown.get(name, 0.0):+.2f} MiB per clip")
    return not (lost or short) and bool(seen.clips) and all(rate <= MOST_GROWTH_MIB for rate in grown.values())


if __name__ == "__main__":
    options = read(sys.argv[1:])
    run(lambda: rigged(options.out, lambda graph: work(graph, options)))
