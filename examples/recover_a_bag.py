"""Stiffness and forces from a recording: python examples/recover_a_bag.py CLIP OUT [given.yaml]

CLIP is an MCAP file, a rosbag2 folder, a video or a folder of images. Without a given.yaml the density is assumed."""

from __future__ import annotations

import sys
from pathlib import Path

from diffphys_ros import config, inverse, result
from diffphys_ros.types import Recovery


def recover(clip: str | Path, out: str | Path, *given: str | Path) -> Recovery:
    """Recovers a clip into the folder `out`, which is complete or untouched. Raises errors.InputError."""
    settings = config.layered(given)
    with result.owned(out) as folder:
        steps = inverse.run(clip, settings)
        while True:
            try:
                news = next(steps)
            except StopIteration as stop:
                prepared, splats, recovery = stop.value
                break
            if news.text:
                print(f"{news.stage:9}{news.text}")
        result.write_all(recovery, prepared.clip, settings, folder, splats=splats)
    return recovery


if __name__ == "__main__":
    recovered = recover(*sys.argv[1:])
    print(f"done: python examples/read_the_answer.py {sys.argv[2]}")
