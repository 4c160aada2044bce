"""ROS parameters from the tree of settings: the same names, units, ranges and docs as the command line and YAML files."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from diffphys_ros import config
from diffphys_ros.devices import usable
from diffphys_ros.errors import InputError, short, shown

from .qos import OVERRIDES

_RCLPY = ("use_sim_time", "start_type_description_service")  # declared by rclpy itself
UNSET = ("null", "None")  # a parameter that is not set: as `ros2 param dump` writes it and `--params-file` gives it back, and as `ros2 param load` does


class Own(NamedTuple):
    """A parameter of a node that is no setting of the tree."""

    name: str
    default: Any
    doc: str
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    fixed: bool = True  # from the start of the node on
    check: Callable[[Any], Any] | None = None  # raises InputError for a value that will not do

    @property
    def range_text(self) -> str:
        """The allowed values in words."""
        if self.low is None or self.high is None:
            return ", ".join(self.choices)
        return f"{self.low:g} .. {self.high:g}"


CONFIG = Own("config", "", "YAML file of settings, or several; later ones win, parameters win over files", fixed=False)
AUTOSTART = Own("autostart", True, "configure and activate the node when it starts; false: a lifecycle manager does")


class Parameters:
    """Declares the settings that a node reads (`reader` of config.READERS), and its own parameters, and checks every change. Needs a node that
    declares its overrides by itself. Files of settings serve all nodes: what a node does not read is checked there and kept, but no parameter.

    `changed` is told the names of what has changed, and says in words when that holds; `holds` keeps its last word.
    Raises InputError for an unknown name, one that another reads, a value out of range and a YAML file that cannot be read.
    """

    def __init__(self, node: Node, own: Sequence[Own] = (), *, reader: str, changed: Callable[[Collection[str]], str] = lambda names: "") -> None:
        self._origin = f"parameters of {node.get_name()}"
        self._node, self._own = node, {item.name: item for item in (CONFIG, AUTOSTART, *own)}
        self._changed, self._news, self.holds = changed, set[str](), ""
        self._descriptors: dict[str, ParameterDescriptor] = {}
        self._declared = config.read_by(reader)
        given = self._given()
        for item in self._own.values():
            self._require(item, item.default if given.get(item.name) is None else given[item.name])
            self._declare(item.name, item.default, _describe_own(item), given)
        defaults = self._in_files(self.paths(CONFIG.name))
        told = {n: v for n, v in given.items() if n not in self._own}
        config.require_read(told, reader, self._origin)
        self._built(defaults | told)
        self._kept = {name: value for name, value in defaults.items() if name not in self._declared}
        for name in self._declared:
            leaf = config.leaves()[name]
            self._declare(name, defaults.get(name, leaf.default), _describe(leaf), given)
        node.add_pre_set_parameters_callback(self._spelt_out)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._after)

    def __getitem__(self, name: str) -> Any:
        """Value of one of the node's own parameters, ~ as the home folder."""
        value = _plain(self._node.get_parameter(name).value)
        return os.path.expanduser(value) if isinstance(value, str) else value

    def paths(self, name: str) -> list[str]:
        """A parameter that holds one path or several, as a list without empty ones."""
        return _paths(_plain(self._node.get_parameter(name).value))

    def settings(self, changes: Mapping[str, Any] | None = None) -> config.Settings:
        """The tree as files and parameters say it, with `changes` on top. Raises InputError."""
        values = {name: _plain(self._node.get_parameter_or(name).value) for name in self._declared}
        return self._built(self._kept | values | dict(changes or {}))

    def _built(self, values: Mapping[str, Any]) -> config.Settings:
        settings = config.build(values, self._origin)
        # what follows imports torch: only where the default, which is known to be good, is left
        if settings.fit.device.startswith("cuda") and "fit.device" in self._declared:
            usable(settings.fit.device)
        if settings.fit.law != config.Fit().law and "fit.law" in self._declared:
            from diffphys_ros.inverse.law import law_to_fit

            law_to_fit(settings)
        return settings

    def _given(self) -> dict[str, Any]:
        """What the command line and files of parameters say, by name; None for what is unset there."""
        overrides: Mapping[str, Any] = self._node.get_parameters_by_prefix("")
        given = {name: self._value(p) for name, p in overrides.items()}
        return {n: v for n, v in given.items() if n not in _RCLPY and not n.startswith(OVERRIDES)}

    def _value(self, parameter: Parameter) -> Any:
        leaf, value = config.leaves().get(parameter.name), _plain(parameter.value)
        may_be_unset = parameter.name in self._own if leaf is None else leaf.optional
        return None if may_be_unset and value in UNSET else value

    def _declare(self, name: str, default: Any, descriptor: ParameterDescriptor, given: Mapping[str, Any]) -> None:
        self._descriptors[name] = descriptor
        if given.get(name) is not None:
            self._node.set_descriptor(name, descriptor)
            return
        if name in given:
            self._node.undeclare_parameter(name)
        unset = name in given and name not in self._own
        self._node.declare_parameter(name, None if unset else default, descriptor, ignore_override=True)

    def _spelt_out(self, changes: list[Parameter]) -> list[Parameter]:
        """What is to be set: nothing in place of `null`, and the settings of a new file."""
        unset = [Parameter(p.name) if self._value(p) is None else p for p in changes]
        return [*unset, *(Parameter(name, value=value) for name, value in self._from_new_file(changes).items() if name in self._declared)]

    def _from_new_file(self, changes: Iterable[Parameter]) -> dict[str, Any]:
        file = next((p for p in changes if p.name == CONFIG.name), None)
        try:
            return {} if file is None else self._in_files(_paths(_plain(file.value)))
        except InputError:  # which _check says
            return {}

    def _check(self, changed: list[Parameter]) -> SetParametersResult:
        values = {p.name: _plain(p.value) for p in changed if p.name in self._own or p.name in self._declared}
        if not values:
            return SetParametersResult(successful=True)
        try:
            for name in values:
                if values[name] is None and (name in self._own or not config.leaves()[name].optional):
                    raise InputError(f"{self._origin}: {name} cannot be unset; give it a value")
                if name in self._own:
                    self._require(self._own[name], values[name])
            files = self._in_files(_paths(values.get(CONFIG.name)))
            self.settings(files | {name: value for name, value in values.items() if name in self._declared})
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._news = {name for name in values if values[name] != _plain(self._node.get_parameter_or(name).value)}
        self._kept |= {name: value for name, value in files.items() if name not in self._declared}
        return SetParametersResult(successful=True)

    def _after(self, changed: list[Parameter]) -> None:
        news, self._news = self._news, set()
        for name in (p.name for p in changed if p.name in self._declared and not self._node.has_parameter(p.name)):  # rclpy drops what is unset
            self._node.declare_parameter(name, None, self._descriptors[name], ignore_override=True)
        self.holds = self._changed(news) if news else ""

    def _require(self, item: Own, value: Any) -> None:
        need = _need(item, value)
        if need:
            raise InputError(f"{self._origin}: {item.name} is {short(value)}, must be {need}")
        if item.check is not None:
            item.check(os.path.expanduser(value) if isinstance(value, str) else value)

    @staticmethod
    def _in_files(paths: Iterable[str]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for path in paths:
            found |= config.read_yaml(path)
        return found


def _paths(value: Any) -> list[str]:
    paths = value if isinstance(value, list) else [value]
    return [os.path.expanduser(path) for path in paths if path]


def _describe(leaf: config.Leaf) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=leaf.doc + (f" [{leaf.unit}]" if leaf.unit else ""), additional_constraints=leaf.range_text, dynamic_typing=True
    )
    if not leaf.is_list:
        _bound(descriptor, leaf.kind, leaf.low, leaf.high)
    return descriptor


