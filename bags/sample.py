"""Where the bundled sample lies."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def sample_folder() -> Path:
    """Folder with clip.mcap, given.yaml, mask0.png and truth.npz, in a checkout as in an install."""
    return Path(str(files("diffphys_ros.bags"))) / "sample"
