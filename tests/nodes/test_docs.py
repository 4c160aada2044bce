"""Claims about docs/nodes.md."""

from __future__ import annotations

from pathlib import Path

import diffphys_ros
from diffphys_ros.nodes import fit_node, ingest_node, inspect_node, segment_node
from diffphys_ros.nodes.limits import MAX_MIB
from diffphys_ros.nodes.parameters import AUTOSTART, CONFIG, Own

TEXT = (Path(diffphys_ros.__file__).resolve().parent.parent / "docs" / "nodes.md").read_text()


def rows(own: Own) -> list[list[str]]:
    """The cells of the table's rows of a parameter."""
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in TEXT.splitlines()]
    return [row for row in cells if len(row) == 6 and row[1] == f"`{own.name}`"]


def test_every_parameter_of_a_node_is_documented_with_its_default_range_and_when_it_may_be_set():
    for module in (ingest_node, segment_node, fit_node, inspect_node):
        for own in (CONFIG, AUTOSTART, MAX_MIB, *module.OWN):
            assert rows(own), own.name
            for row in rows(own):
                check(module, own, row)


def check(module, own: Own, row: list[str]) -> None:
    _, _, default, bounds, running, _ = row
    assert default.strip("`") == (str(own.default).lower() if isinstance(own.default, bool) else str(own.default)), own.name
    if own.low is not None:
        assert [float(bound) for bound in bounds.split(" .. ")] == [own.low, own.high], own.name
    assert [choice for choice in own.choices if choice and f"`{choice}`" not in bounds] == [], own.name
    assert own.fixed or running in ("yes", module.__name__.rpartition(".")[2], "`fit_node`"), own.name
    assert not own.fixed or running != "yes", own.name
