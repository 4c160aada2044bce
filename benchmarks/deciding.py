"""Numbers of the first engine, and of what finds plain objects, that decide something; and an import that multiplies one of them.

The number is multiplied in the source of its module, before the module runs, so that copies of it (`from .free_tail import FREQUENCY_SD`), values made
of it (`DEARER` of `AXIAL_SHARE`) and default arguments follow. It lasts as long as the process.
"""

from __future__ import annotations

import ast
import importlib
import io
import re
import sys
import tokenize
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

PACKAGE = "diffphys_ros"
MOST = 60  # numbers
_HELPER = "_multiplied_by_benchmark"

LISTED = {  # by module; NAME<=x: more makes no sense. Left out: units, tolerances and iterations of solvers, room of search bounds
    "vibration.coordinates": (
        "CANDIDATES MOST_COORDINATES LEAST_SEEN<=1 LEAST_SHARE<=1 STEADY_SHARE<=1 STEADY_POINTS WILD SEPARABLE<=1 COHERENT_SHARE<=1"
    ),
    "vibration.forced_frames": (
        "COMMON_SHARE<=1 CURVED_SHARE<=1 FORCED_SIGMA FAINTER_SIGMA TAIL_RISE LEAST_EQUATIONS LEAST_TAIL_FRAMES LEAST_TAIL_PERIODS FAINT_SIGMA BRIDGE "
        "VAGUEST LARGEST_GROWTH SURELY WORST_TAIL<=1"
    ),
    "vibration.continuity": "STRIDE STRANGE WITHOUT_REST MOVING",
    "start.evidence": "STILL",
    "start.values": "ALARM_NOISE ALARM_SHARE<=1 MOST_DETUNING WIDEST_SD AGREEMENT",
    "start.free_tail": "MODEL_ERROR FREQUENCY_SD RATIO_SD MASS_DAMPING_SD STIFFNESS_DAMPING_SD DETUNED",
    "start.force": "FORCE_SD FORCE_STEP_SD EDGE_GAIN EDGE_SHARE<=1",
    "start.along": "AXIAL_SHARE<=1",
    "start.uncertainty": "SILHOUETTE_PX",
    "start.densities": "DENSITY_CONTRAST",
    "start.stages": "SPARSITY[3] ACTIVE<=1",
    "elements.mesh": "CELLS_ACROSS",
    "plainness": "LEAST_SHARE<=1 ENOUGH_SHARE<=1 LEAST_GREY ROUGH_GREY",
    "segment.even": "REACH",
    "outline.follow": "LEAST_CONTRAST",
}

PLAIN = ("plainness.", "segment.even.", "outline.")  # what acts on plain objects alone


@dataclass(frozen=True)
class Number:
    """A number that stands in a module: NAME, Class.NAME or NAME[i]."""

    module: str  # below diffphys_ros
    path: str
    most: float = np.inf

    @classmethod
    def of(cls, module: str, word: str) -> Number:
        """From a word of LISTED."""
        path, _, most = word.partition("<=")
        return cls(module, path, float(most or "inf"))

    def __str__(self) -> str:
        return f"{self.module}.{self.path}"

    @property
    def full_module(self) -> str:
        """As it is imported."""
        return f"{PACKAGE}.{self.module}"

    @property
    def names(self) -> list[str]:
        """Classes, outermost first, and the name."""
        return re.sub(r"\[.*", "", self.path).split(".")

    @property
    def index(self) -> int | None:
        """Of the entry; None for a number that stands alone."""
        found = re.search(r"\[(\d+)\]", self.path)
        return int(found[1]) if found else None

    def value(self) -> Any:
        """As it is in this process."""
        found: Any = importlib.import_module(self.full_module)
        for name in self.names:
            found = getattr(found, name)
        return found if self.index is None else found[self.index]

    def times(self, value: Any, factor: float) -> Any:
        """`value` (of NAME, with all its entries) with this number multiplied: whole numbers are rounded and stay 1 at least, none exceeds its bound."""
        if self.index is not None:
            entries = [self.once(v, factor) if i == self.index else v for i, v in enumerate(value)]
            return np.array(entries) if isinstance(value, np.ndarray) else type(value)(entries)
        return self.once(value, factor)

    def once(self, value: Any, factor: float) -> Any:
        """As `times`, for the number alone."""
        new = min(value * factor, max(self.most, value))
        return max(1, round(new)) if isinstance(value, int) else new

    @property
    def of_plain(self) -> bool:
        """Whether it acts on objects without texture alone, mostly before there are tracks, so that only a recording of one shows what it decides."""
        return str(self).startswith(PLAIN)

    def comment(self) -> str:
        """What the code says that it is; empty where it says nothing. Raises LookupError where nothing sets it."""
        return self._said().rpartition(" [")[0]

    def source(self) -> str:
        """Where the code says that it comes from."""
        return self._said().rpartition(" [")[2].removesuffix("]")

    def _said(self) -> str:
        """The comment on the line that sets it."""
        source = Path(importlib.import_module(self.full_module).__file__ or "").read_text()
        body, at = _place(ast.parse(source), self)
        line = body[at].end_lineno
        said = [t.string for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type == tokenize.COMMENT and t.start[0] == line]
        return said[0].lstrip("# ") if said else ""


def numbers() -> list[Number]:
    """All of LISTED."""
    return [Number.of(module, word) for module, words in LISTED.items() for word in words.split()]


def multiply(number: Number, factor: float) -> None:
    """Multiply a number in all that this process imports from now on. Raises RuntimeError where its module was imported before."""
    if number.full_module in sys.modules:
        raise RuntimeError(f"{number.full_module} was imported before {number} could be multiplied; multiply first")
    sys.meta_path.insert(0, _Finder(number, factor))


class _Finder(MetaPathFinder):
    def __init__(self, number: Number, factor: float) -> None:
        self.number, self.factor = number, factor

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Of the one module."""
        if fullname != self.number.full_module:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin, self.number, self.factor)
        return spec


class _Loader(SourceFileLoader):
    def __init__(self, fullname: str, path: str, number: Number, factor: float) -> None:
        super().__init__(fullname, path)
        self.number, self.factor = number, factor

    def get_code(self, fullname: str) -> CodeType:
        """From the source: kept bytecode has the number as it was."""
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        body, at = _place(tree, self.number)
        name = self.number.names[-1]
        body.insert(at + 1, ast.parse(f"{name} = {_HELPER}({name})").body[0])
        return compile(tree, path, "exec", dont_inherit=True)

    def exec_module(self, module: ModuleType) -> None:
        """With what multiplies at hand."""
        module.__dict__[_HELPER] = partial(self.number.times, factor=self.factor)
        super().exec_module(module)


def _place(tree: ast.Module, number: Number) -> tuple[list[ast.stmt], int]:
    """The statements among which the number is set, and the place of the one that sets it. Raises LookupError where none does."""
    body, (*classes, name) = tree.body, number.names
    for outer in classes:
        body = next((s.body for s in body if isinstance(s, ast.ClassDef) and s.name == outer), [])
    for at, statement in enumerate(body):
        if isinstance(statement, ast.Assign | ast.AnnAssign) and name in _set_by(statement):
            return body, at
    raise LookupError(f"{number} is set nowhere; mend LISTED in benchmarks/deciding.py")


def _set_by(statement: ast.Assign | ast.AnnAssign) -> set[str]:
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    return {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}
