"""Clips that nobody chose: which seeds, and what a run of each is told."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from diffphys_ros.errors import InputError

SCENE = ("clip.mcap", "mask0.png", "truth.npz")
STATS = "stats.json"  # the generator's last file: what it made
REFUSED = "refused.txt"  # in place of it: why a seed has no clip
CONFIRMATION_SEEDS = range(100_000, 1_000_000)  # far from those on which choices are made
MADE_IN_S = 900.0  # longest time for one scene
OTHER_SCENES = Path(__file__).with_name("other_scenes.py")  # makes what the generator lacks
SECOND_TRUTH, SECOND = Path(__file__).with_name("second_truth.py"), "--neo-hookean"  # moves scenes of the generator's by another solid
OTHERS = ("--family", "--hidden", "--force", "--plain")  # options that are its own


@dataclass(frozen=True)
class Kind:
    """What a run knows, and what of: one column of the table."""

    name: str
    words: str  # for people
    scene: tuple[str, ...] = ()  # of the generator: another scene of the same seed
    sensor: bool = False  # through the sensor model
    densities: bool = False  # the parts' densities are told, else the mass alone
    colour: bool = False  # colour images alone
    frames: tuple[int, int] | None = None  # fitted, and predicted
    known: tuple[str, ...] | None = None  # settings of the scene that are told; None: all of the generator's

    @property
    def quick(self) -> Kind:
        """The same of the generator's coarser mesh."""
        return self if "--quick" in self.scene else replace(self, scene=(*self.scene, "--quick"))


MASK, HELD, THICK = "first_mask", ("clamp_box_m", "gravity_m_s2", "at_rest"), ("thickness_m", "thickness_axis")

KINDS = {
    kind.name: kind
    for kind in (
        Kind("told", "densities told", densities=True),
        Kind("mass", "mass told"),
        Kind("sensor", "sensor model, densities told", sensor=True, densities=True),
        Kind("never_free", "the force never stops, mass told", scene=("--never-free",)),
        Kind("held_out", "first 45 frames, densities told", densities=True, frames=(45, 15)),
        Kind("colour", "points, colour alone", densities=True, colour=True),
        Kind("plain_depth", "outline, depth of frame 0", scene=("--plain",), densities=True),
        Kind("plain", "outline, colour alone", scene=("--plain",), densities=True, colour=True),
        Kind("hook", "hooks", scene=("--family", "hook"), densities=True),
        Kind("fork", "forks", scene=("--family", "fork"), densities=True),
        Kind("cord", "cords, large swing", scene=("--family", "cord", "--gravity", "on", "--quick"), densities=True),
        Kind("sheet", "sheets of 1:25", scene=("--family", "sheet", "--gravity", "on", "--quick"), densities=True),
        Kind("block", "thrown on a floor", scene=("--family", "block", "--quick"), densities=True),
        Kind("hidden", "parts that look alike, mass told", scene=("--hidden",)),
        Kind("gusts", "two gusts", scene=("--force", "two_gusts"), densities=True),
        Kind("poke", "local pushes", scene=("--force", "poke"), densities=True),
        Kind("second", "another law and integrator", scene=(SECOND, "--quick"), densities=True),
        Kind("moving", "begins in motion", scene=("--moving-start",), densities=True),
        Kind("nothing_colour", "colour", colour=True, known=()),
        Kind("nothing_colour_mask", "colour, mask", colour=True, known=(MASK,)),
        Kind("nothing_depth", "depth", known=()),
        Kind("nothing_depth_mask", "depth, mask", known=(MASK,)),
        Kind("clamp", "depth, mask, clamp, gravity, rest", known=(MASK, *HELD)),
        Kind("thickness", "and the thickness", known=(MASK, *HELD, *THICK)),
    )
}


def confirmation_seeds(commit: str, count: int) -> list[int]:
    """Seeds that follow from the full name of a commit, so that nobody can choose them."""
    return random.Random(commit).sample(CONFIRMATION_SEEDS, count)


