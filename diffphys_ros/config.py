"""ONE tree of settings: default, type, unit, range and a line of doc. Feeds the CLI, YAML files, ROS parameters and the
README's table; a name is written once, here, as a field."""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import InputError


def setting(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    length: int | None = None,
    path: bool = False,
) -> Any:
    """A field of the tree; `length` bounds lists, `path` marks a file relative to the YAML that names it."""
    meta = {"doc": doc, "unit": unit, "low": low, "high": high, "choices": choices, "length": length, "path": path}
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata=meta)
    return field(default=default, metadata=meta)


@dataclass(frozen=True)
class Scene:
    """What a person knows about the clip. All optional."""

    mass_kg: float | None = setting(None, "mass of the object", unit="kg", low=1e-6, high=1e5)
    density_kg_m3: list[float] | None = setting(None, "density, one value or one per part", unit="kg/m^3", low=1.0, high=3e4)
    poisson_ratio: list[float] | None = setting(None, "Poisson's ratio, one value or one per part; the prior's where not given, else 0.3", low=0.0, high=0.49)
    thickness_m: float | None = setting(None, "largest extent along thickness_axis", unit="m", low=1e-4, high=10.0)
    size_m: float | None = setting(None, "largest extent of the object as the camera sees it in frame 0; fixes the scale where neither depth nor clamp does", unit="m", low=1e-4, high=1e3)
    thickness_axis: list[float] | None = setting(None, "world axis that the camera cannot see along", length=3)
    gravity_m_s2: list[float] | None = setting(None, "gravity in the world frame; none is assumed where it is not given", unit="m/s^2", low=-100.0, high=100.0, length=3)
    clamp_box_m: list[float] | None = setting(None, "box around the clamped face: xmin ymin zmin xmax ymax zmax, world frame", unit="m", length=6)
    floor_z_m: float | None = setting(None, "height of the floor, world frame; the simulated object does not pass it", unit="m")
    floor_friction: float = setting(0.5, "Coulomb friction between object and floor", low=0.0, high=10.0)
    first_mask: str | None = setting(None, "PNG of the object in frame 0: part labels, or 0/255 for background/object", path=True)
    at_rest: bool = setting(False, "frame 0 is still and in static equilibrium")


@dataclass(frozen=True)
class CameraSettings:
    """For videos and image folders, which carry no camera_info."""

    fov_deg: float | None = setting(None, "horizontal field of view", unit="deg", low=1.0, high=170.0)
    fps: float | None = setting(None, "frame rate", unit="Hz", low=0.1, high=2000.0)


@dataclass(frozen=True)
class Topics:
    """Which topics of a bag to read; found by type and encoding where empty."""

    image: str | None = setting(None, "colour images (Image or CompressedImage)")
    depth: str | None = setting(None, "depth images (16UC1 in mm or 32FC1 in m); 'none' leaves depth out")
    camera_info: str | None = setting(None, "camera_info of the colour images")
    mask: str | None = setting(None, "label images (mono8): the one nearest to frame 0 says what the object is, as scene.first_mask does")


@dataclass(frozen=True)
class Segment:
    """Object mask and part labels."""

    method: str = setting(
        "auto",
        "object mask in frame 0; auto: given where first_mask or a mask topic is, else sam where segment.model is set, else motion",
        choices=("auto", "given", "motion", "otsu", "sam"),
    )
    model: str | None = setting(None, "SAM or SAM 2 checkpoint of transformers: a folder or a hub id; its prompt is box_px, point_px or what moves")
    box_px: list[float] | None = setting(None, "box around the object in frame 0: left top right bottom", unit="px", length=4)
    point_px: list[float] | None = setting(None, "point on the object in frame 0: u v", unit="px", length=2)
    max_parts: int = setting(3, "most parts that colour may split the object into", low=1, high=8)


