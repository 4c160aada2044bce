"""The first engine's answer to a clip, with one number of the code multiplied: a process of its own, started by sensitivity.py.

    python benchmarks/first_answer.py TOLD.pickle [MODULE NAME FACTOR]    # the answer as a line of JSON

Whatever imports the solver stands below `multiply`.
"""

from __future__ import annotations

import json
import pickle
import sys
from pathlib import Path
from typing import Any

import deciding
import numpy as np


def answer(told: dict[str, Any]) -> dict[str, Any]:
    """What the start values and the doubts about clock and rest say of `told`: body, tracks, period_s [s], settings, camera, belief; or of a
    recording and settings, from which all of that is made first."""
    start, modal, told = from_recording(told) if "recording" in told else (*from_tracks(told), told)
    return {
        "log10_young": np.log10(start.young).tolist(),
        "sd": start.log10_young_sd.tolist(),
        "identified": start.identified.tolist(),
        "forced": int(start.forced.sum()),
        "family": start.footprint.family,
        "net_force_n": net_force(start, modal).tolist(),
        "free_tail": start.has_free_tail,
        "doubts": doubts(told, start),
    }


def from_tracks(told: dict[str, Any]) -> tuple[Any, Any]:
    """Start values and modes of what was seen and told."""
    from diffphys_ros.start import joint_values, joint_wanted, start_values

    body, tracks, period_s, settings, camera, belief = (told[name] for name in ("body", "tracks", "period_s", "settings", "camera", "belief"))
    start, modal = start_values(body, tracks, period_s, settings, camera=camera, belief=belief)
    if joint_wanted(start, settings):
        start = joint_values(body, tracks, period_s, settings, start, modal, camera=camera, believed=belief is not None)
    return start, modal


def from_recording(told: dict[str, Any]) -> tuple[Any, Any, dict[str, Any]]:
    """Start values, modes, and what they were made of."""
    from diffphys_ros.bags.read import read_clip
    from diffphys_ros.inverse import prepare
    from diffphys_ros.progress import finished

    settings = told["settings"]
    made = finished(prepare(read_clip(told["recording"], settings, frames=settings.frames), settings))
    seen = {"body": made.body, "tracks": made.tracks, "period_s": made.clip.period_s, "camera": made.clip.camera}
    return made.start, made.modal, told | seen


def net_force(start: Any, modal: Any) -> np.ndarray:
    """Force on the whole body in each frame [N], body frame, (T, 3)."""
    from diffphys_ros.modes.interpolation import quadrature

    points, volume, _ = quadrature(modal.nodes, modal.tets)
    return start.force * float(volume @ start.footprint.weights(points))


def doubts(told: dict[str, Any], start: Any) -> list[str]:
    """Which doubts about clock and rest arise; whether the camera moved is not asked, no number listed acts there."""
    from diffphys_ros.vibration.continuity import jump_after, moving_at_first, swings_off_rest
    from diffphys_ros.vibration.coordinates import observe

    motion, at_rest = observe(told["body"], told["tracks"], told["camera"]), told["settings"].scene.at_rest
    q, known, hz = motion.coordinates, motion.known, float(start.observed_hz[0]) if len(start.observed_hz) else 0.0
    found = {
        "jump": jump_after(q, known, at_rest=at_rest, noise_m=motion.noise_m, common_m=motion.coherent_m) is not None,
        "moving at first": at_rest and moving_at_first(q, known, common_m=motion.coherent_m),
        "off rest": at_rest and swings_off_rest(q, known, hz, told["period_s"], noise_m=motion.noise_m),
    }
    return [name for name, doubted in found.items() if doubted]


def main() -> int:
    """Prints the answer."""
    told, *what = sys.argv[1:]
    if what:
        module, word, factor = what
        deciding.multiply(deciding.Number.of(module, word), float(factor))
    print(json.dumps(answer(pickle.loads(Path(told).read_bytes()))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
