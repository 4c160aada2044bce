"""What in a recording contradicts what a recovery takes for granted: a camera that stands, a steady clock, a frame 0 at rest, a body
that nothing holds where nobody says what does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..config import Settings
from ..types import Body, Clip, Doubt, StartValues, Tracks
from ..vibration.continuity import jump_after, moving_at_first, swings_off_rest
from ..vibration.coordinates import Motion, observe
from ..vibration.held import swings_as_a_whole
from .prepared import bounces

if TYPE_CHECKING:
    from ..tracks import CameraMotion

SLOWER = 0.8  # than a pendulum of its length, from which on a hanging body is too slow: no stiffness and no shape make it slower than the pendulum itself [chosen]


def doubts_of(clip: Clip, tracks: Tracks, body: Body, start: StartValues, settings: Settings, moved: CameraMotion | None = None) -> tuple[Doubt, ...]:
    """What is to be doubted, worst first; empty for a sound recording. `moved`: how the camera did, None where it stood."""
    if moved is not None:
        return (Doubt(moved.sentence(), of_young=True),)  # what else the tracks seem to say is the camera's
    if bounces(body, settings.scene):
        text = "nothing holds the object and a floor is told: what moves it there is the floor, when and where it touches, which no force that was found has in it"
        return (Doubt(f"{text}; tell what holds it (scene.clamp_box_m, clamp_px), or leave the floor out where it never touches", of_young=False),)
    slow = _too_slow(body, start, length_told=settings.scene.size_m is not None or clip.depth is not None)
    if slow:
        return slow
    motion = observe(body, tracks, clip.camera)
    if not body.clamped and start.has_free_tail and swings_as_a_whole(motion, start.forced):
        text = "the object swings as a whole about one place when no force acts, which nothing free does: something holds it, and nothing says where"
        return (Doubt(f"{text}; tell what holds it (scene.clamp_box_m, clamp_px)", of_young=True),)
    return (*_of_clock(motion, at_rest=settings.scene.at_rest), *(_of_rest(motion, clip.period_s, start) if settings.scene.at_rest else ()))


def _too_slow(body: Body, start: StartValues, *, length_told: bool) -> tuple[Doubt, ...]:
    """Of a body that hangs from its clamp: whatever its stiffness, its weight alone brings it back as fast as a pendulum of its length."""
    down = float(body.gravity[0])
    if not (body.clamped and length_told and down > 0 and start.has_free_tail and len(start.observed_hz)):
        return ()
    length = float(body.sides_m[0])
    hz, least = float(start.observed_hz[0]), float(np.sqrt(down / length)) / (2 * np.pi)
    if hz > SLOWER * least:
        return ()
    text = f"the object swings at {hz:.2g} Hz, but hanging {length:.2g} m long its weight alone makes it swing at {least:.2g} Hz or more: times or size are not what is told"
    return (Doubt(f"{text}; a film in slow motion may state the rate at which it is shown: set camera.fps, or correct the size", of_young=True),)


def _of_clock(motion: Motion, *, at_rest: bool) -> tuple[Doubt, ...]:
    frame = jump_after(motion.coordinates, motion.known, at_rest=at_rest, noise_m=motion.noise_m, common_m=motion.coherent_m)
    if frame is None:
        return ()
    text = f"the object jumps between frames {frame} and {frame + 1}, as no push can make it: frames are missing there though the stamps run on; record without gaps"
    return (Doubt(text, of_young=False),)


def _of_rest(motion: Motion, period_s: float, start: StartValues) -> tuple[Doubt, ...]:
    q, known = motion.coordinates, motion.known
    if moving_at_first(q, known, common_m=motion.coherent_m):
        text = "the object moves in frame 0 already, where scene.at_rest says that it rests; begin the clip earlier or set scene.at_rest to false"
        return (Doubt(text, of_young=True),)
    hz = float(start.observed_hz[0]) if len(start.observed_hz) else 0.0
    if not swings_off_rest(q, known, hz, period_s, noise_m=motion.noise_m):
        return ()
    text = "the object swings about another shape than that of frame 0, which scene.at_rest calls its rest: it moves there, or a force never ends"
    return (Doubt(f"{text}; set scene.at_rest to false or record the object at rest", of_young=True),)
