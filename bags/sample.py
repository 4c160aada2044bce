"""Where the bundled samples lie."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

SAMPLES = {"bar": "sample", "strip": "sample_strip"}


def sample_folder(kind: str = "bar") -> Path:
    """Folder with clip.mcap, given.yaml, mask0.png and truth.npz of the bar or the strip, in a checkout as in an install."""
    return Path(str(files("diffphys_ros.bags"))) / SAMPLES[kind]
