"""Checkpoints that cannot be used are refused with a sentence."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.pretrained import image_processor, model_of

KINDS = {"sam": "SamModel"}


def test_a_machine_without_transformers_is_told_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(InputError, match=r"segment\.model 'a/b' needs the package 'transformers'; install diffphys_ros with the extra \[models\]"):
        model_of("a/b", KINDS, setting="segment.model", device="cpu")


def test_a_folder_that_is_not_there_is_not_looked_for_on_the_hub(tmp_path: Path) -> None:
    pytest.importorskip("transformers", reason="transformers is not installed; pip install '.[models]'")
    with pytest.raises(InputError, match="there is no such folder"):
        model_of(str(tmp_path / "missing"), KINDS, setting="segment.model", device="cpu")


@pytest.mark.parametrize("text", ["{", json.dumps({"model_type": "nothing-known"}), json.dumps({"model_type": "sam"}), "[" * 100_000, "[1, 2]", '{"model_type": ["sam"]}'])
def test_a_folder_that_holds_no_checkpoint_is_refused(tmp_path: Path, text: str) -> None:
    pytest.importorskip("transformers", reason="transformers is not installed; pip install '.[models]'")
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(InputError, match=r"segment\.model.*give a folder with config\.json and model\.safetensors"):
        model_of(str(tmp_path), KINDS, setting="segment.model", device="cpu")


def test_code_beside_a_checkpoint_is_not_run(tmp_path: Path) -> None:
    pytest.importorskip("transformers", reason="transformers is not installed; pip install '.[models]'")
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "own", "auto_map": {"AutoConfig": "own.Own"}}))
    (tmp_path / "own.py").write_text(f"import pathlib; pathlib.Path({str(tmp_path / 'harm')!r}).touch()\nclass Own: pass\n")
    with pytest.raises(InputError):
        model_of(str(tmp_path), KINDS, setting="segment.model", device="cpu")
    assert not (tmp_path / "harm").exists()


def test_a_checkpoint_without_its_image_processor_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("transformers", reason="transformers is not installed; pip install '.[models]'")
    with pytest.raises(InputError, match=r"depth\.model.*no usable checkpoint"):
        image_processor(str(tmp_path), setting="depth.model")
