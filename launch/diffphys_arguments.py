"""The arguments of the launch files and what the nodes get of them: plain values, without `launch`. They stand beside the launch files, because
`ros2 launch` may run under a Python that does not see the package."""

from __future__ import annotations

import atexit
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import yaml

YES = ("true", "1", "yes", "on")


def one_or_several(text: str) -> str | list[str]:
    """A path, or the paths of a list in YAML, as a parameter on the command line has it."""
    return [str(path) for path in yaml.safe_load(text)] if text.startswith("[") and text.endswith("]") else text


class Argument(NamedTuple):
    """Of a launch file. One that is empty, or false, is not handed on, so that the node's own default holds."""

    default: str
    doc: str
    kind: Callable[[str], Any] = str  # as a parameter of a node


NODE = {
    "config": Argument("", "YAML file of settings, as for the command line; or several, [A.yaml, B.yaml], of which later ones win", one_or_several),
    "params_file": Argument("", "ROS file of parameters, as for --params-file"),
    "namespace": Argument("", "namespace of the nodes"),
    "use_sim_time": Argument("false", "take the time from /clock", bool),
    "log_level": Argument("info", "debug, info, warn, error or fatal"),
    "respawn": Argument("false", "start a node again, two seconds after it ended by itself or was killed", bool),
}
SETTINGS = {
    "device": Argument("", "cpu, cuda or cuda:1; empty: as the settings say"),
    "time_budget_s": Argument("", "for a whole fit [s]; empty: as the settings say", float),
    "target_frame": Argument("", "frame of the transforms that is the world, z up; empty: as the settings say"),
}
FIT = {
    "out": Argument("", "folder for the results; empty: none are written"),
    "exit_when_done": Argument("false", "end the process, and with it the launch, when the result is there", bool),
}
BAG = {"bag": Argument("", "recording: MCAP file, .db3 file, rosbag2 folder, video or folder of images")}
PLAY = {
    "rate": Argument("0.0", "speed at which the recording is played, with /clock; 0: its clip is read at once", float),
    "loop": Argument("false", "play the recording again and again", bool),
    "start": Argument("0.0", "of the recording, left out at the beginning [s]", float),
    "duration": Argument("0.0", "of the recording, taken at most [s]; 0: to its end", float),
}
INPUTS = {name: Argument(name, f"topic that ingest_node takes as {name}") for name in ("image", "depth", "mask", "camera_pose", "imu")} | {
    "camera_info": Argument("", "topic that ingest_node takes as camera_info; empty: the one beside the image, as drivers have it"),
    "depth_camera_info": Argument("", "topic that ingest_node takes as depth_camera_info; empty: the one beside a depth that is given"),
}
MARKS = {name: Argument(name, f"topic that segment_node takes as {name}") for name in ("click", "first_mask")}
LINES = {name: Argument(name, f"topic on which two points one after the other draw {what}") for name, what in (("clamp_click", "scene.clamp_px"), ("length_click", "scene.length_px"))}
INSPECT = {
    "rrd": Argument("diffphys.rrd", "rerun recording that inspect_node writes; earlier ones are kept"),
    "viewer": Argument("", "rerun viewer instead: a grpc URL, spawn, or web for a page at web_port"),
    "web_port": Argument("9090", "of the page; its data come from the next port", int),
}
VIEWERS = {
    "rviz": Argument("false", "open RViz with config/diffphys.rviz", bool),
    "fixed_frame": Argument("world", "of RViz: the frame of the results"),
    "foxglove": Argument("false", "start foxglove_bridge on port 8765; import config/foxglove.json in Foxglove", bool),
}
DRAWN_ON = ("segment_node", "splat_node", "fit_node")  # the nodes that take LINES
# Topics that config/diffphys.rviz names: a namespace goes before them.
SHOWN = (
    *(f"/fit_node/{name}" for name in ("material_field", "state", "force_markers", "stiffness_markers", "net_force", "rendered", "camera_info")),
    "/clip/image",
    "/click",
    "/clamp_click",
    "/length_click",
)
SHOWS = {
    "inspect": Argument("true", "start inspect_node", bool),
    "composed": Argument("false", "all nodes in one process", bool),
    "reliability": Argument("best_effort", "of the camera's topics: best_effort or reliable"),
    "image_transport": Argument("any", "in which images are heard: any, raw or compressed"),
    "depth_transport": Argument("any", "in which depth is heard: any, raw or compressedDepth"),
    "clip_trigger": Argument("always", "what opens a clip: always, manual (~/record) or motion"),
    "clip_seconds": Argument("10.0", "how much of a camera that does not stop is kept, and the longest clip that ~/record or motion opens [s]", float),
    "silence_s": Argument("2.0", "a clip ends after this long without an image [s]", float),
}
LOOKS = {
    "rerun": Argument("true", "start inspect_node, which writes a rerun recording or feeds a viewer", bool),
    "fit_node": Argument("fit_node", "name of the fit node to look at"),
}
# A launch file's arguments, and which of them each of its nodes gets: {argument: parameter}.
ARGUMENTS = {
    "fit": {**BAG, **FIT, **SETTINGS, **NODE, **VIEWERS, "inspect": Argument("false", "start inspect_node beside it", bool), **INSPECT},
    "graph": {**INPUTS, **MARKS, **LINES, **SHOWS, **BAG, **PLAY, **FIT, **SETTINGS, **NODE, **VIEWERS, **INSPECT},
    "inspect": {**INSPECT, **LOOKS, **VIEWERS, **NODE},
}
_ALL = {"config": "config", "use_sim_time": "use_sim_time"}
_WORLD, _DEVICE = {"target_frame": "scene.target_frame"}, {"device": "fit.device"}
_FIT = _ALL | _WORLD | _DEVICE | {"out": "out", "exit_when_done": "exit_when_done", "time_budget_s": "fit.time_budget_s"}
_AS_CALLED = ("reliability", "image_transport", "depth_transport", "silence_s", "bag", *PLAY)
_INSPECT = _ALL | {"rrd": "file", "viewer": "viewer", "web_port": "web_port"}
GETS = {
    "fit": {"fit_node": _FIT | {"bag": "bag"}, "inspect_node": _INSPECT},
    "graph": {
        "ingest_node": _ALL | _WORLD | {"clip_trigger": "clip.trigger", "clip_seconds": "clip.seconds"} | {name: name for name in _AS_CALLED},
        "segment_node": _ALL | _WORLD | _DEVICE,
        "splat_node": _ALL | _WORLD | _DEVICE,
        "fit_node": _FIT,
        "inspect_node": _INSPECT,
    },
    "inspect": {"inspect_node": _INSPECT | {"fit_node": "fit_node"}},
}


