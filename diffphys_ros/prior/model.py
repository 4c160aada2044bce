"""Records by a vision-language model: asked, checked, asked again with the error, remembered (paper section 3.2, appendix C)."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np

from ..config import Settings
from ..errors import InputError
from .cache import Cache, default_folder, key_of
from .endpoint import Endpoint, EndpointError, Message
from .prompt import again, question, records_of
from .records import Record

Steps = Generator[float, None, list[Record]]
FIRST_WAIT_S = 1.0  # before the second try after a passing failure; doubled each time


class NoAnswerError(RuntimeError):
    """The model gave nothing that can be used; the message says why in a clause."""


def endpoint_of(settings: Settings) -> Endpoint:
    """The endpoint that the settings name, with the key of its environment variable. Raises InputError."""
    prior = settings.prior
    for name, value, other in (("base_url", prior.base_url, "model"), ("model", prior.model, "base_url")):
        if not value:
            raise InputError(f"prior.{name} is not set, prior.{other} needs it; name an OpenAI-compatible endpoint and one of its models")
    assert prior.base_url is not None
    assert prior.model is not None
    return Endpoint(prior.base_url, prior.model, settings.experiment.prior_timeout_s, os.environ.get(prior.api_key_env, "").strip())


def ask(frame: np.ndarray, labels: np.ndarray, settings: Settings, *, wait: Callable[[float], None] = time.sleep) -> list[Record]:
    """What `asking` returns; `wait` hears the pauses before requests that are sent again [s]."""
    steps = asking(frame, labels, settings)
    while True:
        try:
            pause = next(steps)
        except StopIteration as stop:
            return stop.value
        if pause:
            wait(pause)


def asking(frame: np.ndarray, labels: np.ndarray, settings: Settings) -> Steps:
    """Records of frame 0 (H, W, 3) uint8 RGB with its label image (H, W), from the cache where the same was asked before.

    Yields the seconds after which it wants to go on, 0 while the model thinks; to close the generator ends the request. Raises
    InputError for settings that name no endpoint, NoAnswerError where `experiment.prior_attempts` requests gave nothing usable.
    """
    endpoint, parts = endpoint_of(settings), int(labels[labels < 255].max(initial=0))
    messages = question(frame, labels)
    folder = settings.experiment.prior_cache
    cache, key = Cache(Path(folder) if folder else default_folder()), key_of(endpoint.base_url, endpoint.model, messages)
    remembered = _usable(cache.get(key), parts)
    if remembered is not None:
        return remembered
    answer, records = yield from _asked(endpoint, messages, parts, settings.experiment.prior_attempts)
    cache.put(key, answer)
    return records


def _usable(answer: str | None, parts: int) -> list[Record] | None:
    try:
        return None if answer is None else records_of(answer, parts=parts)
    except InputError:
        return None


def _asked(endpoint: Endpoint, messages: list[Message], parts: int, attempts: int) -> Generator[float, None, tuple[str, list[Record]]]:
    """The first answer that keeps the contract, and its records."""
    talk, why, pause = list(messages), "", FIRST_WAIT_S
    for attempt in range(attempts):
        try:
            answer = yield from endpoint.asking(talk)
            return answer, records_of(answer, parts=parts)
        except InputError as error:
            why, talk = f"its answer breaks the contract: {error}", [*messages, *again(answer, str(error))]
        except EndpointError as error:
            why = str(error)
            if not error.passing:
                break
            if attempt + 1 < attempts:
                yield pause
                pause *= 2
    raise NoAnswerError(why)
