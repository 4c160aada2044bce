#!/usr/bin/env python3
"""Many tiny clips in a row through the five nodes, a few of them with a whole fit; what came of each, by its stamp.

Every second clip swings slower, so that its modulus must come out lower by the square: a result made of another clip's images shows.
Exit status 0 only if every clip has its own result.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from clip_rig import EVERY_SECOND_SLOWER, SILENCE_S, Rig, Told, rigged
from processes import run

CLIP_S, WHOLE_S = 600.0, 600.0  # longest waits
AHEAD = 2  # clips that are sent before the first of them has ended: they wait in ingest_node
WHOLE_ITERATIONS = 8
AGREES = 0.05  # of log10 E within which clips of one kind must come out


def read(arguments: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="clips")
    parser.add_argument("--whole", type=int, default=3, help="of them with a whole fit, at the end")
    parser.add_argument("--out", type=Path, default=Path("out/many_clips"), help="folder for the logs")
    return parser.parse_args(arguments)


def work(graph: Rig, options: argparse.Namespace) -> bool:
    """Sends the clips; whether each has its own result."""
    began = time.monotonic()
    all_told = send_all(graph, options.count - options.whole, 0, CLIP_S)
    if options.whole:
        graph.set_parameter("fit.iterations", WHOLE_ITERATIONS, "fit_node")
        all_told += send_all(graph, options.whole, len(all_told), WHOLE_S)
    return summary(all_told, time.monotonic() - began)


def send_all(graph: Rig, count: int, first: int, limit_s: float) -> list[Told]:
    """Clips in a row, at most AHEAD of them unanswered while another is sent."""
    sent: list[Told] = []
    for number in range(first, first + count):
        graph.spin(lambda: sum(told.done_s is None for told in sent) <= AHEAD, limit_s)
        sent.append(graph.send(number))
        graph.spin(lambda: False, 2 * SILENCE_S)  # the silence that ends a clip
        for told in sent:
            if told.done_s is not None and told.whole and told.how:
                show(told)
    graph.spin(lambda: all(told.done_s is not None and (told.whole or "done" not in told.how) for told in sent), limit_s * (AHEAD + 1))
    for told in sent:
        show(told)
    return sent


SHOWN: set[int] = set()


def show(told: Told) -> None:
    """A line for a clip, once."""
    if told.number in SHOWN:
        return
    SHOWN.add(told.number)
    took = "" if told.done_s is None else f"{told.done_s - told.sent_s:6.1f} s"
    print(f"{told.number:4d}  {told.clip}  {'its own result' if told.whole else 'NO RESULT':14}  {took:9}  E {told.young_pa:9.4g} Pa  {told.how}", flush=True)


def summary(all_told: list[Told], took_s: float) -> bool:
    """What came of all; whether every clip has its own result, and a modulus like the others of its kind."""
    good = [told for told in all_told if told.whole]
    logs = {odd: np.log10([told.young_pa for told in good if told.number % 2 == odd]) for odd in (0, 1)}
    print(f"\n{len(good)} of {len(all_told)} clips have their own result; {took_s:.0f} s, {took_s / max(len(all_told), 1):.1f} s a clip")
    if not (len(logs[0]) and len(logs[1])):
        return len(good) == len(all_told)
    spread = max(float(np.ptp(each)) for each in logs.values())
    ratio = float(np.median(logs[0]) - np.median(logs[1]))
    print(f"log10 E: spread within a kind {spread:.3f}; between the kinds {ratio:.3f}, of their swings {2 * np.log10(EVERY_SECOND_SLOWER):.3f}")
    return len(good) == len(all_told) and spread < AGREES and abs(ratio - 2 * np.log10(EVERY_SECOND_SLOWER)) < AGREES


if __name__ == "__main__":
    options = read(sys.argv[1:])
    run(lambda: rigged(options.out, lambda graph: work(graph, options)))