def _describe_own(item: Own) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=item.doc, additional_constraints=item.range_text, read_only=item.fixed, dynamic_typing=True)
    _bound(descriptor, type(item.default), item.low, item.high)
    return descriptor


def _bound(descriptor: ParameterDescriptor, kind: type, low: float | None, high: float | None) -> None:
    if low is None or high is None:
        return
    if kind is int:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]


def _need(item: Own, value: Any) -> str:
    """What a node's own parameter would have to be; empty where it is that already."""
    if item.choices and value not in item.choices:
        return f"one of {', '.join(item.choices)}"
    if item.name == CONFIG.name:
        every = value if isinstance(value, list) else [value]
        return "" if all(isinstance(path, str) and not config.BROKEN.search(path) for path in every) else "a path or a list of paths; put it between quotes"
    if isinstance(item.default, str):
        return "" if isinstance(value, str) and not config.BROKEN.search(value) else "text without control characters; put it between quotes"
    if isinstance(item.default, bool):
        return "" if isinstance(value, bool) else "true or false"
    if isinstance(value, bool) or not (isinstance(value, (int, float)) and math.isfinite(value)):
        return "a number" + (f" in {item.range_text}" if item.range_text else "")
    if item.low is not None and item.high is not None and not item.low <= value <= item.high:
        return f"in {item.range_text}"
    return "a whole number" if isinstance(item.default, int) and value != int(value) else ""


def _plain(value: Any) -> Any:
    return list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value


def existing(path: str) -> str:
    """A path parameter as it is, empty or not; raises InputError where it names nothing."""
    try:
        there = not path or Path(path).exists()
    except (OSError, ValueError):  # too long, or no path at all
        there = False
    if not there:
        raise InputError(f"parameter bag: {shown(path)}: there is no such file or folder; give the path of a bag, a video or a folder of images")
    return path
