"""What tests of batches share: settings with which a recovery takes seconds, a clip that fails at once, and looks into processes."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diffphys_ros import config

QUICK_WORDS = (
    *("--experiment.cells", "3", "--experiment.per_cell", "1.5", "--fit.iterations", "1", "--fit.device", "cpu"),
    *("--experiment.splat_iterations", "8", "--experiment.max_splats", "500", "--experiment.checkpoint_every_s", "0.1"),
)
QUICK_FLAGS = {name[2:]: config.parse_text(config.leaves()[name[2:]], text) for name, text in zip(QUICK_WORDS[::2], QUICK_WORDS[1::2], strict=True)}


def broken(folder: Path) -> Path:
    """A recording that breaks off."""
    folder.mkdir(parents=True)
    path = folder / "clip.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    return path


def wait_for(found: Callable[[], Any], *, limit_s: float = 200.0) -> Any:
    """What `found` gives as soon as it is true."""
    end = time.monotonic() + limit_s
    while not (value := found()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)
    return value


def child_of(folder: Path) -> int | None:
    """Number of the process that recovers into a folder."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if "diffphys_ros.batch.child" in words and "recover" in words and str(folder) in words:
            return int(path.parent.name)
    return None