@dataclass(frozen=True)
class DepthSettings:
    """Depth of the object's surface in frame 0."""

    source: str = setting(
        "auto",
        "auto: topic where the clip has depth, else capture where depth.capture is set, else network where depth.model is set, else inflate",
        choices=("auto", "topic", "capture", "network", "inflate", "plane"),
    )
    capture: str | None = setting(None, "folder that `diffphys capture` wrote with this clip: depth, camera and, where not given, thickness come from it", path=True)
    model: str | None = setting(None, "depth-estimation checkpoint of transformers (MiDaS/DPT, Depth Anything, ZoeDepth): a folder or a hub id")


@dataclass(frozen=True)
class CaptureSettings:
    """Pictures of the still object from all around."""

    every: int = setting(0, "frames of a video or recording from one picture to the next; 0: chosen to take about 60", low=0, high=10_000)
    max_side_px: int = setting(1600, "longer side to which larger pictures are brought", unit="px", low=160, high=10_000)
    lens: str = setting("opencv", "model of the pictures' camera where no camera_info says it; opencv: with radial and tangential distortion", choices=("opencv", "pinhole"))
    same_camera: bool = setting(False, "the pictures were taken with the clip's camera, at its size")
    matching: str = setting("auto", "pairs of pictures that are compared; auto: all of up to 60 pictures, else neighbours in time", choices=("auto", "exhaustive", "sequential"))
    positions: str | None = setting(None, "text file of known camera positions, lines `picture x y z` in metres; at least three give scale and world frame", path=True)
    max_gaussians: int = setting(30_000, "most Gaussians of the scene; 0: none are trained", low=0, high=10_000_000)


@dataclass(frozen=True)
class TrackSettings:
    """Surface points followed through the clip."""

    spacing_px: int = setting(4, "distance of seed points", unit="px", low=1, high=64)
    window_px: int = setting(15, "side of the matching window", unit="px", low=5, high=63)
    round_trip_px: float = setting(0.4, "largest forward-backward error", unit="px", low=0.01, high=10.0)


@dataclass(frozen=True)
class ParticleSettings:
    """Filling of the solid and the grid that fits it."""

    cells: int = setting(0, "grid cells over the thickness; 0: chosen to end inside fit.time_budget_s", low=0, high=32)
    per_cell: float = setting(0.0, "particles per cell and axis; 0: chosen", low=0.0, high=4.0)
    grid_nodes: int | None = setting(None, "most nodes along any side of the grid, in place of particles.cells (the paper's 64 or 128)", low=16, high=512)
    downsample_ratio: float = setting(0.0, "share of the Gaussians and a dense interior behind them that is kept as particles (paper Table 3); 0: particles on a lattice, which bends more truly", low=0.0, high=1.0)


@dataclass(frozen=True)
class PriorSettings:
    """What is believed of the material before the motion is looked at."""

    source: str = setting("none", "density, Poisson's ratio and, where the clip has no free tail, Young's modulus by: a YAML file, named materials, a vision-language model", choices=("none", "file", "database", "model"))
    file: str | None = setting(None, "YAML file of materials for source file", path=True)
    materials: list[str] | None = setting(None, "materials of the database, one or one per part, for source database and where a model does not answer")
    base_url: str | None = setting(None, "OpenAI-compatible endpoint of the model, such as https://api.openai.com/v1; it is sent frame 0 of the object")
    model: str | None = setting(None, "name of a model of that endpoint which reads images")
    api_key_env: str = setting("OPENAI_API_KEY", "environment variable that holds the endpoint's key; none is sent where it is not set")
    timeout_s: float = setting(60.0, "longest time for one answer of the model", unit="s", low=0.1, high=3600.0)
    attempts: int = setting(3, "most requests to the model, counting those that tell it what was wrong with its answer", low=1, high=10)
    cache: str | None = setting(None, "folder of the model's earlier answers; ~/.cache/diffphys_ros/prior where not given", path=True)


