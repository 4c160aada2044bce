"""Devices are refused before any work where there are none such."""

from __future__ import annotations

import pytest
import torch

from diffphys_ros.config import build
from diffphys_ros.devices import usable
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import run, solve_prepared

COUNT = torch.cuda.device_count() if torch.cuda.is_available() else 0


def test_auto_is_the_best_there_is_and_the_processor_is_always_there():
    assert usable("auto") == ("cuda:0" if COUNT else "cpu")
    assert usable("cpu") == "cpu"


@pytest.mark.parametrize("word", ["gpu", "cuda:", "cuda:-1", "CPU", "", "cuda:0 ", "x" * 5000])
def test_what_names_no_device_is_refused(word):
    with pytest.raises(InputError, match=r"fit\.device is .*, must be auto, cpu or cuda:0"):
        usable(word)


@pytest.mark.parametrize("word", [f"cuda:{COUNT}", "cuda:999", *([] if COUNT else ["cuda"])])
def test_a_device_that_this_machine_lacks_is_refused_before_anything_is_read(word, tmp_path):
    settings = build({"fit.device": word})
    for steps in (run(tmp_path / "never_read.mcap", settings), solve_prepared(None, settings)):
        with pytest.raises(InputError, match=r"fit\.device is 'cuda.*choose auto or cpu"):
            next(steps)
