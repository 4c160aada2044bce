"""Networks in the on-disk format of transformers: from a folder, or by hub id where the machine reaches the hub.

Weights are read from safetensors files alone (a pickle may run code), and code beside a checkpoint is never run.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from typing import Any

from .devices import usable
from .errors import InputError, short
from .npz import in_words


def model_of(name: str, architectures: Mapping[str, str], *, setting: str, device: str) -> tuple[Any, Any]:
    """A checkpoint's network on `device` (auto, cpu or cuda:0), in evaluation mode, and its configuration.

    Args:
        name: folder with config.json and model.safetensors, or hub id.
        architectures: class of transformers by the configuration's model_type; "*" stands for all others.
        setting: name of the setting that `name` comes from, for messages.

    Raises InputError where transformers is absent, or the checkpoint cannot be found, read or used for this.
    """
    name, chosen = os.path.expanduser(name), usable(device)
    try:
        import torch
        import transformers
    except ModuleNotFoundError as error:
        raise InputError(f"{setting} {short(name)} needs the package {error.name!r}; install diffphys_ros with the extra [models]") from error
    logging.getLogger("transformers").setLevel(logging.ERROR)  # its advice is for people who train
    transformers.utils.logging.disable_progress_bar()
    options = _options(name)
    config = _read(name, setting, lambda: transformers.AutoConfig.from_pretrained(name, **options))
    kind = architectures.get(config.model_type, architectures.get("*"))
    if kind is None:
        raise InputError(
            f"{setting} {short(name)}: a network of type {config.model_type!r}, must be one of {', '.join(architectures)}; give another checkpoint"
        )
    model = _read(
        name, setting, lambda: getattr(transformers, kind).from_pretrained(name, use_safetensors=True, dtype=torch.float32, **options)
    )
    return model.eval().to(chosen), model.config


def image_processor(name: str, *, setting: str) -> Any:
    """What turns images into a checkpoint's inputs and its outputs into images. Raises InputError where its files are missing."""
    import transformers

    name = os.path.expanduser(name)
    return _read(name, setting, lambda: transformers.AutoImageProcessor.from_pretrained(name, **_options(name)))


def _options(name: str) -> dict[str, Any]:
    return {"local_files_only": _is_local(name), "trust_remote_code": False}


def _is_local(name: str) -> bool:
    return os.path.exists(name) or name.startswith(("/", ".", "~"))


def _read(name: str, setting: str, load: Callable[[], Any]) -> Any:
    if _is_local(name) and not os.path.isdir(name):
        raise InputError(f"{setting} {short(name)}: there is no such folder; give one with config.json and model.safetensors, or a hub id")
    try:
        return load()
    except Exception as error:  # whatever a damaged file makes transformers, safetensors and json raise
        raise InputError(
            f"{setting} {short(name)}: no usable checkpoint ({in_words(error)}); give a folder with config.json and model.safetensors, or a hub id that this machine can reach"
        ) from error
