"""What was measured with a clip, beside what a person tells of its scene."""

from __future__ import annotations

from dataclasses import replace

from .config import Scene
from .types import Clip


def scene_of(clip: Clip, scene: Scene) -> Scene:
    """The scene as it is told, with the clip's measured thickness and gravity where they are not told."""
    if scene.gravity_m_s2 is None and clip.gravity is not None:
        scene = replace(scene, gravity_m_s2=clip.gravity.tolist())
    if scene.thickness_m is not None or clip.thickness is None:
        return scene
    return replace(scene, thickness_m=clip.thickness.extent_m, thickness_axis=clip.thickness.axis.tolist())
