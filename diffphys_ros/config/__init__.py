"""ONE tree of settings. Feeds the CLI, YAML files, ROS parameters and the table of docs/settings.md."""

from .files import flatten, layered, parse_text, read_text, read_yaml
from .leaf import BROKEN, Leaf, leaves
from .moved import REMOVED, RENAMED, moved
from .plain_yaml import loaded
from .readers import READERS, read_by, require_read
from .tree import (
    EXPERIMENT,
    HEADINGS,
    LONGEST_BUDGET_S,
    TIME_BUDGET_S,
    CameraSettings,
    CaptureSettings,
    DepthSettings,
    Experiment,
    Fit,
    FrameSettings,
    Playback,
    PriorSettings,
    Publish,
    Scene,
    Segment,
    Settings,
    Sync,
    Topics,
)
from .values import build, flat
from .words import flags_of

__all__ = [
    "BROKEN",
    "EXPERIMENT",
    "HEADINGS",
    "LONGEST_BUDGET_S",
    "READERS",
    "REMOVED",
    "RENAMED",
    "TIME_BUDGET_S",
    "CameraSettings",
    "CaptureSettings",
    "DepthSettings",
    "Experiment",
    "Fit",
    "FrameSettings",
    "Leaf",
    "Playback",
    "PriorSettings",
    "Publish",
    "Scene",
    "Segment",
    "Settings",
    "Sync",
    "Topics",
    "build",
    "flags_of",
    "flat",
    "flatten",
    "layered",
    "leaves",
    "loaded",
    "moved",
    "parse_text",
    "read_by",
    "read_text",
    "read_yaml",
    "require_read",
]