@dataclass(frozen=True)
class Modes:
    """Start values from eigenmodes."""

    start_scale: float = setting(1.0, "factor on the first guess of Young's modulus, to check that the search forgets it", low=0.01, high=100.0)
    count: int = setting(8, "eigenmodes kept", low=1, high=40)


@dataclass(frozen=True)
class SplatSettings:
    """3D Gaussians."""

    max_count: int = setting(0, "most Gaussians; 0: as the size and detail of the picture ask for", low=0, high=1_000_000)
    iterations: int = setting(100, "steps of the fit to frame 0", low=1, high=100_000)
    refine_frames: int = setting(12, "frames of the clip to which the Gaussians are fitted once the motion is recovered; 0: frame 0 alone", low=0, high=10_000)
    view_iterations: int = setting(2000, "steps of a fit to many views of a still scene", low=1, high=100_000)


@dataclass(frozen=True)
class Fit:
    """The inverse solver."""

    time_budget_s: float | None = setting(None, "for a whole clip; cells, particles and iterations are chosen to end inside it; 120 on a GPU, 900 on a CPU where not given", unit="s", low=1.0, high=1e6)
    iterations: int = setting(0, "iterations of the joint fit; 0: chosen", low=0, high=100_000)
    schedule: str = setting("auto", "auto: modes where the clip has a free tail, else joint from a guess", choices=("auto", "modes", "joint"))
    law: str = setting("neo_hookean", "elastic law of the material: neo_hookean, fixed_corotated, linear_corotated or st_venant_kirchhoff")
    material_field: str = setting("part", "part: constants per part; residual: corrected from point to point by a triplane; triplane: a triplane alone, pretrained on them", choices=("part", "residual", "triplane"))
    force_field: str = setting("frame", "frame: one vector per frame under a footprint; on top of it modes: smooth shapes along the object, voxels: features per voxel and frame, planes: a triplane over x, y and time", choices=("frame", "modes", "voxels", "planes"))
    force_frame: str = setting("rest", "where such a force field is asked; rest: at rest positions, so that it moves with the body; current: where each particle is when the frame starts, so that it stays in space (paper Eq. 9)", choices=("rest", "current"))
    field_iterations: int = setting(40, "iterations of L-BFGS for fields that are more than constants per part and vectors per frame", low=1, high=100_000)
    force_smoothness: float = setting(1e-3, "weight of the roughness of such a force field (paper A.14)", low=0.0, high=1e3)
    max_substeps: int = setting(2000, "most substeps per frame; bounds the allowed Young's modulus, not the time step", low=4, high=100_000)
    start_scale: float = setting(1.0, "factor on the start values of Young's modulus, to check that the solver forgets it", low=0.1, high=10.0)
    image_weight: float = setting(1.0, "weight of the image term; at 1 it bends the loss about as much as the track term", low=0.0, high=1e3)
    ssim_weight: float = setting(0.2, "weight of 1 - SSIM beside the masked L2 (paper A.13)", low=0.0, high=1e3)
    track_weight: float = setting(1.0, "weight of the track term", low=0.0, high=1e3)
    depth_weight: float = setting(0.1, "weight of the depth term", low=0.0, high=1e3)
    image_every: int = setting(0, "frames between two that enter the image term; 0: chosen", low=0, high=1000)
    checkpoint_every_s: float = setting(60.0, "time between checkpoints on disk", unit="s", low=0.1, high=1e5)
    device: str = setting("auto", "auto, cpu or cuda:0")
    seed: int = setting(0, "seed of everything random", low=0, high=2**31 - 1)


@dataclass(frozen=True)
class MetricSettings:
    """Figures of a result beside the losses."""

    lpips_backbone: str | None = setting(None, "torchvision's AlexNet or VGG-16 state dict, .pth or .safetensors; LPIPS is left out without it", path=True)
    lpips_heads: str | None = setting(None, "linear heads of LPIPS 0.1 for that network (alex.pth or vgg.pth)", path=True)


