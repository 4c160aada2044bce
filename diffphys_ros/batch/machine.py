"""What a clip is computed on, and how many at once."""

from __future__ import annotations

import math
import os
import platform
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

NEED_MB = 2700  # of memory for a recovery: measured 2,620 with 60 frames of 480 x 360 and four cells, 870 with 36 of 160 x 120 and three
GPU_NEED_MB = 4000  # of a GPU's memory: fifteen recoveries at once took 48,625 on an H100
PER_GPU = 15  # at most: a clip takes 57 s alone on an H100, one is done every 28 s with fifteen at once (docs/batch.md)
COMPUTING = ("numpy", "torch", "warp-lang")


def versions() -> str:
    """Of Python and of the packages that compute."""
    found = []
    for name in COMPUTING:
        try:
            found.append(f"{name.removesuffix('-lang')} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join([f"python {platform.python_version()}", *found])


def device_name(device: str) -> str:
    """What fit.device stands for here: the GPU's name, or the processor's. A device that there is not is for the run to refuse."""
    if device == "auto" or device.startswith("cuda"):
        import torch

        try:
            if torch.cuda.is_available():
                return torch.cuda.get_device_name(None if device == "auto" else device)
        except (RuntimeError, ValueError, AssertionError):
            return ""
    about = Path("/proc/cpuinfo")
    models = re.findall(r"model name\s*:\s*(.+)", about.read_text()) if about.exists() else []
    return models[0] if models else platform.processor() or platform.machine()


def gpus() -> list[int]:
    """Memory [MB] of each NVIDIA GPU that torch could use here; empty without one, or with a CPU build of torch."""
    if "+cpu" in _torch() or os.environ.get("CUDA_VISIBLE_DEVICES") == "":
        return []
    try:
        words = ["nvidia-smi", "--query-gpu=memory.total", "--format=csv,noheader,nounits"]
        told = subprocess.run(words, capture_output=True, text=True, timeout=20, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return []
    return [int(line) for line in told.split() if line.isdigit()][: _visible()]


def default_workers(gpu_mb: list[int]) -> int:
    """Clips at once: a core each and NEED_MB of memory; on GPUs besides at most PER_GPU each and GPU_NEED_MB of theirs."""
    cores = len(os.sched_getaffinity(0))
    host = max(1, min(cores, _free_mb() // NEED_MB))
    return min(host, sum(per_gpu(mb) for mb in gpu_mb)) if gpu_mb else host


def per_gpu(memory_mb: int) -> int:
    """Clips at once on a GPU."""
    return max(1, min(PER_GPU, memory_mb // GPU_NEED_MB))


def shared_by(workers: int, gpus: int) -> int:
    """Clips that share a GPU, or a core where there is none."""
    return math.ceil(workers / (gpus or len(os.sched_getaffinity(0))))


def _torch() -> str:
    try:
        return version("torch")
    except PackageNotFoundError:
        return "+cpu"


def _visible() -> int | None:
    chosen = os.environ.get("CUDA_VISIBLE_DEVICES")
    return None if chosen is None else len(chosen.split(","))


def _free_mb() -> int:
    found = re.search(r"MemAvailable:\s+(\d+) kB", Path("/proc/meminfo").read_text())
    return int(found[1]) // 1000 if found else NEED_MB
