"""The table of measured figures: one JSON file of rows per device under benchmarks/results/."""

from __future__ import annotations

import json
import platform
import re
import subprocess
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
import warp as wp

RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Row:
    """One figure, with what it was measured on."""

    name: str
    value: float
    unit: str
    device: str
    versions: str
    commit: str


def row(name: str, value: float, unit: str, *, device: str) -> Row:
    """A figure of this machine and this commit; `device` is a torch device name."""
    versions = f"python {platform.python_version()}, torch {torch.__version__}, warp {wp.__version__}"
    return Row(name, value, unit, device_name(device), versions, commit())


def device_name(device: str) -> str:
    """What the device is called: the GPU's name, or the processor's."""
    if device.startswith("cuda"):
        return torch.cuda.get_device_name(device)
    models = re.findall(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text()) if Path("/proc/cpuinfo").exists() else []
    return models[0] if models else platform.processor() or platform.machine()


def commit() -> str:
    """Short name of the checked-out commit, with a + where files differ from it; empty outside a repository."""
    folder = Path(__file__).parent
    found = subprocess.run(["git", "describe", "--always", "--dirty=+"], cwd=folder, capture_output=True, text=True, check=False)
    return found.stdout.strip()


def record(rows: list[Row]) -> None:
    """Print the rows, and put them in their device's file in place of older ones of the same name."""
    for r in rows:
        print(f"{r.name:32s} {r.value:10.4g} {r.unit:4s} {r.device}")
        path = RESULTS / (re.sub(r"[^a-z0-9]+", "-", r.device.lower()).strip("-") + ".json")
        known = {old["name"]: old for old in json.loads(path.read_text())} if path.exists() else {}
        known[r.name] = asdict(r)
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps([known[name] for name in sorted(known)], indent=1) + "\n")
