"""ROS parameters from the tree of settings: the same names, units, ranges and docs as the command line and YAML files."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from diffphys_ros import config
from diffphys_ros.errors import InputError, short, shown

_RCLPY = ("use_sim_time", "start_type_description_service")  # declared by rclpy itself
_QOS_PREFIX = "qos_overrides."


class Own(NamedTuple):
    """A parameter of a node that is no setting of the tree; fixed at the start of the node."""

    name: str
    default: Any
    doc: str
    choices: tuple[str, ...] = ()


CONFIG = Own("config", [], "YAML file of settings, or several; later ones win, parameters win over files")


class Parameters:
    """Declares the settings that a node reads (`reader` of config.READERS), and its own parameters, and checks every change. Needs a node that
    declares its overrides by itself. Files of settings serve all nodes: what a node does not read is checked there and kept, but no parameter.

    Raises InputError for an unknown name, one that another reads, a value out of range and a YAML file that cannot be read.
    """

    def __init__(self, node: Node, own: Sequence[Own] = (), *, reader: str) -> None:
        self._origin = f"parameters of {node.get_name()}"
        self._node, self._own = node, {item.name: item for item in (CONFIG, *own)}
        overrides: Mapping[str, Any] = node.get_parameters_by_prefix("")
        given = {name: _plain(p.value) for name, p in overrides.items()}
        given = {n: v for n, v in given.items() if n not in _RCLPY and not n.startswith(_QOS_PREFIX)}
        for item in self._own.values():
            self._declare(item.name, item.default, _describe_own(item), given)
        defaults: dict[str, Any] = {}
        for path in self.paths(CONFIG.name):
            defaults |= config.read_yaml(path)
        told = {n: v for n, v in given.items() if n not in self._own}
        config.require_read(told, reader, self._origin)
        config.build(defaults | told, self._origin)
        self._declared = config.read_by(reader)
        self._kept = {name: value for name, value in defaults.items() if name not in self._declared}
        for name in self._declared:
            leaf = config.leaves()[name]
            self._declare(name, defaults.get(name, leaf.default), _describe(leaf), given)
        node.add_on_set_parameters_callback(self._check)

    def __getitem__(self, name: str) -> Any:
        """Value of one of the node's own parameters, ~ as the home folder; raises InputError where it is of another kind or none of the choices."""
        value, item = _plain(self._node.get_parameter(name).value), self._own[name]
        need = _need(item, value)
        if need:
            raise InputError(f"{self._origin}: {name} is {short(value)}, must be {need}")
        return os.path.expanduser(value) if isinstance(value, str) else value

    def paths(self, name: str) -> list[str]:
        """A parameter that holds one path or several, as a list without empty ones."""
        value = _plain(self._node.get_parameter(name).value) or []
        paths = value if isinstance(value, list) else [value]
        wrong = [path for path in paths if not isinstance(path, str) or config.BROKEN.search(path)]
        if wrong:
            raise InputError(f"{self._origin}: {name} holds {short(wrong[0])}, must be a path or a list of paths; put it between quotes")
        return [os.path.expanduser(path) for path in paths if path]

    def settings(self, changes: Mapping[str, Any] | None = None) -> config.Settings:
        """The tree as files and parameters say it, with `changes` on top. Raises InputError."""
        values = {name: _plain(self._node.get_parameter(name).value) for name in self._declared}
        return config.build(self._kept | values | dict(changes or {}), self._origin)

    def _declare(self, name: str, default: Any, descriptor: ParameterDescriptor, given: Mapping[str, Any]) -> None:
        if name in given:
            self._node.set_descriptor(name, descriptor)
        else:
            self._node.declare_parameter(name, default, descriptor)

    def _check(self, changed: list[Parameter]) -> SetParametersResult:
        try:
            self.settings({p.name: _plain(p.value) for p in changed if p.name in self._declared})
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def _describe(leaf: config.Leaf) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=leaf.doc + (f" [{leaf.unit}]" if leaf.unit else ""), additional_constraints=leaf.range_text, dynamic_typing=True
    )
    if not leaf.is_list and leaf.low is not None and leaf.high is not None:
        if leaf.kind is int:
            descriptor.integer_range = [IntegerRange(from_value=int(leaf.low), to_value=int(leaf.high), step=1)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(leaf.low), to_value=float(leaf.high))]
    return descriptor


def _describe_own(item: Own) -> ParameterDescriptor:
    return ParameterDescriptor(description=item.doc, additional_constraints=", ".join(item.choices), read_only=True, dynamic_typing=True)


def _need(item: Own, value: Any) -> str:
    """What a node's own parameter would have to be; empty where it is that already."""
    if item.choices and value not in item.choices:
        return f"one of {', '.join(item.choices)}"
    if isinstance(item.default, str) and (not isinstance(value, str) or config.BROKEN.search(value)):
        return "text without control characters; put it between quotes"
    if isinstance(item.default, bool) and not isinstance(value, bool):
        return "true or false"
    if not isinstance(item.default, (bool, str, list)) and not (isinstance(value, (int, float)) and math.isfinite(value)):
        return "a number"
    return ""


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
