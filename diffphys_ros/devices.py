"""Where tensors live."""

from __future__ import annotations

import re

from .errors import InputError, short

WORDS = re.compile(r"auto|cpu|cuda(:\d{1,3})?")


def usable(word: str, *, setting: str = "fit.device") -> str:
    """cpu or cuda:N for auto, cpu, cuda or cuda:N. Raises InputError where this machine has no such device, which libraries would say
    only after long work."""
    if not WORDS.fullmatch(word):
        raise InputError(f"{setting} is {short(word)}, must be auto, cpu or cuda:0; auto takes the best there is")
    import torch

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if word == "auto":
        return "cuda:0" if count else "cpu"
    number = int(word.partition(":")[2] or 0)
    if word != "cpu" and number >= count:
        there = "there is no CUDA device" if not count else f"the CUDA devices are numbered 0 .. {count - 1}"
        raise InputError(f"{setting} is {word!r}, but {there}; choose auto or cpu, or another number")
    return word if word == "cpu" else f"cuda:{number}"
