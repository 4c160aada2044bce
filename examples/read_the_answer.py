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
    stiffness, net = found.stiffness(found.scale), found.net_quantity(found.scale)  # pascals and newtons where mass and size are known
    spread = found.log10_young_sd if found.scale.absolute else found.log10_specific_sd
    for part, (identified, reason) in enumerate(zip(found.identified, found.reasons, strict=True), 1):
        here = found.part == part
        young, sd = np.median(stiffness.values[here]), np.median(spread[here])
        if identified:
            yield f"part {part}: {stiffness.name} = {young:.3g} {stiffness.unit}, with 68 % between {young / 10**sd:.3g} and {young * 10**sd:.3g}; {reason}"
        else:
            yield f"part {part}: stiffness not identified; {reason}"
    peak = np.linalg.norm(net.values, axis=1)  # of (T, 3), world frame
    frame = int(peak.argmax())
    if found.force_identified:
        known = f" (peak {found.net_force_peak:.3g} +- {found.net_force_peak_sd:.2g} N)" if found.scale.absolute else ""
        yield f"largest {net.name}: {peak[frame]:.3g} {net.unit} along ({', '.join(f'{v:+.2f}' for v in net.values[frame])}) at {frame * found.period_s:.2f} s{known}"
    else:
        yield f"force not identified; {found.force_reason}"
    yield from (f"assumed: {note}" for note in found.notes)


if __name__ == "__main__":
    print(*answer(sys.argv[1]), sep="\n")
