"""A person's file of materials.

    parts:
      - {part: 1, material: polyurethane foam}
      - {name: leaf, box: [0.4, 0.1, 0.8, 0.5], E: 2.0e6, nu: 0.4, rho: 900, within: 3}
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..config import loaded, read_text
from ..errors import InputError, shown
from .records import Record, of_person

MOST_RECORDS = 254  # label images know no more parts


def read_records(path: str | Path, *, parts: int) -> list[Record]:
    """Records of a YAML file for an object of `parts` parts. Raises InputError that names file and entry."""
    origin = f"prior.file {shown(path)}"
    tree = loaded(read_text(path, origin), origin)
    if not isinstance(tree, Mapping) or set(tree) != {"parts"} or not isinstance(tree["parts"], list) or not 1 <= len(tree["parts"]) <= MOST_RECORDS:
        raise InputError(f"{origin}: must hold 'parts:' with 1 to {MOST_RECORDS} entries such as '- {{part: 1, material: rubber}}'")
    records = [of_person(entry, f"{origin}, entry {i + 1}", parts=parts) for i, entry in enumerate(tree["parts"])]
    _check_regions(records, origin)
    return records


def _check_regions(records: list[Record], origin: str) -> None:
    """Refuses two entries for one part and two for the whole object."""
    regions = [record.part or "the whole object" for record in records if record.box is None]
    for region in regions:
        if regions.count(region) > 1:
            what = f"part {region}" if isinstance(region, int) else region
            raise InputError(f"{origin}: {regions.count(region)} entries are for {what}; keep one")