def said(given: dict[str, str], name: str) -> bool:
    """Whether an argument says yes."""
    return given.get(name, "false").lower() in YES


def parameters(launch: str, node: str, given: dict[str, str]) -> dict[str, Any]:
    """Parameters of a node of a launch file, in their kinds, by the values of its arguments; those that keep their default are left to the node."""
    found: dict[str, Any] = {}
    for argument, parameter in GETS[launch][node].items():
        each, value = ARGUMENTS[launch][argument], given[argument]
        if each.kind is bool:
            found |= {parameter: True} if said(given, argument) else {}
        elif value != each.default:
            found[parameter] = each.kind(value)
    return found


def file_of_all(launch: str, nodes: list[str], given: dict[str, str]) -> str:
    """A ROS file of the parameters of several nodes, which is there until the launch ends: the nodes read it when they start."""
    text = yaml.safe_dump({f"/**/{name}": {"ros__parameters": own} for name in nodes if (own := parameters(launch, name, given))})
    with tempfile.NamedTemporaryFile("w", prefix="diffphys_ros_", suffix=".yaml", delete=False) as file:
        atexit.register(Path(file.name).unlink, missing_ok=True)
        file.write(text)
    return file.name


def renamed(node: str, given: dict[str, str]) -> list[tuple[str, str]]:
    """The topics that a node of the graph hears under other names. Compressed images follow the raw ones by themselves."""
    if node in DRAWN_ON:
        return [(name, given[name]) for name in ((*MARKS, *LINES) if node == "segment_node" else LINES)]
    if node != "ingest_node":
        return []
    depth_info = beside(given["depth"]) if given["depth"] != INPUTS["depth"].default else "depth_camera_info"
    missing = {"camera_info": beside(given["image"]), "depth_camera_info": depth_info}
    return [(name, given[name] or missing[name]) for name in INPUTS]


def beside(image: str) -> str:
    """Where a driver publishes the camera_info of a topic of images."""
    space, slash, _ = image.rpartition("/")
    return f"{space}{slash}camera_info"
