"""ONE tree of settings. Feeds the CLI, YAML files, ROS parameters and the README's table."""

from .files import flatten, layered, parse_text, read_text, read_yaml
from .leaf import BROKEN, Leaf, leaves
from .plain_yaml import loaded
from .tree import (
    TIME_BUDGET_S,
    CameraSettings,
    CaptureSettings,
    DepthSettings,
    Fit,
    MetricSettings,
    Modes,
    ParticleSettings,
    Playback,
    PriorSettings,
    Publish,
    Scene,
    Segment,
    Settings,
    SplatSettings,
    Topics,
    TrackSettings,
)
from .values import build, flat

__all__ = [
    "BROKEN",
    "TIME_BUDGET_S",
    "CameraSettings",
    "CaptureSettings",
    "DepthSettings",
    "Fit",
    "Leaf",
    "MetricSettings",
    "Modes",
    "ParticleSettings",
    "Playback",
    "PriorSettings",
    "Publish",
    "Scene",
    "Segment",
    "Settings",
    "SplatSettings",
    "Topics",
    "TrackSettings",
    "build",
    "flat",
    "flatten",
    "layered",
    "leaves",
    "loaded",
    "parse_text",
    "read_text",
    "read_yaml",
]
