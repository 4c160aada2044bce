#!/usr/bin/env python3
"""docs/settings.md, docs/topics.md and config/defaults.yaml, from the code: settings from config, topics from msg_schemas. Rewrites what
stands between `<!-- NAME -->` and `<!-- end NAME -->` in the page of that name; with --check it only says whether the files are up to date."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from diffphys_ros import config
from diffphys_ros.inverse.registered import registered
from diffphys_ros.msg_schemas import TOPICS, Topic, clouds

ROOT = Path(__file__).resolve().parent.parent
DEFAULTS = ROOT / "config" / "defaults.yaml"
DEFAULTS_HEAD = """\
# Every setting with its default. Copy what you change; the same names are flags of `diffphys` (--scene.mass_kg 0.8),
# groups of a file for --config, and parameters of the nodes that read them (-p scene.mass_kg:=0.8). One file serves all nodes.
"""
FRAMES = {"world": "world", "camera": "camera optical", "": ""}


def settings_table() -> str:
    """Every setting with default, unit, range and meaning, a table for each heading; experiments apart."""
    people = "\n\n".join(f"**{_title(heading)}**\n\n{_settings_of(heading)}" for heading in config.HEADINGS if heading != config.EXPERIMENT)
    about = "Nobody needs these for a clip; no node has them as parameters, a file of settings may hold them."
    return f"{people}\n\n<details><summary>{_title(config.EXPERIMENT)}</summary>\n\n{about}\n\n{_settings_of(config.EXPERIMENT)}\n\n</details>"


def _settings_of(heading: str) -> str:
    leaves = (leaf for leaf in config.leaves().values() if leaf.heading == heading)
    rows = ((f"`{leaf.name}`", f"`{_value(leaf.default)}`", leaf.unit, leaf.range_text or registered(leaf.name), leaf.doc) for leaf in leaves)
    return _table(("name", "default", "unit", "range", "meaning"), rows)


def _title(heading: str) -> str:
    return heading[0].upper() + heading[1:]


def topics_table() -> str:
    """Every topic with type, QoS, frame and units; the fields of the clouds."""
    rows = (
        (f"`{t.name}`", t.type_name.replace("/msg/", "/"), _qos(t), FRAMES.get(t.frame, t.frame), t.units, t.doc) for t in TOPICS.values()
    )
    return f"{_table(('topic', 'type', 'QoS', 'frame', 'units', 'what'), rows)}\n\n{clouds_table()}"


def clouds_table() -> str:
    """Every field of the particles' clouds with its type, unit and first byte in each cloud."""
    layouts = {name: layout for name, layout in clouds.LAYOUTS.items() if name != "~/force_so_far"}
    names = list(dict.fromkeys(name for layout in layouts.values() for name in layout))
    units = {name: list(dict.fromkeys(layout[name] for layout in layouts.values() if name in layout)) for name in names}
    bytes_of = {name: [str(clouds.dtype(layout).fields[name][1]) if name in layout else "" for layout in layouts.values()] for name in names}  # type: ignore[index]
    rows = (
        (f"`{name}`", "uint32" if units[name] == ["#"] else "float32", ", ".join(unit for unit in units[name] if unit != "#"), *bytes_of[name], clouds.MEANING.get(name, ""))
        for name in names
    )
    return _table(("field", "type", "unit", *(f"byte in `{name}`" for name in layouts), "what"), rows)


TABLES: dict[str, Callable[[], str]] = {"settings": settings_table, "topics": topics_table}


def page(name: str) -> Path:
    """Where the table of that name stands."""
    return ROOT / "docs" / f"{name}.md"


def filled(name: str, text: str) -> str:
    """The text of a page with its table made anew. Raises ValueError where a marker is missing."""
    begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
    if begin not in text or end not in text:
        raise ValueError(f"docs/{name}.md misses {begin} or {end}")
    return re.sub(f"{begin}.*?{end}", lambda _: f"{begin}\n{TABLES[name]()}\n{end}", text, flags=re.S)


def defaults() -> str:
    """Every setting with its default, as a YAML file with the docs as comments."""
    lines, last, heading = [], "", ""
    for leaf in config.leaves().values():
        group, key = leaf.name.split(".")
        lines += [f"# {leaf.heading}"] if leaf.heading != heading else []
        lines += [f"{group}:"] if group != last else []
        words = [leaf.doc + (f" [{leaf.unit}]" if leaf.unit else ""), *filter(None, [leaf.range_text or registered(leaf.name)])]
        lines.append(f"  {key}: {json.dumps(leaf.default) if leaf.kind is not str or leaf.default is None else leaf.default}  # {'; '.join(words)}")
        last, heading = group, leaf.heading
    return DEFAULTS_HEAD + "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Rewrites the files, or checks them; returns the exit status."""
    wanted = {page(name): filled(name, page(name).read_text(encoding="utf-8")) for name in TABLES} | {DEFAULTS: defaults()}
    if arguments == ["--check"]:
        return int(any(path.read_text(encoding="utf-8") != text for path, text in wanted.items()))
    for path, text in wanted.items():
        path.write_text(text, encoding="utf-8")
    return 0


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = tuple(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def _value(default: Any) -> str:
    if isinstance(default, bool) or default is None:
        return {True: "true", False: "false", None: "null"}[default]
    return f"{default:g}" if isinstance(default, float) else str(default)


def _qos(topic: Topic) -> str:
    history = f"keep last {topic.depth}" if topic.depth else "keep all"
    return f"reliable, {'transient local' if topic.latched else 'volatile'}, {history}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