@dataclass(frozen=True)
class Maker:
    """The scenes' generator: its folder, and the Python that has MuJoCo."""

    folder: Path
    python: str = sys.executable

    def make(self, seed: int, flags: Sequence[str], out: Path) -> None:
        """The scene of a seed in `out`, unless it is there; `out` holds REFUSED where the generator has none."""
        if (out / STATS).exists() or (out / REFUSED).exists():
            return
        self._call([*self._program(flags), "--seed", str(seed), *(flag for flag in flags if flag != SECOND), "--out", str(out)], out)

    def _program(self, flags: Sequence[str]) -> list[str]:
        if SECOND in flags:
            return [str(SECOND_TRUTH), str(self.folder)]
        return [str(OTHER_SCENES), str(self.folder)] if set(flags) & set(OTHERS) else [str(self.folder / "make_scene.py")]

    def degrade(self, seed: int, clean: Path, out: Path) -> None:
        """The same scene as a depth camera would record it."""
        if not (out / "frames.json").exists():
            out.mkdir(parents=True, exist_ok=True)
            self._call([str(self.folder / "degrade.py"), str(clean / "clip.mcap"), str(out / "clip.mcap"), "--seed", str(seed), "--all"], out)

    def _call(self, words: Sequence[str], out: Path) -> None:
        command, name = [self.python, *words], Path(words[0]).name
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=MADE_IN_S, check=False, env={"MUJOCO_GL": "egl", "OMP_NUM_THREADS": "1"} | os.environ)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{name}: {error}; give --generator its folder and --mujoco a Python that has MuJoCo") from error
        if done.returncode:
            said = (done.stderr.strip().splitlines() or [done.stdout.strip() or f"status {done.returncode}"])[-1]
            if "no acceptable draw" not in said and not (out / STATS).exists():
                raise InputError(f"{name} {out.name}: {said[:300]}")
            out.mkdir(parents=True, exist_ok=True)
            (out / REFUSED).write_text(said)


def clips_of(seeds: Iterable[int], kinds: Sequence[Kind], folder: Path, maker: Maker, jobs: int) -> list[Path]:
    """Folders of clips, g{SEED}-{KIND} each, made where they are not there; seeds without a scene are left out.

    A scene that cannot be made is said, and tried again by the same command; it takes no other with it. Raises InputError where none can be made.
    """
    seeds = list(seeds)
    scenes = dict.fromkeys((seed, kind.scene) for kind in kinds for seed in seeds)  # kinds may share one

    def of_seed(seed: int) -> list[Path]:
        return [made for kind in kinds if (made := _clip(seed, kind, folder, maker)) is not None]

    with ThreadPoolExecutor(jobs) as pool:
        failed = [said for said in pool.map(lambda scene: _unmade(maker, scene, folder), scenes) if said]
        if len(failed) == len(scenes):
            raise InputError(failed[0])
        print(*failed, sep="\n", end="\n" if failed else "", file=sys.stderr, flush=True)
        return [clip for clips in pool.map(of_seed, seeds) for clip in clips]


def _unmade(maker: Maker, scene: tuple[int, tuple[str, ...]], folder: Path) -> str:
    """Why a scene could not be made; nothing where it was, or where its seed has none."""
    try:
        maker.make(*scene, _scene(folder, *scene))
    except InputError as error:
        return str(error)
    return ""


def facts_of(clip: Path) -> dict[str, Any]:
    """What is known of a clip beside its truth: seed, kind, number of materials, family, gravity, what pushes it."""
    stats = json.loads((clip / STATS).read_text())
    seed, _, kind = clip.name.removeprefix("g").partition("-")
    pushed = "poke" if stats["force"].startswith("push") else "gust"
    return {"seed": int(seed), "kind": kind, "materials": len(stats["E_Pa"]), "family": stats["family"], "gravity": stats["gravity"], "push": pushed, "hz": stats.get("f_tail_Hz")}


def _scene(folder: Path, seed: int, flags: Sequence[str]) -> Path:
    return folder / "scenes" / "-".join((f"g{seed}", *(flag.strip("-") for flag in flags)))


def _clip(seed: int, kind: Kind, folder: Path, maker: Maker) -> Path | None:
    scene = _scene(folder, seed, kind.scene)
    if not (scene / STATS).exists():  # the seed has none, or it could not be made
        return None
    source = scene
    if kind.sensor:
        source = scene.with_name(f"{scene.name}-sensor")
        maker.degrade(seed, scene, source)
    clip = folder / "clips" / f"g{seed}-{kind.name}"
    clip.mkdir(parents=True, exist_ok=True)
    for name in SCENE:
        _linked(source / name, clip / name)
    _linked(scene / STATS, clip / STATS)
    told = _told(yaml.safe_load((scene / "given.yaml").read_text()), kind, np.load(scene / "truth.npz"))
    (clip / "given.yaml").write_text(yaml.safe_dump(told))
    return clip


def _told(given: dict[str, Any], kind: Kind, truth: Any) -> dict[str, Any]:
    if kind.densities:
        del given["scene"]["mass_kg"]
        given["scene"]["density_kg_m3"] = [float(rho) for rho in truth["part_rho"]]
    if kind.known is not None:
        given["scene"] = {name: value for name, value in given["scene"].items() if name in kind.known}
    if kind.colour:
        given["topics"] = given.get("topics", {}) | {"depth": "none"}
    if kind.frames:
        given["frames"] = dict(zip(("fit", "predict"), kind.frames, strict=True))
    return given


def _linked(source: Path, target: Path) -> None:
    if not target.exists():
        os.link(source, target)
