"""What a result folder says: python examples/read_the_answer.py OUT"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from diffphys_ros import result


def answer(folder: str | Path) -> Iterator[str]:
    """The answer in lines: Young's modulus by part with its spread, the largest net force, what was assumed."""
    found = result.load(folder)
    for part, (identified, reason) in enumerate(zip(found.identified, found.reasons, strict=True), 1):
        here = found.part == part
        young, sd = np.median(found.young[here]), np.median(found.log10_young_sd[here])
        if identified:
            yield f"part {part}: E = {young:.3g} Pa, with 68 % between {young / 10**sd:.3g} and {young * 10**sd:.3g} Pa; {reason}"
        else:
            yield f"part {part}: stiffness not identified; {reason}"
    net = found.net_force()  # (T, 3) [N], world frame
    frame = int(np.linalg.norm(net, axis=1).argmax())
    if found.force_identified:
        yield f"largest net force: {np.linalg.norm(net[frame]):.3g} N along ({', '.join(f'{v:+.2f}' for v in net[frame])}) at {frame * found.period_s:.2f} s"
    else:
        yield f"force not identified; {found.force_reason}"
    yield from (f"assumed: {note}" for note in found.notes)


if __name__ == "__main__":
    print(*answer(sys.argv[1]), sep="\n")
