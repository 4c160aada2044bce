"""Where the prior comes from: one callable per word of PriorSettings.source."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import closing
from typing import TypeVar

import numpy as np

from ..config import Settings
from ..errors import InputError, shown
from ..progress import finished
from ..types import IGNORE, Clip, MaterialPrior
from .database import UNKNOWN, find
from .endpoint import TICK_S
from .model import NoAnswerError, asking
from .records import Record, of_material
from .region import spread
from .written import read_records

T = TypeVar("T")
Waiting = Generator[None, None, T]  # yields while there is nothing to do but wait; to close it is to give up
Source = Callable[[np.ndarray, np.ndarray, Settings], Waiting[MaterialPrior]]


def from_file(frame: np.ndarray, labels: np.ndarray, settings: Settings) -> Waiting[MaterialPrior]:
    """What a person wrote into prior.file. Raises InputError."""
    yield from ()
    assert settings.prior.file is not None
    return spread(read_records(settings.prior.file, parts=_parts(labels)), labels, source="a person's file of materials")


def from_database(frame: np.ndarray, labels: np.ndarray, settings: Settings) -> Waiting[MaterialPrior]:
    """The database's typical values for the names in prior.materials. Raises InputError."""
    yield from ()
    names, parts = settings.prior.materials, _parts(labels)
    assert names is not None
    if len(names) not in (1, parts):
        raise InputError(f"prior.materials has {len(names)} names, must be 1 or {parts} (one per part found); correct the list or segment.max_parts")
    return spread(_of_names(names), labels, source="the material database")


def from_model(frame: np.ndarray, labels: np.ndarray, settings: Settings) -> Waiting[MaterialPrior]:
    """What a vision-language model sees in frame 0; the database where it gives nothing usable, with a note that says so."""
    try:
        records = yield from _in_ticks(asking(frame, labels, settings))
    except NoAnswerError as error:
        names = settings.prior.materials or [UNKNOWN]
        note = f"prior: the model {shown(settings.prior.model)} was of no help ({error}), so the database's values for {', '.join(names)} were taken"
        fallback = _of_names(names if len(names) in (1, _parts(labels)) else names[:1])
        return spread(fallback, labels, source="the material database, for want of the model's answer", notes=(note,))
    return spread(records, labels, source=f"the vision-language model {shown(settings.prior.model)}")


SOURCES: dict[str, Source] = {"file": from_file, "database": from_database, "model": from_model}


def material_prior(clip: Clip, settings: Settings) -> MaterialPrior | None:
    """What `believing` returns."""
    return finished(believing(clip, settings))


def believing(clip: Clip, settings: Settings) -> Waiting[MaterialPrior | None]:
    """What is believed of the object's material, by what `settings.prior` names; None where it names nothing. Yields while a model answers.

    Needs `clip.labels`. Raises InputError for settings, a file or names that cannot be used; a model that cannot be reached or
    answers nonsense is no error: the database steps in and a note says so.
    """
    if settings.prior.source == "none":
        return None
    if clip.labels is None:
        raise ValueError("material_prior needs clip.labels; run segment.label_clip first")
    return (yield from SOURCES[settings.prior.source](clip.frames[0], clip.labels[0], settings))


def _in_ticks(steps: Generator[float, None, T]) -> Waiting[T]:
    """Steps whose pauses are waited for in short ones, so that whoever gives up does so at once."""
    with closing(steps):
        while True:
            try:
                pause = next(steps)
            except StopIteration as stop:
                return stop.value
            until = time.monotonic() + pause
            yield
            while (left := until - time.monotonic()) > 0:
                time.sleep(min(left, TICK_S))
                yield


def _of_names(names: list[str]) -> list[Record]:
    found = [find(name, "prior.materials") for name in names]
    return [of_material(entry, part=i + 1 if len(found) > 1 else None) for i, entry in enumerate(found)]


def _parts(labels: np.ndarray) -> int:
    return int(labels[labels != IGNORE].max(initial=1))
