"""The topics of a fit as a recording."""

from __future__ import annotations

from collections.abc import Iterator

from ..config import Settings
from ..types import Clip, Recovery
from .fields import Answer, answer
from .messages import Message
from .topics import PLAYED, RESULTS, TOPICS


def recording(recovery: Recovery, clip: Clip, settings: Settings) -> Iterator[Message]:
    """Plain messages in order of time: the latched results at the first frame's stamp, then what is played, frame by frame."""
    found = answer(recovery, clip, settings)
    yield from results(found)
    for frame in range(len(found)):
        yield from played(found, frame)


def results(found: Answer) -> Iterator[Message]:
    """The latched messages of a recovery."""
    for name in RESULTS:
        yield _message(found, name, 0, getattr(found, name[2:])())


def played(found: Answer, frame: int, names: tuple[str, ...] = PLAYED) -> Iterator[Message]:
    """The messages of one frame, of these topics; ~/rendered only where something was rendered."""
    for name in names:
        fields = getattr(found, name[2:])(frame)
        if fields is not None:
            yield _message(found, name, frame, fields)


def _message(found: Answer, name: str, frame: int, fields: dict) -> Message:
    topic = TOPICS[name]
    return Message(topic.absolute, topic.type_name, found.stamp_ns(frame), fields, topic.latched)
