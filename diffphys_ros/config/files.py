"""Settings from YAML files and from words of a command line."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError, shown
from .leaf import Leaf, leaves
from .plain_yaml import loaded, scalar
from .tree import Settings
from .values import build

LARGEST_FILE = 1 << 17  # bytes; all settings with their docs take 8 KB


def read_text(path: str | Path, origin: str, *, largest: int = LARGEST_FILE) -> str:
    """The text of a regular file of at most `largest` bytes. Raises InputError; does not wait where a pipe or a device is named."""
    try:
        with open(path, "rb", opener=_regular) as file:
            data = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or type(error).__name__}; give the path of a readable file") from error
    except ValueError as error:
        raise InputError(f"{origin}: is no path; give one without control characters and broken Unicode") from error
    if len(data) > largest:
        raise InputError(f"{origin}: has more than {largest} bytes; give a smaller file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{origin}: not valid UTF-8 (byte {error.start}); save it as UTF-8") from error


def _regular(path: str, flags: int) -> int:
    """Opens without waiting for a pipe's other end. Raises OSError where it is no regular file."""
    descriptor = os.open(path, flags | os.O_NONBLOCK)
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, "is no regular file")


def flatten(tree: Mapping[str, Any], origin: str) -> dict[str, Any]:
    """Dotted names of a nested mapping as a YAML file holds it. Raises InputError where a name stands twice."""
    found: dict[str, Any] = {}
    for group, entries in tree.items():
        if not isinstance(entries, Mapping) and "." not in str(group):
            raise InputError(f"{origin}: {shown(str(group)[:80])!r} must be a group of settings, such as 'scene:' with indented names below")
        named = {f"{group}.{key}": value for key, value in entries.items()} if isinstance(entries, Mapping) else {str(group): entries}
        twice = next((name for name in named if name in found), None)
        if twice is not None:
            raise InputError(f"{origin}: {shown(twice[:80])!r} stands twice; keep one")
        found |= named
    return found


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Dotted names and values of a YAML file; relative paths in it are relative to it, ~ is a home folder."""
    origin = f"config {shown(path)}"
    tree = loaded(read_text(path, origin), origin) or {}
    if not isinstance(tree, Mapping):
        raise InputError(f"{origin}: must hold groups of settings, such as 'scene:' with indented names below")
    values = flatten(tree, origin)
    build(values, origin)
    return {name: _beside(Path(path), value, origin) if leaves()[name].path and value else value for name, value in values.items()}


def _beside(file: Path, value: str, origin: str) -> str:
    try:
        return str((file.parent / os.path.expanduser(value)).resolve())
    except (OSError, RuntimeError) as error:  # links in a circle
        raise InputError(f"{origin}: {shown(value)} leads nowhere; correct the path") from error


def layered(
    configs: Iterable[str | Path] = (), flags: Mapping[str, Any] | None = None, *, base: Mapping[str, Any] | None = None
) -> Settings:
    """Settings from `base` (dotted names), then YAML files, later ones winning, then flags, which win over files."""
    values: dict[str, Any] = dict(base or {})
    for path in configs:
        values |= read_yaml(path)
    return build(values | dict(flags or {}), "command line" if flags else "settings")


def parse_text(leaf: Leaf, text: str) -> Any:
    """The value that a command-line word stands for: 0.8, true, null, '[0, 0, -9.81]' or 0,0,-9.81. Raises InputError for a broken list."""
    if leaf.is_list:
        text = text.strip()
        return loaded(text if text.startswith("[") or scalar(text) is None else f"[{text}]", f"command line: --{leaf.name}")
    if leaf.kind is str:
        return None if text in ("null", "") and leaf.optional else text
    return scalar(text.strip())
