"""The files of a sample: clip.mcap, truth.npz, mask0.png, given.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from diffphys_ros.bags.write import write_recording
from diffphys_ros.types import Camera
from tools.sample_maker.bar import FPS, Bar
from tools.sample_maker.body import SUBSTEPS, Body, Motion
from tools.sample_maker.messages import clip_messages

CLAMP_BOX_MARGIN = 0.005  # m


def write_files(
    folder: Path, name: str, body: Body, camera: Camera, motion: Motion, pictures: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    """Writes the four files into an existing folder."""
    images, depths, masks = pictures
    write_recording(folder / "clip.mcap", clip_messages(camera, images, depths, effort=9))
    np.savez_compressed(folder / "truth.npz", **_truth(name, body, camera, motion, masks))
    cv2.imwrite(str(folder / "mask0.png"), masks[0].astype(np.uint8) * 255)
    (folder / "given.yaml").write_text(_given(body.bar), encoding="utf-8")


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
        "time": np.arange(len(masks)) / FPS, "damping_mass_alpha": bar.mass_damping, "damping_stiffness_beta": bar.stiffness_damping,
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
