"""A swinging bar before which an arm passes, exactly rendered."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from diffphys_ros.types import IGNORE, Clip
from tests.boxes import Box, bar, box_clip, oblique_camera, turned

FRAMES = 14
SKIN = np.array([222, 170, 140]) / 130.0  # of the red that the box renderer paints a first part with
ARM = Box(np.array([-0.025, -0.02, -0.3]), np.array([0.025, 0.02, 0.3]))
BOARD = Box(np.array([-0.025, -0.02, -0.3]), np.array([0.5, 0.02, 0.3]))  # hides all that lies behind its edge
ARM_Y = -0.09  # m: 6 cm before the bar's front


@dataclass(frozen=True)
class Occluded:
    """The clip without labels, and which pixels are object (true where it is seen) and arm before the object, bool (T, H, W)."""

    clip: Clip
    object: np.ndarray
    hidden: np.ndarray


def arm_across_a_bar(arm_box: Box = ARM, *, reach: float = 0.26) -> Occluded:
    """The arm enters at the bar's free end in frame 4, reaches its middle (or `reach` [m] from where it started) and leaves again."""
    camera = oblique_camera()
    bare = box_clip(bar(cuts=(0.08,)), [turned(0.08 * np.sin(0.7 * k)) for k in range(FRAMES)], camera)
    arm = box_clip(arm_box, [_arm_pose(k, reach) for k in range(FRAMES)], camera)
    assert bare.depth is not None
    assert arm.depth is not None
    assert bare.labels is not None
    assert arm.labels is not None
    before = (arm.labels > 0) & (arm.depth < bare.depth)
    skin = np.clip(arm.frames[..., :1] * SKIN, 0, 255).astype(np.uint8)
    clip = replace(bare, frames=np.where(before[..., None], skin, bare.frames), depth=np.where(before, arm.depth, bare.depth), labels=None)
    return Occluded(clip, (bare.labels > 0) & ~before, (bare.labels > 0) & before)


def first_labels(scene: Occluded) -> np.ndarray:
    """The object in frame 0, uint8 (H, W)."""
    return scene.object[0].astype(np.uint8)


def ignored(labels: np.ndarray) -> np.ndarray:
    return labels == IGNORE


def _arm_pose(k: int, reach: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = [0.42 - reach * np.sin(np.pi * (k - 3) / 9) if 3 < k < 12 else 0.6, ARM_Y, 0.0]
    return pose
