"""The topic table: name, type, QoS, frame and units of everything that the nodes publish."""

from __future__ import annotations

from dataclasses import dataclass

FIT_NODE = "fit_node"
KEEP_ALL = 0

CLOUD = "sensor_msgs/msg/PointCloud2"
IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
VECTOR = "geometry_msgs/msg/Vector3Stamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"
MARKERS = "visualization_msgs/msg/MarkerArray"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
PATH = "nav_msgs/msg/Path"
TREE = "tf2_msgs/msg/TFMessage"
STATIC_TREE = "/tf_static"


@dataclass(frozen=True)
class Topic:
    """One topic. All are reliable; `latched` ones are transient local as well, so that late subscribers get them."""

    name: str  # relative, or under ~/ (the node's own name)
    type_name: str
    frame: str  # "world", "camera" or "" where there is none
    units: str
    doc: str
    latched: bool = True
    depth: int = 1  # history; KEEP_ALL where every message counts


def absolute(name: str, node: str = FIT_NODE) -> str:
    """A name of the table with the node's spelt out, as a bag holds it. `node` has its namespace before it."""
    return name.replace("~", "/" + node.strip("/"), 1) if name.startswith("~") else name


def own_name(node: str) -> str:
    """A node's name without its namespace."""
    return node.rsplit("/", 1)[-1]


def _table(*topics: Topic) -> dict[str, Topic]:
    return {topic.name: topic for topic in topics}


TOPICS = _table(
    Topic("clip/image", IMAGE, "camera", "rgb8", "frames that were received, on the clip's own clock", depth=KEEP_ALL),
    Topic("clip/camera_info", CAMERA_INFO, "camera", "px", "opens a clip; intrinsics of the (undistorted) frames"),
    Topic("clip/depth", IMAGE, "camera", "m (32FC1), 0 unknown", "depth along the optical axis, stamps of clip/image", depth=KEEP_ALL),
    Topic("clip/camera_pose", TRANSFORM, "world", "m", "camera in the root of its transform tree"),
    Topic("clip/gravity", VECTOR, "world", "m/s^2", "gravity as an IMU or scene.target_frame tells it; 0 0 0 where neither does"),
    Topic("clip/first_mask", IMAGE, "camera", "mono8 labels", "what a mask topic says the object in frame 0 is; empty where there is none"),
    Topic("clip/mask", IMAGE, "camera", "mono8 labels", "0 background, 1..n parts (1 at the clamp), 255 ignore", depth=KEEP_ALL),
    Topic("clip/end", PATH, "world", "m", "completes a clip: one pose of the camera for every clip/image, with the image's stamp"),
    Topic("clip/done", DIAGNOSTICS, "", "", "a stage says that it has ended with a clip, and how: OK, or ERROR or WARN with the reason"),
    Topic("splats", CLOUD, "world", "m, logit, log m", "static 3D Gaussians of frame 0, fields named as in a 3DGS .ply; `labels`: CRC-32 of the mask that they were fitted in"),
    Topic("~/material_field", CLOUD, "world", "m, Pa, kg/m^3, m^3", "stiffness on the particles at rest"),
    Topic("~/force_field", CLOUD, "world", "m, s, N/m^3 of rest volume", "force on the particles, one row per frame"),
    Topic("~/stiffness_markers", MARKERS, "world", "m", "cubes at rest, coloured by log10 of the stiffness, grey where it is not identified"),
    Topic("~/quality", DIAGNOSTICS, "", "", "per part: whether it is identified, why, and what fixed the scale"),
    Topic("~/progress", DIAGNOSTICS, "", "", "stage, iteration, loss, seconds left"),
    Topic("~/force_so_far", CLOUD, "world", "m, s, N/m^3", "while a fit runs: laid out as ~/force_field, one point that stands for the whole object"),
    Topic("~/state", CLOUD, "world", "m, N/m^3 of rest volume", "particles and the force on them in one frame, played at the recorded rate"),
    Topic("~/force_markers", MARKERS, "world", "m", "arrows of the force, scaled to the object, played"),
    Topic("~/net_force", WRENCH, "world", "N, N m", "resultant on the free particles about the centre of the clamp plane, else the origin; played"),
    Topic("~/net_force_sd", VECTOR, "world", "N", "one standard deviation of each component of ~/net_force; 0 where no force acts, NaN where the force is not identified; played"),
    Topic("~/rendered", IMAGE, "camera", "rgb8", "the recovered motion through the camera, played"),
    Topic("~/camera_info", CAMERA_INFO, "camera", "px", "intrinsics and stamps of the rendered images, played"),
    Topic(STATIC_TREE, TREE, "world", "m", "the camera in the world, where nobody else puts it there; always in recovery.mcap"),
    Topic("/diagnostics", DIAGNOSTICS, "", "", "health of the node, 1 Hz", latched=False, depth=10),
)

PLAYED = ("~/state", "~/force_markers", "~/net_force", "~/net_force_sd", "~/camera_info", "~/rendered")
RESULTS = ("~/material_field", "~/force_field", "~/stiffness_markers", "~/quality")