@dataclass(frozen=True)
class Playback:
    """How a node replays the recovered motion."""

    rate: float = setting(1.0, "speed relative to the recording", low=0.01, high=100.0)
    loop: bool = setting(True, "start over at the end")


@dataclass(frozen=True)
class Publish:
    """Size of what is published."""

    max_points: int = setting(20_000, "most particles in a cloud; fewer carry larger volumes, the sum of f * volume is kept", low=1, high=10_000_000)
    max_markers: int = setting(300, "most arrows in a marker array", low=0, high=500)


@dataclass(frozen=True)
class Settings:
    """The whole tree."""

    scene: Scene = field(default_factory=Scene)
    camera: CameraSettings = field(default_factory=CameraSettings)
    topics: Topics = field(default_factory=Topics)
    segment: Segment = field(default_factory=Segment)
    depth: DepthSettings = field(default_factory=DepthSettings)
    capture: CaptureSettings = field(default_factory=CaptureSettings)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    particles: ParticleSettings = field(default_factory=ParticleSettings)
    prior: PriorSettings = field(default_factory=PriorSettings)
    modes: Modes = field(default_factory=Modes)
    splats: SplatSettings = field(default_factory=SplatSettings)
    fit: Fit = field(default_factory=Fit)
    metrics: MetricSettings = field(default_factory=MetricSettings)
    playback: Playback = field(default_factory=Playback)
    publish: Publish = field(default_factory=Publish)


@dataclass(frozen=True)
class Leaf:
    """One setting: everything that a command line, a parameter description or a table needs."""

    name: str  # dotted
    kind: type  # bool, int, float or str: of the value, or of the elements of a list
    is_list: bool
    optional: bool  # whether null is allowed
    default: Any
    doc: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    length: int | None
    path: bool

    @property
    def range_text(self) -> str:
        """The allowed values in words."""
        if self.choices:
            return ", ".join(self.choices)
        low, high = (("" if v is None else f"{v:g}") for v in (self.low, self.high))
        return f"{low} .. {high}" if low or high else ""


def leaves() -> dict[str, Leaf]:
    """All settings by dotted name, in the order of the tree."""
    found = {}
    for group in dataclasses.fields(Settings):
        cls = group.default_factory  # type: ignore[misc]
        hints = typing.get_type_hints(cls)
        for f in dataclasses.fields(cls):  # type: ignore[arg-type]
            kind, is_list, optional = _kind(hints[f.name])
            default = f.default if f.default is not dataclasses.MISSING else f.default_factory()  # type: ignore[misc,operator]
            found[f"{group.name}.{f.name}"] = Leaf(
                f"{group.name}.{f.name}", kind, is_list, optional, default, **{k: f.metadata[k] for k in f.metadata}
            )
    return found


def build(values: Mapping[str, Any], origin: str = "settings") -> Settings:
    """Settings from dotted names; checks every value. Raises InputError that names origin, setting and bound."""
    known: dict[str, Leaf] = leaves()
    groups: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        if name not in known:
            raise InputError(f"{origin}: unknown setting {name!r}{_nearest(name, known)}")
        group, key = name.split(".")
        groups.setdefault(group, {})[key] = _checked(known[name], value, origin)
    return Settings(**{g.name: g.default_factory(**groups.get(g.name, {})) for g in dataclasses.fields(Settings)})  # type: ignore[operator]


def flat(settings: Settings) -> dict[str, Any]:
    """Dotted names and values of a tree; build(flat(s)) == s."""
    return {f"{g}.{k}": v for g, group in dataclasses.asdict(settings).items() for k, v in group.items()}


