"""What processes hold over time: looked at beside the work, drawn as a figure."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import NamedTuple

import numpy as np

from diffphys_ros.nodes.memory import held_mib

EVERY_S = 2.0


class Sample(NamedTuple):
    """What a process and its children held."""

    seconds: float  # since the watch began
    name: str
    mib: float


@contextmanager
def watched(running: Mapping[str, Popen], every_s: float = EVERY_S) -> Iterator[list[Sample]]:
    """Samples of processes by name, which may be others from one look to the next; the list grows as long as the context lasts."""
    samples, over, began = list[Sample](), threading.Event(), time.monotonic()

    def look() -> None:
        while not over.wait(every_s):
            now = time.monotonic() - began
            samples.extend(Sample(now, name, held_mib(process.pid)) for name, process in list(running.items()))

    thread = threading.Thread(target=look, name="memory", daemon=True)
    thread.start()
    try:
        yield samples
    finally:
        over.set()
        thread.join()


def together(samples: Sequence[Sample]) -> tuple[np.ndarray, np.ndarray]:
    """Times (K,) [s] of the looks, and what all processes held then (K,) [MiB]."""
    times, index = np.unique([sample.seconds for sample in samples], return_inverse=True)
    return times, np.bincount(index, [sample.mib for sample in samples], len(times))


def write(samples: Sequence[Sample], path: Path) -> None:
    """A line a sample: seconds, name, MiB."""
    path.write_text("".join(f"{seconds:.1f},{name},{mib:.1f}\n" for seconds, name, mib in samples))


def draw(samples: Sequence[Sample], kills: Sequence[tuple[float, str]], path: Path) -> None:
    """A line a name, one of all together, and a mark at the seconds at which one was killed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 4.5), layout="constrained")
    for name in dict.fromkeys(sample.name for sample in samples):
        own = [(sample.seconds / 60, sample.mib) for sample in samples if sample.name == name]
        axes.plot(*zip(*own, strict=True), label=name, linewidth=1)
    times, mib = together(samples)
    axes.plot(times / 60, mib, color="black", label="together", linewidth=1.5)
    for seconds, name in kills:
        axes.axvline(seconds / 60, color="grey", linestyle=":", linewidth=1)
        axes.text(seconds / 60, 1.01, f"{name.removesuffix('_node')} killed", ha="center", va="bottom", fontsize=7, transform=axes.get_xaxis_transform())
    axes.set(xlabel="time [min]", ylabel="held [MiB, PSS]", ylim=(0, None))
    figure.legend(loc="outside lower center", ncols=6, fontsize=8)
    figure.savefig(path, dpi=80)
    pyplot.close(figure)
