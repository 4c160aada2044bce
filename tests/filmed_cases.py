"""What cameras send whose geometry is known: tests/bags says what the clip must be, tests/nodes that live topics give the same clip."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tests import encoded
from tests.filmed import (
    COLOUR_FRAME,
    DEPTH_FRAME,
    FRAMES,
    HEIGHT,
    POINTS,
    START_NS,
    WIDTH,
    K,
    Message,
    colour,
    depth,
    header,
    imu,
    info,
    link,
    pose,
    seen_by_opencv,
    spots,
    stamp_of,
    tree,
)

GRAVITY = {"scene.gravity_m_s2": [0.0, 0.0, -9.81]}  # told, so that nothing is said of it
OWN_FRAME = {"scene.target_frame": COLOUR_FRAME}
LENSES: dict[str, tuple[str, list[float]]] = {
    "plumb_bob": ("plumb_bob", [-0.3, 0.1, 0.002, -0.003, 0.02]),
    "rational_polynomial": ("rational_polynomial", [0.4, -0.2, 0.001, -0.002, 0.05, 0.6, -0.1, 0.02]),
    "equidistant": ("equidistant", [0.05, 0.02, -0.01, 0.003]),
    "equidistant with coefficients of 0": ("equidistant", [0.0, 0.0, 0.0, 0.0]),
}
P = np.array([[120.0, 0, 80.25, 0], [0, 118.0, 61.5, 0], [0, 0, 1, 0]])
TURN = pose(turn_deg=(2.0, -3.0, 1.5))[:3, :3]  # rectification
LEFT_TOP, REGION = (16, 8), (136, 104)  # px of the full picture
CAMERA_IN_WORLD = pose(0.4, -1.2, 0.8, turn_deg=(-100, 5, 10))
DEPTH_IN_COLOUR = pose(-0.05, 0.004, 0.01, turn_deg=(0.5, -1.0, 0.3))
DEPTH_K, DEPTH_SIZE = np.array([[100.0, 0, 50.0], [0, 100.0, 38.0], [0, 0, 1]]), (104, 78)
WALL_M, BLOCK_M, BLOCK = 1.5, 0.8, (-0.12, 0.1, -0.1, 0.08)  # distances from the colour camera; left, right, top, bottom of the block [m]
MOUNTED = pose(0.1, 0, 0.3, turn_deg=(-90, 0, -90))  # optical frame on an arm's wrist
Case = Callable[[], tuple[list[Message], dict[str, Any]]]


def plain() -> np.ndarray:
    return spots(seen_by_opencv(POINTS, K, [0.0] * 5, "plumb_bob"))


def through_lens(model: str, d: list[float]) -> list[Message]:
    return [*colour(spots(seen_by_opencv(POINTS, K, d, model))), info(distortion_model=model, d=d)]


def rectified(topic: str = "/color/image_rect") -> list[Message]:
    picture = spots(seen_by_opencv(POINTS, P[:, :3], [0.0] * 5, "plumb_bob"))
    model, d = LENSES["plumb_bob"]
    return [*colour(picture, topic), info(distortion_model=model, d=d, p=P.ravel(), r=np.eye(3).ravel())]


def turned_by_r() -> list[Message]:
    """The camera stands as it is built; its camera_info wants the picture as a camera sees it that is turned by R."""
    model, d = LENSES["plumb_bob"]
    picture = spots(seen_by_opencv(POINTS @ TURN, K, d, model))
    return [*colour(picture), info(distortion_model=model, d=d, r=TURN.ravel())]


def cut_out(bins: int) -> list[Message]:
    """A region of the picture, and bins of its pixels."""
    model, d = LENSES["plumb_bob"]
    pixels = seen_by_opencv(POINTS, K, d, model)
    full = spots(pixels, sd=1.6 * bins)
    region = full[LEFT_TOP[1] : LEFT_TOP[1] + REGION[1], LEFT_TOP[0] : LEFT_TOP[0] + REGION[0]].astype(float)
    binned = region.reshape(REGION[1] // bins, bins, REGION[0] // bins, bins, 3).mean((1, 3))
    roi = {"x_offset": LEFT_TOP[0], "y_offset": LEFT_TOP[1], "width": REGION[0], "height": REGION[1]}
    return [*colour(np.rint(binned).astype(np.uint8)), info(distortion_model=model, d=d, roi=roi, binning_x=bins, binning_y=bins)]


def surface(k: np.ndarray, size: tuple[int, int], camera_from_depth: np.ndarray) -> np.ndarray:
    """Depth [m] (H, W) of a wall with a block before it, both across the colour camera's axis, as a camera sees them whose rays are followed
    one by one."""
    v, u = np.mgrid[: size[1], : size[0]]
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(k).T @ camera_from_depth[:3, :3].T
    start = camera_from_depth[:3, 3]
    far = (WALL_M - start[2]) / rays[..., 2]
    near = (BLOCK_M - start[2]) / rays[..., 2]
    x, y = (start[i] + near * rays[..., i] for i in (0, 1))
    on_block = (x > BLOCK[0]) & (x < BLOCK[1]) & (y > BLOCK[2]) & (y < BLOCK[3])
    return np.where(on_block, near, far).astype(np.float32)  # rays have unit depth in the depth camera


def depth_camera(*, known: bool = True, frame_id: str = DEPTH_FRAME) -> list[Message]:
    """Depth by a camera with another lens, size and place."""
    seen = surface(DEPTH_K, DEPTH_SIZE, DEPTH_IN_COLOUR if frame_id == DEPTH_FRAME else np.eye(4))
    messages = [*colour(plain()), *depth(seen, frame_id=frame_id), info()]
    messages.append(info(DEPTH_K, "/depth/camera_info", frame_id=frame_id, width=DEPTH_SIZE[0], height=DEPTH_SIZE[1]))
    return [*messages, tree(link(COLOUR_FRAME, DEPTH_FRAME, DEPTH_IN_COLOUR))] if known else messages


def in_world() -> list[Message]:
    """A chain of one moving link that stands still and a static one."""
    arm = pose(0.2, 0, 1.0, turn_deg=(0, 30, 0))
    moving = [tree(link("world", "wrist", arm, stamp_of(k)), topic="/tf") for k in range(-2, FRAMES + 2)]
    return [*colour(plain()), info(), tree(link("wrist", COLOUR_FRAME, MOUNTED)), *moving]


def on_moving_arm(shift_m: float = 0.0, turn_deg: float = 0.0) -> list[Message]:
    """The camera moves evenly while it films points that stand still in the world; it turns about its own centre."""
    pictures, moving = [], []
    for k in range(-2, FRAMES + 2):
        share = k / (FRAMES - 1)
        now = CAMERA_IN_WORLD @ pose(shift_m * share, 0, 0, turn_deg=(0, turn_deg * share, turn_deg * share))
        moving.append(tree(link("world", COLOUR_FRAME, now, stamp_of(k)), topic="/tf"))
        seen = (np.c_[POINTS, np.ones(len(POINTS))] @ (np.linalg.inv(now) @ CAMERA_IN_WORLD).T)[:, :3]
        if 0 <= k < FRAMES:
            pictures.append(spots(seen_by_opencv(seen, K, [0.0] * 5, "plumb_bob")))
    return [*colour(pictures), info(), *moving]


def with_imu(**fields: Any) -> list[Message]:
    """An IMU beside the camera, turned against it, in a world whose z is up."""
    imu_in_camera = pose(0.01, 0.02, 0, turn_deg=(20, -40, 70))
    up = np.array([0, 0, 9.7]) @ CAMERA_IN_WORLD[:3, :3] @ imu_in_camera[:3, :3]
    links = link("world", COLOUR_FRAME, CAMERA_IN_WORLD), link(COLOUR_FRAME, "imu", imu_in_camera)
    return [*colour(plain()), info(), tree(*links), *imu(up, "imu", **fields)]


def of_encoding(message: encoded.Encoded) -> list[Message]:
    """Frames of one colour encoding; three of them, for a picture of a sensor may not change by itself."""
    topic = "/color/image_raw" + ("/compressed" if message.kind == encoded.COMPRESSED else "")
    k = np.array([[20.0, 0, 7.5], [0, 20, 5.5], [0, 0, 1]])
    frames = [(topic, message.kind, stamp_of(i), {"header": header(stamp_of(i), COLOUR_FRAME), **message.fields}, False) for i in range(3)]
    return [*frames, info(k, width=encoded.WIDTH, height=encoded.HEIGHT)]


def of_depth_encoding(message: encoded.Encoded) -> list[Message]:
    """Frames of one depth encoding beside plain colour."""
    topic = "/depth/image_raw" + ("/compressedDepth" if message.kind == encoded.COMPRESSED else "")
    frames = [(topic, message.kind, stamp_of(i), {"header": header(stamp_of(i), COLOUR_FRAME), **message.fields}, False) for i in range(3)]
    return [*of_encoding(encoded.raw("rgb8", encoded.picture(), encoded.picture())), *frames]


def _zoomed() -> list[Message]:
    wider = K * [[1.1], [1.1], [1]]
    return [*colour(plain()), info(), info(wider, ns=stamp_of(3))]


CASES: dict[str, Case] = {
    **{f"lens: {name}": lambda lens=lens: (through_lens(*lens), {}) for name, lens in LENSES.items()},
    "rectified": lambda: (rectified(), {}),
    "turned by R": lambda: (turned_by_r(), {}),
    "region of interest": lambda: (cut_out(1), {}),
    "region of interest, binned": lambda: (cut_out(2), {}),
    "depth camera": lambda: (depth_camera(), OWN_FRAME),
    "depth of another size": lambda: (depth_camera(known=False, frame_id=COLOUR_FRAME), {}),
    "depth 20 ms late": lambda: ([*colour(plain()), *depth([np.full((HEIGHT, WIDTH), 1.0 + k) for k in range(FRAMES)], 20_000_000), info()], {}),
    "depth 4 ms late": lambda: ([*colour(plain()), *depth(np.ones((HEIGHT, WIDTH)), 4_000_000), info()], {"sync.slop_s": 0.005}),
    "world over a moving link": lambda: (in_world(), GRAVITY),
    "target_frame": lambda: (in_world(), {"scene.target_frame": "wrist"} | GRAVITY),
    "no transform": lambda: ([*colour(plain()), info()], {}),
    "camera that turns": lambda: (on_moving_arm(turn_deg=4.0), GRAVITY),
    "imu": lambda: (with_imu(), {}),
    "imu without a world": lambda: ([*colour(plain()), info(), *imu((0.0, -9.8, 0.3), COLOUR_FRAME)], {}),
    "camera_info changes": lambda: (_zoomed(), {}),
    **{f"encoding: {name}": lambda make=make: (of_encoding(make()), {"topics.image": _topic(make())}) for name, make in encoded.COLOUR.items()},
    **{f"depth encoding: {name}": lambda make=make: (of_depth_encoding(make()), {}) for name, make in encoded.DEPTH.items()},
}
REFUSED: dict[str, tuple[Case, str]] = {
    "another lens model": (lambda: ([*colour(plain()), info(distortion_model="mine", d=[0.1])], {}), "distortion_model 'mine', must be plumb_bob, .*record rectified images"),
    "no focal length": (lambda: ([*colour(plain()), info(np.zeros((3, 3)))], {}), r"K\[0\] = 0, must be above 0; calibrate"),
    "rectified without P": (lambda: ([*colour(plain(), "/color/image_rect"), info(d=[-0.3, 0.1, 0, 0, 0])], {}), "has no P, which the rectified images of .*image_rect need"),
    "region that does not fit": (lambda: ([*colour(plain()), info(binning_x=2, binning_y=2)], {}), "is for 160x120 px, bins of 2x2 px, the images of .* have 160x120 px"),
    "R that is not finite": (lambda: ([*colour(plain()), info(r=np.full(9, np.inf))], {}), "an R that is no rotation; calibrate"),
    "R that is no rotation": (lambda: ([*colour(plain()), info(r=np.full(9, 0.5))], {}), "an R that is no rotation; calibrate"),
    "depth too late": (
        lambda: ([*colour(plain()), *depth(np.ones((HEIGHT, WIDTH)), 4_000_000), info()], {"sync.slop_s": 0.003}),
        r"no depth image lies within 3 ms of a colour image \(sync.slop_s\), the nearest is 4 ms away; have the cameras synchronised, raise sync.slop_s",
    ),
    "camera that moves": (lambda: (on_moving_arm(shift_m=0.12), GRAVITY), r"the camera moves by up to 0\.12 m and turns .* must stay within 1 mm; keep it still"),
    "camera that turns away": (lambda: (on_moving_arm(turn_deg=60), GRAVITY), "turns by up to .* degrees during the clip and then sees"),
}
NOT_YET: dict[str, tuple[Case, str]] = {
    "depth camera without a transform": (lambda: (depth_camera(known=False), {}), "no transform from the colour camera's color_optical to the depth camera's depth_optical"),
    "depth in another frame": (
        lambda: ([*colour(plain()), *depth(np.ones((HEIGHT, WIDTH)), frame_id=DEPTH_FRAME), info()], {}),
        "depth of .* is in frame depth_optical, colour in color_optical, and there is no camera_info of the depth",
    ),
    "gravity without a world": (lambda: ([*colour(plain()), info()], GRAVITY), "scene.gravity_m_s2 is told in the world, but no transform of the camera's color_optical is known"),
    "target that is not there": (lambda: (in_world(), {"scene.target_frame": "map"}), r"no transform from map to the camera's color_optical is known, frames known: color_optical, world, wrist"),
    "moving link of another time": (
        lambda: ([*colour(plain()), info(), tree(link("world", COLOUR_FRAME, CAMERA_IN_WORLD, START_NS - 10**10), topic="/tf")], GRAVITY),
        r"no transform from world to the camera's color_optical is known at 1700000000\.000 s \(6 of 6 frames\)",
    ),
    "no camera_info": (lambda: ([*colour(plain())], {}), "has no camera_info; record the camera_info topic or set camera.fov_deg"),
}


def _topic(message: encoded.Encoded) -> str:
    return "/color/image_raw" + ("/compressed" if message.kind == encoded.COMPRESSED else "")
