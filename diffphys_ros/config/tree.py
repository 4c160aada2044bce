"""ONE tree of settings: default, type, unit, range and a line of doc. A name is written once, here, as a field."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any


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
    pattern: str = "",
) -> Any:
    """A field of the tree; `length` bounds lists, `path` marks a file relative to the YAML that names it, `pattern` is a regular
    expression of what `doc` says in words."""
    meta = {"doc": doc, "unit": unit, "low": low, "high": high, "choices": choices, "length": length, "path": path, "pattern": pattern}
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata=meta)
    return field(default=default, metadata=meta)


@dataclass(frozen=True)
class Scene:
    """What a person knows about the clip. All optional."""

    mass_kg: float | None = setting(None, "mass of the object", unit="kg", low=1e-6, high=1e5)
    density_kg_m3: list[float] | None = setting(None, "density, one value or one per part: numbered from the clamp outwards, those equally far from left to right", unit="kg/m^3", low=1.0, high=3e4)
    poisson_ratio: list[float] | None = setting(None, "Poisson's ratio, one value or one per part; where not given, what the free motion makes of the prior's, or of 0.3", low=0.0, high=0.49)
    thickness_m: float | None = setting(None, "largest extent along thickness_axis", unit="m", low=1e-4, high=10.0)
    size_m: float | None = setting(None, "largest extent of the object as the camera sees it in frame 0, or what length_px marks; fixes the scale where neither depth nor clamp_box_m does", unit="m", low=1e-4, high=1e3)
    length_px: list[float] | None = setting(None, "two points of frame 0, size_m apart and as far away as the object: [[u, v], [u, v]]", unit="px", length=4)
    thickness_axis: list[float] | None = setting(None, "world axis that the camera cannot see along", length=3)
    gravity_m_s2: list[float] | None = setting(None, "gravity in the world frame; none is assumed where it is not given", unit="m/s^2", low=-100.0, high=100.0, length=3)
    down_px: list[float] | None = setting(None, "direction of gravity in the picture, in place of gravity_m_s2: [0, 1] is straight down; the camera is taken to be level", unit="px", length=2)
    clamp_box_m: list[float] | None = setting(None, "box around the clamped face: xmin ymin zmin xmax ymax zmax, world frame", unit="m", low=-1e6, high=1e6, length=6)
    clamp_px: list[float] | None = setting(None, "line in the reference frame along which the object is held, in place of clamp_box_m: [[u, v], [u, v]]; what lies beyond it is no part of the body; the edge of the picture where the clamp may lie beyond it", unit="px", length=4)
    floor_z_m: float | None = setting(None, "height of the floor, world frame; the simulated object does not pass it", unit="m", low=-1e6, high=1e6)
    floor_px: list[float] | None = setting(None, "line in frame 0 where the floor is at the object, seen from its side, in place of floor_z_m: [[u, v], [u, v]]", unit="px", length=4)
    floor_friction: float = setting(0.5, "Coulomb friction between object and floor", low=0.0, high=10.0)
    first_mask: str | None = setting(None, "PNG of the object in frame 0: part labels, or 0/255 for background/object", path=True)
    at_rest: bool = setting(False, "frame 0 is still and in static equilibrium")
    rest_frame: int | None = setting(None, "frame of the clip, counted from 0, in which the object is nearest to rest; found for an object that is seen by its outline, 0 where points are followed", low=0, high=5000)
    target_frame: str | None = setting(None, "frame of the transforms that is the world, z up (the camera's own: settings are meant in that); the root of the camera's tree where not given")

    @property
    def thickness_unit(self) -> list[float] | None:
        """thickness_axis at length 1, however long or short it was given; zeros where it has no direction."""
        if self.thickness_axis is None:
            return None
        largest = max(map(abs, self.thickness_axis))
        scaled = [value / largest if largest else 0.0 for value in self.thickness_axis]
        length = math.hypot(*scaled) or 1.0
        return [value / length for value in scaled]

    @property
    def tells_clamp(self) -> bool:
        """Whether it is said what holds the object."""
        return self.clamp_box_m is not None or self.clamp_px is not None

    @property
    def tells_floor(self) -> bool:
        """Whether it is said where a floor lies."""
        return self.floor_z_m is not None or self.floor_px is not None

    @property
    def thrown(self) -> bool:
        """Whether nothing holds the object, above a floor that is told."""
        return self.tells_floor and not self.tells_clamp


@dataclass(frozen=True)
class FrameSettings:
    """Which frames of a recording are fitted, and which are kept back to be predicted."""

    every: int = setting(1, "frames of the recording from one that is taken to the next; 1: all are. The other settings count what is taken", low=1, high=1000)
    fit: int = setting(0, "frames that are fitted, from the first on; 0: all but those of frames.predict", low=0, high=5000)
    predict: int = setting(0, "frames after them that the fit never sees; how well its answer, let free, predicts them stands in metrics.json", low=0, high=5000)


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
    imu: str | None = setting(None, "Imu that rests, for the direction of gravity; 'none' leaves it out")
    mask: str | None = setting(None, "label images (mono8): the one nearest to frame 0 says what the object is, as scene.first_mask does")


@dataclass(frozen=True)
class Sync:
    """Which images belong together."""

    slop_s: float | None = setting(None, "longest time between a colour image and its depth image; half a frame period where not given", unit="s", low=0.0, high=10.0)


@dataclass(frozen=True)
class Segment:
    """Object mask and part labels."""

    method: str = setting(
        "auto",
        "object mask in frame 0; auto: given where first_mask or a mask topic is, else sam where segment.model is set, else motion; flow: sam where segment.model is set, else everything that moves however little, strands and holes as they are",
        choices=("auto", "given", "motion", "flow", "otsu", "sam"),
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
    """What of the object is followed."""

    evidence: str = setting("auto", "points: textured points of the surface; outline: the edge of an object without texture; auto: points where enough of them can be followed, else the outline", choices=("auto", "points", "outline"))


@dataclass(frozen=True)
class PriorSettings:
    """What is believed of the material before the motion is looked at, by one of: a file, names of the database, a vision-language model."""

    file: str | None = setting(None, "YAML file of materials: density, Poisson's ratio and, where the clip has no free tail, Young's modulus", path=True)
    materials: list[str] | None = setting(None, "materials of the database, one or one per part; with a model, those to take where it does not answer")
    base_url: str | None = setting(None, "OpenAI-compatible endpoint of the model, such as https://api.openai.com/v1; it is sent frame 0 of the object")
    model: str | None = setting(None, "name of a model of that endpoint which reads images")
    api_key_env: str = setting("OPENAI_API_KEY", "environment variable that holds the endpoint's key; none is sent where it is not set")

    @property
    def source(self) -> str:
        """Which of them it is: none, file, database or model."""
        return "model" if self.base_url or self.model else "file" if self.file else "database" if self.materials else "none"


TIME_BUDGET_S = {"cpu": 900.0, "cuda": 120.0}  # of a whole clip, from reading to files, where fit.time_budget_s is not given
LONGEST_BUDGET_S = {"cpu": 900.0, "cuda": 450.0}  # the same where fields have to carry the video: a search in every frame [docs/paper.md: 395 to 415 s for 62 frames of 1024 x 576]


@dataclass(frozen=True)
class Fit:
    """The inverse solver."""

    time_budget_s: float | None = setting(None, "for a whole clip; cells, particles and iterations are chosen to end inside it; where not given 900 on a CPU, 120 on a GPU and 450 where neither modes nor one simulated force explain the motion", unit="s", low=1.0, high=1e6)
    iterations: int = setting(0, "iterations of the joint fit; 0: chosen", low=0, high=100_000)
    hold: list[str] | None = setting(None, "unknowns that stay as they are told, assumed or begun with: young, damping, force, motion (of frame 0), density, poisson; density and poisson where not given; none: all are sought")
    prescribe: str | None = setting(None, "result of an earlier run (its folder): what fit.hold names of young, damping and force has its values", path=True)
    law: str = setting("neo_hookean", "elastic law of the material")
    material_field: str = setting("part", "part: constants per part; residual: corrected from point to point by a triplane; triplane: a triplane alone, pretrained on them", choices=("part", "residual", "triplane"))
    force_field: str = setting("frame", "frame: one vector per frame under a footprint; on top of it modes: smooth shapes along the object, voxels: features per voxel and frame, planes: a triplane over x, y and time", choices=("frame", "modes", "voxels", "planes"))
    device: str = setting("auto", "auto, cpu or cuda:0", pattern=r"auto|cpu|cuda(:\d{1,3})?")


@dataclass(frozen=True)
class Playback:
    """How a node replays the recovered motion."""

    rate: float = setting(1.0, "speed relative to the recording", low=0.01, high=100.0)
    loop: bool = setting(True, "start over at the end")


@dataclass(frozen=True)
class Publish:
    """What of an answer is published."""

    max_points: int = setting(20_000, "most particles in a cloud; fewer carry larger volumes, the sum of f * volume is kept", low=1, high=10_000_000)
    allow_assumed_scale: bool = setting(False, "publish pascals and newtons although a density or a size is assumed; otherwise what is known without: E/density and force over mass, or ratios")


@dataclass(frozen=True)
class Experiment:
    """What reproductions and ablations change and nobody needs for a clip."""

    cells: int = setting(0, "grid cells over the thickness; 0: chosen to end inside fit.time_budget_s", low=0, high=32)
    per_cell: float = setting(0.0, "particles per cell and axis; 0: chosen", low=0.0, high=4.0)
    grid_nodes: int | None = setting(None, "most nodes along any side of the grid, in place of cells (the paper's 64 or 128)", low=16, high=512)
    downsample_ratio: float = setting(0.0, "share of the Gaussians and a dense interior behind them that is kept as particles (paper Table 3); 0: particles on a lattice, which bends more truly", low=0.0, high=1.0)
    sheet_share: float = setting(0.0, "thickness of the body over its longest side, at most, where scene.thickness_m is not told: a thin sheet with the gaps between its strands; 0: as thick as it is wide, without holes", low=0.0, high=1.0)
    soft_sd: float = setting(0.0, "schedule paper: standard deviations of the prior's log E by which it begins softer than the prior's mean", low=0.0, high=4.0)
    track_spacing_px: int = setting(4, "distance of seed points of the tracks", unit="px", low=1, high=64)
    track_window_px: int = setting(15, "side of the window that is matched", unit="px", low=5, high=63)
    track_round_trip_px: float = setting(0.4, "largest forward-backward error of a track", unit="px", low=0.01, high=10.0)
    mode_count: int = setting(8, "eigenmodes kept for the start values", low=1, high=40)
    schedule: str = setting("auto", "auto: modes where the clip has a free tail, else joint from a guess, and where neither explains the motion fields that carry the video; linear: by eigenmodes alone, without simulation, in seconds, for small motions; paper: the published one, for config/paper.yaml")
    force_frame: str = setting("rest", "where a force field is asked; rest: at rest positions, so that it moves with the body; current: where each particle is when the frame starts, so that it stays in space; nodes: at the nodes of the simulator's grid, on which it acts (paper Eq. 9), with the schedule paper", choices=("rest", "current", "nodes"))
    field_iterations: int = setting(40, "iterations for fields that are more than constants per part and vectors per frame: of L-BFGS over the whole clip, fewer with the schedule paper where nothing is gained any more", low=1, high=100_000)
    material_nodes: int = setting(24, "nodes of the planes of a material field along the body's longest side (paper Eq. 8)", low=2, high=512)
    material_channels: int = setting(16, "length of its feature vectors", low=1, high=256)
    force_voxels: int = setting(10, "voxels of a force field along the body's longest side (paper Eq. 9)", low=2, high=512)
    force_plane_nodes: int = setting(16, "nodes of the planes of a force field along the body's longest side (paper A.8)", low=2, high=512)
    force_channels: int = setting(8, "length of the feature vectors of a force field", low=1, high=256)
    decoder_width: int = setting(32, "width of the two hidden layers behind features", low=1, high=1024)
    transition_iterations: int = setting(150, "schedule paper: iterations of L-BFGS, at most, from one frame to the next (paper appendix D); 0: all frames are sought at once", low=0, high=100_000)
    coarse_px: int = setting(1, "schedule paper: side of the blocks over which pictures are averaged in the first third of the iterations from one frame to the next, so that what has moved by as much is found; 1: none", unit="px", low=1, high=64)
    frame_drag: float = setting(0.0, "schedule paper: mass damping times the period of a frame, beside the body's own: the velocity that a force leaves fades within so many of its inverse; 0: none, forces of both signs follow each other", low=0.0, high=100.0)
    warm_up_share: float = setting(0.25, "schedule paper: share of the iterations over the whole clip in which the material rests (paper section 3.5)", low=0.0, high=1.0)
    mask_margin_px: int = setting(0, "pixels around the object's mask that count in the image term as well, so that its outline does", unit="px", low=0, high=200)
    force_smoothness: float = setting(1e-3, "weight of the roughness of a force field (paper A.14)", low=0.0, high=1e3)
    max_substeps: int = setting(2000, "most substeps per frame; bounds the allowed Young's modulus, not the time step", low=4, high=100_000)
    image_weight: float = setting(1.0, "weight of the image term; at 1 it bends the loss about as much as the track term", low=0.0, high=1e3)
    ssim_weight: float = setting(0.2, "weight of 1 - SSIM beside the masked L2 (paper A.13)", low=0.0, high=1e3)
    track_weight: float = setting(1.0, "weight of the track term", low=0.0, high=1e3)
    depth_weight: float = setting(0.1, "weight of the depth term", low=0.0, high=1e3)
    image_every: int = setting(0, "frames between two that enter the image term; 0: chosen", low=0, high=1000)
    max_splats: int = setting(0, "most Gaussians; 0: as the size and detail of the picture ask for", low=0, high=1_000_000)
    splat_iterations: int = setting(100, "steps of the fit of the Gaussians to frame 0", low=1, high=100_000)
    splat_spread_px: float = setting(0.0, "depths of the Gaussians of frame 0 lie by chance up to so many pixels' width before and behind the surface, so that which of two covers the other stays as it was fitted while the surface turns", unit="px", low=0.0, high=100.0)
    splat_edge_px: int = setting(0, "pixels around the mask of frame 0 that the outline may fill in part, before the scene that other frames show there", unit="px", low=0, high=20)
    view_iterations: int = setting(2000, "steps of their fit to many views of a still scene", low=1, high=100_000)
    refine_frames: int = setting(12, "frames of the clip to which the Gaussians are fitted once the motion is recovered; 0: frame 0 alone", low=0, high=10_000)
    prior_timeout_s: float = setting(60.0, "longest time for one answer of the model of prior.model", unit="s", low=0.1, high=3600.0)
    prior_attempts: int = setting(3, "most requests to it, counting those that tell it what was wrong with its answer", low=1, high=10)
    prior_cache: str | None = setting(None, "folder of its earlier answers; ~/.cache/diffphys_ros/prior where not given", path=True)
    checkpoint_every_s: float = setting(60.0, "time between checkpoints on disk", unit="s", low=0.1, high=1e5)
    lpips_weights: str | None = setting(
        None,
        "folder of LPIPS 0.1's weights: backbone.pth, torchvision's AlexNet or VGG-16, and heads.pth, the linear heads for it (or .safetensors); LPIPS is left out without it",
        path=True,
    )
    seed: int = setting(0, "seed of everything random", low=0, high=2**31 - 1)

    @property
    def simulates(self) -> bool:
        """Whether material points answer; eigenmodes alone do otherwise."""
        return self.schedule != "linear"

    @property
    def published(self) -> bool:
        """Whether the published loss is lowered: fields alone, by pictures alone, with no claim about stiffness."""
        return self.schedule == "paper"


# who needs a group, in the words of the tables
KNOWN, WHERE, OBJECT, BELIEF, SOLVED, OUT = (
    "what you know", "where it is", "what is the object", "what is believed of the material", "how it is solved", "what comes out",
)  # fmt: skip
STILL, EXPERIMENT = "pictures of the still object, for `diffphys capture`", "reproductions and ablations"
HEADINGS = (KNOWN, WHERE, OBJECT, BELIEF, SOLVED, OUT, STILL, EXPERIMENT)


def group(cls: type, heading: str) -> Any:
    """A group of settings under one of the HEADINGS."""
    return field(default_factory=cls, metadata={"heading": heading})


@dataclass(frozen=True)
class Settings:
    """The whole tree."""

    scene: Scene = group(Scene, KNOWN)
    camera: CameraSettings = group(CameraSettings, KNOWN)
    topics: Topics = group(Topics, WHERE)
    sync: Sync = group(Sync, WHERE)
    segment: Segment = group(Segment, OBJECT)
    depth: DepthSettings = group(DepthSettings, OBJECT)
    tracks: TrackSettings = group(TrackSettings, OBJECT)
    prior: PriorSettings = group(PriorSettings, BELIEF)
    frames: FrameSettings = group(FrameSettings, SOLVED)
    fit: Fit = group(Fit, SOLVED)
    playback: Playback = group(Playback, OUT)
    publish: Publish = group(Publish, OUT)
    capture: CaptureSettings = group(CaptureSettings, STILL)
    experiment: Experiment = group(Experiment, EXPERIMENT)

    @property
    def told_by_part(self) -> tuple[int, ...]:
        """How many values there are of each material setting that is told part by part."""
        lists = (self.scene.density_kg_m3, self.scene.poisson_ratio, self.prior.materials)
        return tuple(len(told) for told in lists if told is not None and len(told) > 1)
