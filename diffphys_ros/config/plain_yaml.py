"""The YAML that people write settings in: mappings, lists and words. Numbers are those of YAML 1.2, so that 1e-3 is one and 1:30 is not.

What files of settings never need is refused while reading: anchors, aliases and merges (a kilobyte of them makes gigabytes), tags, deep
nesting, and a key that stands twice, of which one would be lost without a word.
"""

from __future__ import annotations

import re
from typing import Any

from yaml import AliasEvent, MappingNode, ScalarNode, SequenceNode, YAMLError
from yaml.composer import Composer
from yaml.error import MarkedYAMLError
from yaml.nodes import Node
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.scanner import Scanner

from ..errors import InputError, short, shown

DEEPEST = 20  # levels
INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
NULLS = frozenset({"", "~", "null", "Null", "NULL"})
TRUE = frozenset({"true", "True", "TRUE", "yes", "Yes", "YES", "on", "On", "ON"})
FALSE = frozenset({"false", "False", "FALSE", "no", "No", "NO", "off", "Off", "OFF"})
LONGEST_INTEGER = 300  # digits; more are no float either
MERGE = "<<"


def loaded(text: str, origin: str) -> Any:
    """What a YAML text stands for: None, bool, int, float, str, lists and dicts with text as keys. Raises InputError that names origin and line."""
    try:
        node = _Reading(text, origin).get_single_node()
    except InputError:
        raise
    except MarkedYAMLError as error:
        at = "" if error.problem_mark is None else f"line {error.problem_mark.line + 1}: "
        raise InputError(f"{origin}: not valid YAML ({at}{shown(error.problem or error.context)}); correct it") from error
    except YAMLError as error:
        raise InputError(f"{origin}: not valid YAML ({shown(' '.join(str(error).split()))}); correct it") from error
    except Exception as error:  # the parser's own faults: numbers of thousands of digits, escapes beyond Unicode
        raise InputError(f"{origin}: not valid YAML ({type(error).__name__} in the parser); correct it") from error
    return None if node is None else _value(node, origin)


def scalar(text: str) -> Any:
    """What one plain word stands for; itself where it is neither null, true, false nor a number."""
    if text in NULLS:
        return None
    if text in TRUE or text in FALSE:
        return text in TRUE
    if INTEGER.fullmatch(text):
        return int(text) if len(text) <= LONGEST_INTEGER else float(text)
    if FLOAT.fullmatch(text):
        return float(text if text[-1] in "0123456789." else text.replace(".", ""))  # .inf and .nan are without their dot in Python
    return text


class _Reading(Reader, Scanner, Parser, Composer):
    """PyYAML's stages up to the graph of nodes; a plain word and a quoted one get different tags, nothing else is resolved."""

    def __init__(self, text: str, origin: str) -> None:
        Reader.__init__(self, text)
        Scanner.__init__(self)
        Parser.__init__(self)
        Composer.__init__(self)
        self._origin, self._depth = origin, 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, AliasEvent) or event.anchor is not None:
            raise self._refused(event, f"anchors and aliases such as {shown('&' + event.anchor[:40])} are not read; write the value where it is wanted")
        if event.tag is not None:
            raise self._refused(event, f"tags such as {shown(event.tag[:40])} are not read; write the plain value")
        if self._depth >= DEEPEST:
            raise self._refused(event, f"nested deeper than {DEEPEST} levels; settings need two")
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def resolve(self, kind: type[Node], value: Any, implicit: Any) -> str:
        return "plain" if kind is ScalarNode and implicit[0] else "other"

    def descend_resolver(self, *_: Any) -> None:
        pass

    def ascend_resolver(self) -> None:
        pass

    def _refused(self, event: Any, why: str) -> InputError:
        return InputError(f"{self._origin}, line {event.start_mark.line + 1}: {why}")


def _value(node: Node, origin: str) -> Any:
    if isinstance(node, MappingNode):
        return _mapping(node, origin)
    if isinstance(node, SequenceNode):
        return [_value(item, origin) for item in node.value]
    return scalar(node.value) if node.tag == "plain" else node.value


def _mapping(node: MappingNode, origin: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    lines: dict[str, int] = {}
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, ScalarNode):
            raise InputError(f"{origin}, line {line}: a name must be a word, not a list or a group; write `name: value`")
        if key.value == MERGE:
            raise InputError(f"{origin}, line {line}: merges (<<) are not read; write the values where they are wanted")
        if key.value in found:
            raise InputError(f"{origin}: {short(key.value)} stands twice, in lines {lines[key.value]} and {line}; keep one")
        found[key.value], lines[key.value] = _value(value, origin), line
    return found
