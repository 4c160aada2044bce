"""Makes the bundled samples: clips with known truth from another simulator than ours.

The truth is MuJoCo's: quadratic 27-node corotational finite elements, implicit integrator, OpenGL pictures. A development tool:

    apt-get install libosmesa6
    pip install mujoco==4.0.0
    python -m tools.sample_maker --seed 0 --out bags/sample
    python -m tools.sample_maker --kind strip --seed 0 --out bags/sample_strip

A `bar` has two parts, lies or stands without gravity and sways a little; a `strip` of one part hangs under gravity and is swung so
far that linear modes no longer describe it. Each prints what the sample was made to meet and exits with 1 where it does not. The same seed gives the same scene.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tools.sample_maker.bar import FPS, Bar, draw, draw_flat, draw_strip
from tools.sample_maker.body import Body, Motion, clip_frames, first_free_frame, swing
from tools.sample_maker.files import write_files
from tools.sample_maker.film import aim, film

KINDS = {"bar": draw, "strip": draw_strip, "flat": draw_flat}
DRAWS = 60
SWAY = {"bar": (5, 20), "strip": (34, 50), "flat": (15, 35)}  # largest motion [% of the length]
COVER = {"bar": (5, 35), "strip": (3, 35), "flat": (3, 35)}  # of the image by the object [%]
LARGEST_MB = 1.5


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


def prepare(seed: int, kind: str = "bar") -> tuple[Body, np.ndarray]:
    """First draw whose free vibration fits into the clip: the body and its lowest frequencies without gravity [Hz]."""
    rng = np.random.default_rng(seed)
    for _ in range(DRAWS):
        body = Body(KINDS[kind](rng), seed)
        frequencies = body.frequencies(body.bar.young)
        if clip_frames(body.bar, frequencies[0]) <= body.bar.shape.most_frames and min(_shifts(body, frequencies[0])) > 1.0:
            return body, frequencies
    raise SystemExit(f"seed {seed}: no draw of kind {kind} fits into its frames")


def _shifts(body: Body, first: float) -> list[float]:
    """Change of the first frequency [%] by 25 % more E of each part."""
    factors = np.where(np.eye(body.bar.shape.parts), 1.25, 1.0)
    return [100 * float(body.frequencies(body.bar.young * f)[0] / first - 1) for f in factors]


def measure(kind: str, body: Body, frequencies: np.ndarray, motion: Motion, masks: np.ndarray, size_bytes: int) -> list[Figure]:
    """What the sample must meet."""
    bar, frames = body.bar, len(motion.positions)
    moved = np.linalg.norm(motion.positions - motion.positions[0], axis=2)
    free = (frames - 1 - first_free_frame(motion)) / FPS * frequencies[0]
    shifts = enumerate(_shifts(body, frequencies[0]), 1)
    cover = 100 * masks.mean((1, 2))
    solver = [
        Figure("substeps per frame (CFL 0.5, 4 cells over the thickness, true E)", bar.substeps, 0, 60),
        Figure("particles (lattice of 1.25 per cell and axis)", bar.particles, 300, 650),
    ]
    return [
        *(solver if kind == "bar" else []),
        *(Figure(f"shift of the first frequency by 25 % in E of part {part} [%]", shift, 1, 100) for part, shift in shifts),
        Figure("free periods after the force, of the first frequency without gravity", free, 1.3, 10),
        Figure("frames", frames, 36, bar.shape.most_frames),
        Figure("largest motion [% of the length]", 100 * moved.max() / bar.shape.length, *SWAY[kind]),
        Figure("motion before the force [mm]", 1000 * moved[:4].max(), 0, 0.05),
        Figure("object covers at least [% of the image]", cover.min(), *COVER[kind]),
        Figure("object covers at most [% of the image]", cover.max(), *COVER[kind]),
        Figure("clip.mcap [MB]", size_bytes / 1e6, 0, LARGEST_MB),
    ]


ABOUT = {
    "bar": "A soft bar of two parts (the second begins a third of the length from the clamp), clamped at one end, without gravity: a uniform\n"
    "gust across its axis, then free vibration.",
    "flat": "A soft flat bar of one part, struck aslant: mass and stiffness damping brake its fast and its slow swing differently.",
    "strip": "A soft strip that hangs from its upper end under gravity: one uniform gust swings its tip by more than a third of its length, then\n"
    "it swings freely. Linear modes miss this motion; a simulation follows it.",
}


def describe(kind: str, seed: int, bar: Bar, frequencies: np.ndarray, motion: Motion, figures: list[Figure]) -> str:
    """Text of the sample's README."""
    net = np.linalg.norm(motion.force.sum(1), axis=1).max()
    direction = ", ".join(f"{v:.2f}" for v in bar.push)
    measured = "\n".join(f"- {figure.name}: {figure.value:.4g}" for figure in figures)
    materials = "\n".join(
        f"| {i + 1} | {young:.4g} | {nu:.2f} | {bar.density:.0f} |" for i, (young, nu) in enumerate(zip(bar.young, bar.poisson, strict=True))
    )
    return f"""# Sample clip: {kind}, seed {seed}

{ABOUT[kind]} The truth comes from MuJoCo (quadratic finite elements), not from this project's simulator.
Made by `python -m tools.sample_maker --kind {kind} --seed {seed}`. {bar.shape.length:g} x {bar.shape.height:g} x {bar.shape.thickness:g} m.

| part, from the clamp | Young's modulus [Pa] | Poisson's ratio | density [kg/m^3] |
|---|---|---|---|
{materials}

Gust: {bar.half_sines} half-sine(s) along ({direction}), frames 3 to {first_free_frame(motion) - 1}, largest net force {net:.3f} N.
First frequencies without gravity: {", ".join(f"{f:.2f}" for f in frequencies)} Hz. Stiffness-proportional damping {bar.stiffness_damping:.2e} s.

{measured}

| file | |
|---|---|
| clip.mcap | colour (PNG), depth (16UC1), camera_info, /tf_static |
| given.yaml, mask0.png | what a user would be told: `--config given.yaml` |
| truth.npz | the answer; only scoring reads it. `force` [N] is the mean over [t_k, t_k+1) |
"""


def main(arguments: list[str] | None = None) -> int:
    """Draws, simulates, renders, writes and checks one sample; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=KINDS, default="bar")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True, help="folder for the files; made where it is missing")
    options = parser.parse_args(arguments)
    body, frequencies = prepare(options.seed, options.kind)
    motion = swing(body, clip_frames(body.bar, frequencies[0]))
    camera = aim(body, motion.positions)
    images, depths, masks = film(body, camera, motion.states)
    options.out.mkdir(parents=True, exist_ok=True)
    write_files(options.out, f"sample_{options.kind}_{options.seed:04d}", body, camera, motion, (images, depths, masks))
    figures = measure(options.kind, body, frequencies, motion, masks, (options.out / "clip.mcap").stat().st_size)
    (options.out / "README.md").write_text(describe(options.kind, options.seed, body.bar, frequencies, motion, figures), encoding="utf-8")
    print("\n".join(map(str, figures)))
    return 0 if all(figure.good for figure in figures) else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # the software renderer may hang on a normal exit