def flatten(tree: Mapping[str, Any], origin: str) -> dict[str, Any]:
    """Dotted names of a nested mapping as a YAML file holds it."""
    found: dict[str, Any] = {}
    for group, entries in tree.items():
        if not isinstance(entries, Mapping):
            if "." in str(group):
                found[str(group)] = entries
                continue
            raise InputError(f"{origin}: {group!r} must be a group of settings, such as 'scene:' with indented names below")
        found |= {f"{group}.{key}": value for key, value in entries.items()}
    return found


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Dotted names and values of a YAML file; relative paths in it are relative to it."""
    import yaml

    path = Path(path)
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except OSError as error:
        raise InputError(f"config {path}: {error.strerror or error}; give the path of a readable YAML file") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"config {path}: not valid YAML ({' '.join(str(error).split())[:200]}); correct the file") from error
    if not isinstance(tree, Mapping):
        raise InputError(f"config {path}: must hold groups of settings, such as 'scene:' with indented names below")
    known, values = leaves(), flatten(tree, f"config {path}")
    for name, value in values.items():
        if name in known and known[name].path and isinstance(value, str) and not Path(value).is_absolute():
            values[name] = str((path.parent / value).resolve())
    build(values, f"config {path}")
    return values


def layered(
    configs: Iterable[str | Path] = (), flags: Mapping[str, Any] | None = None, *, base: Mapping[str, Any] | None = None
) -> Settings:
    """Settings from `base` (dotted names), then YAML files, later ones winning, then flags, which win over files."""
    values: dict[str, Any] = dict(base or {})
    for path in configs:
        values |= read_yaml(path)
    return build(values | dict(flags or {}), "command line" if flags else "settings")


def parse_text(leaf: Leaf, text: str) -> Any:
    """The value that a command-line word stands for (YAML notation: 0.8, true, null, '[0, 0, -9.81]')."""
    import yaml

    if leaf.kind is str and not leaf.is_list:
        return None if text in ("null", "") and leaf.optional else text
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return text


def _kind(hint: Any) -> tuple[type, bool, bool]:
    optional = isinstance(hint, types.UnionType) and type(None) in hint.__args__
    if optional:
        hint = next(a for a in hint.__args__ if a is not type(None))
    if typing.get_origin(hint) is list:
        return hint.__args__[0], True, optional
    return hint, False, optional


def _nearest(name: str, known: Mapping[str, Leaf]) -> str:
    close = difflib.get_close_matches(name, known, 1, 0.4)
    return f"; did you mean {close[0]!r}?" if close else "; the known groups are " + ", ".join(f.name for f in dataclasses.fields(Settings))


def _checked(leaf: Leaf, value: Any, origin: str) -> Any:
    if value is None or (leaf.optional and leaf.is_list and value == []):
        if not leaf.optional:
            raise InputError(f"{origin}: {leaf.name} must not be null; leave it out for its default {leaf.default}")
        return None
    if not leaf.is_list:
        return _scalar(leaf, value, origin)
    items = list(value) if isinstance(value, (list, tuple)) else [value]
    if leaf.length and len(items) != leaf.length:
        raise InputError(f"{origin}: {leaf.name} has {len(items)} numbers, needs {leaf.length}")
    if not items:
        raise InputError(f"{origin}: {leaf.name} is empty; give at least one number")
    return [_scalar(leaf, item, origin) for item in items]


def _scalar(leaf: Leaf, value: Any, origin: str) -> Any:
    def wrong(need: str) -> InputError:
        return InputError(f"{origin}: {leaf.name} is {value!r}, must be {need}")

    if leaf.kind is str:
        if not isinstance(value, str):
            raise wrong("text")
        if leaf.choices and value not in leaf.choices:
            raise wrong("one of " + ", ".join(leaf.choices))
        return value
    if leaf.kind is bool:
        if not isinstance(value, bool):
            raise wrong("true or false")
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise wrong("a number" + (f" in {leaf.unit}" if leaf.unit else ""))
    if not math.isfinite(value):
        raise wrong("finite")
    if (leaf.low is not None and value < leaf.low) or (leaf.high is not None and value > leaf.high):
        raise wrong(f"in {leaf.range_text}" + (f" {leaf.unit}" if leaf.unit else ""))
    if leaf.kind is int:
        if value != int(value):
            raise wrong("a whole number")
        return int(value)
    return float(value)
