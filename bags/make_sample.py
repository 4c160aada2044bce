"""Makes the bundled sample: a clip with known truth from another simulator than ours.

The truth is MuJoCo's: quadratic 27-node corotational finite elements, implicit integrator, OpenGL pictures. A development tool:

    apt-get install libosmesa6
    pip install mujoco==4.0.0
    python -m diffphys_ros.bags.make_sample --seed 0 --out bags/sample

prints what the sample was made to meet and exits with 1 where it does not. The same seed gives the same scene.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diffphys_ros.bags.maker.bar import FPS, LENGTH, Bar, draw
from diffphys_ros.bags.maker.body import Body, Motion, clip_frames, first_free_frame, swing
from diffphys_ros.bags.maker.files import write_files
from diffphys_ros.bags.maker.film import aim, film

MAX_FRAMES = 45
DRAWS = 60


@dataclass(frozen=True)
class Figure:
    """A measured number that must lie in [low, high]."""

    name: str
    value: float
    low: float
    high: float

    @property
    def good(self) -> bool:
        """Whether it does."""
        return self.low <= self.value <= self.high

    def __str__(self) -> str:
        return f"{'ok  ' if self.good else 'FAIL'} {self.name}: {self.value:.4g} (must lie in {self.low:g} .. {self.high:g})"


def prepare(seed: int) -> tuple[Body, np.ndarray]:
    """First draw whose free vibration fits into the clip: the body and its lowest frequencies [Hz]."""
    rng = np.random.default_rng(seed)
    for _ in range(DRAWS):
        body = Body(draw(rng), seed)
        frequencies = body.frequencies(body.bar.young)
        if clip_frames(body.bar, frequencies[0]) <= MAX_FRAMES and min(_shifts(body, frequencies[0])) > 1.0:
            return body, frequencies
    raise SystemExit(f"seed {seed}: no draw fits into {MAX_FRAMES} frames")


def _shifts(body: Body, first: float) -> list[float]:
    """Change of the first frequency [%] by 25 % more E of either part."""
    factors = np.array([[1.25, 1.0], [1.0, 1.25]])
    return [100 * float(body.frequencies(body.bar.young * f)[0] / first - 1) for f in factors]


def measure(body: Body, frequencies: np.ndarray, motion: Motion, masks: np.ndarray, size_bytes: int) -> list[Figure]:
    """What the sample must meet."""
    bar, frames = body.bar, len(motion.positions)
    moved = np.linalg.norm(motion.positions - motion.positions[0], axis=2)
    free = (frames - 1 - first_free_frame(motion)) / FPS * frequencies[0]
    near, far = _shifts(body, frequencies[0])
    cover = 100 * masks.mean((1, 2))
    return [
        Figure("substeps per frame (CFL 0.5, 4 cells over the thickness, true E)", bar.substeps, 0, 60),
        Figure("particles (lattice of 1.25 per cell and axis)", bar.particles, 300, 650),
        Figure("shift of the first frequency by 25 % in E of the part at the clamp [%]", near, 1, 100),
        Figure("shift of the first frequency by 25 % in E of the other part [%]", far, 1, 100),
        Figure("free periods after the force", free, 1.3, 10),
        Figure("frames", frames, 36, MAX_FRAMES),
        Figure("largest motion [% of the length]", 100 * moved.max() / LENGTH, 5, 20),
        Figure("motion before the force [mm]", 1000 * moved[:4].max(), 0, 0.05),
        Figure("object covers at least [% of the image]", cover.min(), 5, 30),
        Figure("object covers at most [% of the image]", cover.max(), 5, 35),
        Figure("clip.mcap [MB]", size_bytes / 1e6, 0, 1.5),
    ]


def describe(seed: int, bar: Bar, frequencies: np.ndarray, motion: Motion, figures: list[Figure]) -> str:
    """Text of the sample's README."""
    net = np.linalg.norm(motion.force.sum(1), axis=1).max()
    direction = ", ".join(f"{v:.2f}" for v in bar.push)
    shifts = "\n".join(f"- {figure.name}: {figure.value:.4g}" for figure in figures)
    return f"""# Sample clip (seed {seed})

A soft bar of two parts, {LENGTH:g} m long, clamped at one end: a uniform gust across its axis, then free vibration. The truth comes from
MuJoCo (quadratic finite elements), not from this project's simulator. Made by `python -m diffphys_ros.bags.make_sample --seed {seed}`.

| | at the clamp | beyond a third of the length |
|---|---|---|
| Young's modulus [Pa] | {bar.young[0]:.4g} | {bar.young[1]:.4g} |
| Poisson's ratio | {bar.poisson[0]:.2f} | {bar.poisson[1]:.2f} |
| density [kg/m^3] | {bar.density:.0f} | {bar.density:.0f} |

Gust: {bar.half_sines} half-sine(s) along ({direction}), frames 3 to {first_free_frame(motion) - 1}, largest net force {net:.3f} N.
First frequencies: {", ".join(f"{f:.2f}" for f in frequencies)} Hz. Stiffness-proportional damping {bar.stiffness_damping:.2e} s.

{shifts}

| file | |
|---|---|
| clip.mcap | colour (PNG), depth (16UC1), camera_info, /tf_static |
| given.yaml, mask0.png | what a user would be told: `--config given.yaml` |
| truth.npz | the answer; only scoring reads it. `force` [N] is the mean over [t_k, t_k+1) |
"""


def main(arguments: list[str] | None = None) -> int:
    """Draws, simulates, renders, writes and checks one sample; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True, help="folder for the files; made where it is missing")
    options = parser.parse_args(arguments)
    body, frequencies = prepare(options.seed)
    motion = swing(body, clip_frames(body.bar, frequencies[0]))
    camera = aim(body, motion.positions)
    images, depths, masks = film(body, camera, motion.states)
    options.out.mkdir(parents=True, exist_ok=True)
    write_files(options.out, f"sample_{options.seed:04d}", body, camera, motion, (images, depths, masks))
    figures = measure(body, frequencies, motion, masks, (options.out / "clip.mcap").stat().st_size)
    (options.out / "README.md").write_text(describe(options.seed, body.bar, frequencies, motion, figures), encoding="utf-8")
    print("\n".join(map(str, figures)))
    return 0 if all(figure.good for figure in figures) else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # the software renderer may hang on a normal exit
