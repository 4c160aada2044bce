"""The files of a sample: clip.mcap, truth.npz, mask0.png, given.yaml."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from diffphys_ros.bags.maker.bar import FPS, Bar
from diffphys_ros.bags.maker.body import SUBSTEPS, Body, Motion
from diffphys_ros.bags.maker.film import FRAME_ID, WORLD
from diffphys_ros.bags.write import Message, write_recording
from diffphys_ros.types import Camera

START_NS = 1_750_000_000_000_000_000
CLAMP_BOX_MARGIN = 0.005  # m


def write_files(
    folder: Path, name: str, body: Body, camera: Camera, motion: Motion, pictures: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    """Writes the four files into an existing folder."""
    images, depths, masks = pictures
    write_recording(folder / "clip.mcap", _messages(camera, images, depths))
    np.savez_compressed(folder / "truth.npz", **_truth(name, body, camera, motion, masks))
    cv2.imwrite(str(folder / "mask0.png"), masks[0].astype(np.uint8) * 255)
    (folder / "given.yaml").write_text(_given(body.bar), encoding="utf-8")


def _messages(camera: Camera, images: np.ndarray, depths: np.ndarray) -> Iterator[Message]:
    info = {
        "height": camera.height, "width": camera.width, "distortion_model": "plumb_bob", "d": np.zeros(5),
        "k": camera.pixel_from_camera, "r": np.eye(3), "p": np.c_[camera.pixel_from_camera, np.zeros(3)],
    }  # fmt: skip
    for k, (image, depth) in enumerate(zip(images, depths, strict=True)):
        ns = START_NS + round(k * 1e9 / FPS)
        header = {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": FRAME_ID}
        if k == 0:
            yield "/tf_static", "tf2_msgs/msg/TFMessage", ns, {"transforms": [_pose(camera, header["stamp"])]}, True
        yield "/camera/camera_info", "sensor_msgs/msg/CameraInfo", ns, {"header": header, **info}, False
        png = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
        yield "/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", ns, {"header": header, "format": "png", "data": png}, False
        raw = {"height": camera.height, "width": camera.width, "encoding": "16UC1", "step": 2 * camera.width}
        raw["data"] = np.rint(depth * 1000).astype("<u2").tobytes()
        yield "/camera/depth/image_raw", "sensor_msgs/msg/Image", ns, {"header": header, **raw}, False


def _pose(camera: Camera, stamp: Any) -> dict[str, Any]:
    rotation = Rotation.from_matrix(camera.world_from_camera[:3, :3]).as_quat()
    return {
        "header": {"stamp": stamp, "frame_id": WORLD},
        "child_frame_id": FRAME_ID,
        "transform": {
            "translation": dict(zip("xyz", camera.position, strict=True)),
            "rotation": dict(zip("xyzw", rotation, strict=True)),
        },
    }


def _truth(name: str, body: Body, camera: Camera, motion: Motion, masks: np.ndarray) -> dict[str, Any]:
    """World frame, SI units; N nodes, M tetrahedra, T frames, n parts."""
    bar, tets = body.bar, body.tets
    part = bar.part_volume.argmax(0)
    single = {"positions": motion.positions, "velocities": motion.velocities, "force": motion.force}
    single["force_density"] = motion.force / bar.volume[:, None]
    per_part = {"E": bar.young, "nu": bar.poisson, "rho": np.full(bar.shape.parts, bar.density)}
    arrays = {f"part_{k}": v for k, v in per_part.items()} | {f"vertex_{k}": v[part] for k, v in per_part.items()}
    arrays |= {k: v.astype(np.float32) for k, v in single.items()}
    return arrays | {
        "name": name, "rest_vertices": bar.nodes, "tets": tets.astype(np.int32), "tet_part": body.tet_part.astype(np.int32),
        "vertex_part": part.astype(np.int32), "interface": (bar.part_volume > 0).sum(0) > 1, "clamped": bar.clamped,
        "vertex_volume": bar.volume, "vertex_mass": bar.mass, "gravity": bar.gravity, "fps": FPS,
        "time": np.arange(len(masks)) / FPS, "damping_mass_alpha": 0.0, "damping_stiffness_beta": bar.stiffness_damping,
        # the implicit integrator damps like a stiffness-proportional damping of one time step
        "damping_stiffness_beta_effective": bar.stiffness_damping + 1 / FPS / SUBSTEPS, "dt": 1 / FPS / SUBSTEPS,
        "camera_K": camera.pixel_from_camera, "T_world_cam": camera.world_from_camera, "width": camera.width, "height": camera.height,
        "mask": np.packbits(masks, axis=None), "mask_shape": np.array(masks.shape), "has_contact": False,
    }  # fmt: skip


def _given(bar: Bar) -> str:
    face = bar.nodes[bar.clamped]
    box = np.r_[face.min(0) - CLAMP_BOX_MARGIN, face.max(0) + CLAMP_BOX_MARGIN]
    return "\n".join(
        [
            "# What a user would be told about this clip (--config given.yaml). World frame: the bag's, z up, metres.",
            "scene:",
            f"  mass_kg: {bar.mass.sum():.5g}",
            f"  thickness_m: {bar.size[1]:.4g}  # extent along thickness_axis; the camera sees the front only",
            "  thickness_axis: [0.0, 1.0, 0.0]",
            f"  gravity_m_s2: [{', '.join(f'{v:g}' if v else '0.0' for v in bar.gravity)}]",
            f"  clamp_box_m: [{', '.join(f'{v + 0.0:.4g}' for v in box)}]  # xmin ymin zmin xmax ymax zmax",
            "  floor_z_m: null",
            "  at_rest: true  # still and in equilibrium in frame 0",
            "  first_mask: mask0.png  # the object in frame 0, relative to this file",
            "",
        ]
    )
