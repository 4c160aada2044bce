"""Claims about docs/nodes.md."""

from __future__ import annotations

from pathlib import Path

import diffphys_ros
from diffphys_ros.nodes import fit_node, ingest_node, inspect_node, segment_node
from diffphys_ros.nodes.parameters import CONFIG

TEXT = (Path(diffphys_ros.__file__).resolve().parent.parent / "docs" / "nodes.md").read_text()


def test_every_parameter_of_a_node_is_documented_with_its_default():
    for module in (ingest_node, segment_node, fit_node, inspect_node):
        for own in (CONFIG, *module.OWN):
            rows = [line for line in TEXT.splitlines() if f"| `{own.name}` |" in line]
            assert rows, own.name
            assert not own.default or any(str(own.default) in row for row in rows), own.name
