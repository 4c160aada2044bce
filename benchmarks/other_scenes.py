"""Makes a scene of a kind that the scenes' generator lacks, with its parts: hooks, cords, sheets, forks, thrown blocks, borders without a colour.

    python benchmarks/other_scenes.py GENERATOR --family hook --seed 7 --out DIR

GENERATOR is the folder of make_scene.py. Everything that is not said here (drawing of materials and forces, simulation, camera, recording,
truth) is the generator's, and so are its other options: --parts, --gravity, --moving-start, --quick, --frames.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

GENERATORS = ("beam", "plate", "tee")  # families of the generator's own
CONTACT_RATE = 2 * math.pi * 150.0  # rad/s: a node of mass m that is in the floor is pushed out by m (CONTACT_RATE)^2 a metre
CONTACT_DAMPING = 0.3  # of the critical one
FRICTION = 0.8  # Coulomb
SLIP_M_S = 0.01  # speed at which friction is whole


@dataclass(frozen=True)
class Family:
    """What sets a family apart from the generator's."""

    shape: Any  # (rng, parts, quick) -> mesh
    tilt_deg: tuple[float, ...]  # of the stem, one of these
    amplitude: tuple[float, float] = (0.08, 0.15)  # of the length
    least_cover: float = 0.05  # of the picture
    parts: int | None = None  # materials; None draws


def _hook(rng: Any, parts: int, quick: bool) -> Any:
    """A stem, an arm to one side, and its end turned down: of three materials one each."""
    side, stem, reach = rng.uniform(0.034, 0.046), int(rng.integers(5, 8)), int(rng.integers(3, 5))
    drop, sign = int(rng.integers(1, 3)), int(rng.choice([-1, 1]))
    blocks = [(0, 0, k) for k in range(stem)] + [(sign * (i + 1), 0, stem - 1) for i in range(reach)]
    blocks += [(sign * reach, 0, stem - 2 - i) for i in range(drop)]
    part = [0] * stem + [1] * reach + [2] * drop
    return _meshed(blocks, 3 * (side,), part, parts, quick)


def _fork(rng: Any, parts: int, quick: bool) -> Any:
    """A stem that carries a bar with a prong at each end; of two materials the prongs are of the second, of three each is of its own."""
    side, stem, reach = rng.uniform(0.034, 0.044), int(rng.integers(3, 5)), int(rng.integers(1, 3))
    left, right = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    bar = [(i, 0, stem) for i in range(-reach, reach + 1)]
    prongs = [(-reach, 0, stem + 1 + k) for k in range(left)] + [(reach, 0, stem + 1 + k) for k in range(right)]
    blocks = [(0, 0, k) for k in range(stem)] + bar + prongs
    return _meshed(blocks, 3 * (side,), [0] * (stem + len(bar)) + [1] * left + [2] * right, parts, quick)


def _cord(rng: Any, parts: int, quick: bool) -> Any:
    """A long thin bar, 1:11 to 1:15."""
    length, count = rng.uniform(0.36, 0.52), 12
    side = length / rng.uniform(11, 15)
    part = [min(parts - 1, k * parts // count) for k in range(count)]
    return _meshed([(0, 0, k) for k in range(count)], (side, side, length / count), part, parts, True)


def _sheet(rng: Any, parts: int, quick: bool) -> Any:
    """A sheet 25 times as long as it is thick."""
    length = rng.uniform(0.30, 0.40)
    width, rows, columns = length * rng.uniform(0.5, 0.7), 8, 4
    blocks = [(i, 0, k) for k in range(rows) for i in range(columns)]
    part = [min(parts - 1, k * parts // rows) for _, _, k in blocks]
    return _meshed(blocks, (width / columns, length / 25, length / rows), part, parts, True)


def _block(rng: Any, parts: int, quick: bool) -> Any:
    """A stout block that nothing holds."""
    size = rng.uniform(0.10, 0.14)
    blocks = [(i, j, k) for k in range(4) for j in range(2) for i in range(3)]
    return _meshed(blocks, (size / 3, size / 3, size * rng.uniform(1.0, 1.4) / 4), [0] * len(blocks), 1, True)


FAMILIES = {
    "hook": Family(_hook, (0.0, 180.0)),
    "fork": Family(_fork, (0.0,)),
    "cord": Family(_cord, (180.0,), amplitude=(0.28, 0.42), least_cover=0.02),
    "sheet": Family(_sheet, (180.0,)),
    "block": Family(_block, (0.0, 10.0, 25.0), parts=1),
}


def _meshed(blocks: list[tuple[int, int, int]], size: Any, part: list[int], parts: int, quick: bool) -> Any:
    families = importlib.import_module("softbody.families")
    mesh = families.refine_blocks(blocks, size, [min(p, parts - 1) for p in part], (1, 1, 1) if quick else (2, 2, 2))
    foot = mesh.vertices[mesh.vertices[:, 2] < 1e-9]
    families.mesh_shift(mesh, -(foot[:, 0].min() + foot[:, 0].max()) / 2)
    return mesh


def extend(maker: Any, options: argparse.Namespace) -> None:
    """Teaches the generator's modules the families, the limits that are theirs, and the options."""
    families, checks = (importlib.import_module(f"softbody.{name}") for name in ("families", "checks"))
    family = FAMILIES.get(options.family or "")
    if family is not None:
        families.FAMILIES = (*families.FAMILIES, *FAMILIES)  # of which a seed would else draw
    families.SHAPES.update({name: each.shape for name, each in FAMILIES.items()})
    if options.force:
        families.BURSTS = (options.force,)
    _with_limits(maker, families, checks, family, options)
    if options.plain:
        _painted_evenly()
    if options.family == "block":
        _let_go(maker)


def _painted_evenly() -> None:
    """Surfaces without a texture: each part of one colour."""
    texture = importlib.import_module("softbody.texture")

    def skin(base: Any, dark: Any, style: str, rng: Any, size: int = 64) -> bytes:
        return bytes(texture.png(np.broadcast_to(np.array(base, float), (size, size, 3))))

    texture.skin = skin


def _with_limits(maker: Any, families: Any, checks: Any, family: Family | None, options: argparse.Namespace) -> None:
    draw, draw_tilt, lowest, problems = families.draw_scene, families.draw_tilt, families.lowest_frequency, checks.problems

    def scene_of(rng: Any, seed: int, given: Any) -> Any:
        if family is not None and family.parts is not None:
            given.parts = family.parts
        scene = draw(rng, seed, given)
        if family is not None:
            scene.info["amplitude_target"] = float(rng.uniform(*family.amplitude))
        if options.family == "block":
            for points in (scene.mesh.grid_nodes, scene.mesh.vertices):
                points[:, 2] += 1e-4  # what lies on z = 0 would be held
            scene.mesh.origin[2] += 1e-4
        if options.hidden:
            scene.look["parts"] = scene.look["parts"][:1]
        return scene

    def within(body: Any, omega: Any) -> Any:
        low, high = (0.055, 0.195) if family is None else (0.7 * family.amplitude[0], 1.3 * family.amplitude[1])
        for _ in range(3):
            motion = maker.simulate.run(body, omega[0])
            amplitude = np.linalg.norm(motion.positions - motion.positions[0], axis=2).max() / body.scene.info["length_m"]
            if low <= amplitude <= high:
                return motion
            body.scene.force.scale *= body.scene.info["amplitude_target"] / amplitude
        raise SystemExit("the amplitude could not be set")

    families.draw_scene = scene_of
    maker.simulate_within_limits = within
    if family is None:
        return
    families.draw_tilt = lambda rng, name: float(rng.choice(family.tilt_deg)) if name in FAMILIES else draw_tilt(rng, name)
    families.lowest_frequency = lambda gravity, tilt, length: families.FREQUENCY_RANGE[0] if tilt == 180 else lowest(gravity, tilt, length)
    checks.problems = lambda scene, figures: [name for name in problems(scene, figures) if not name.startswith(("amplitude", "object covers"))]
    maker.guess_camera = lambda scene, padding: _framed(maker, families, scene, padding, family.least_cover)


def _framed(maker: Any, families: Any, scene: Any, padding: float, least: float) -> None:
    world = scene.mesh.vertices @ scene.world_from_object.T
    swung = [world + sign * padding * axis for axis in np.eye(3) for sign in (-1, 1)]
    camera = maker.view.frame_object(scene.view, scene.image_size, np.concatenate(swung))
    if maker.view.silhouette(camera, world, scene.mesh.surface()).mean() < least:
        raise families.Redraw("covers too little of the image")


def _let_go(maker: Any) -> None:
    """Nothing holds the body: it flies under gravity and meets a floor; no other force acts."""
    modal, simulate, files, checks = maker.modal, maker.simulate, maker.files, maker.checks
    truth, given, measure, problems = files.truth_arrays, files.given_yaml, checks.measure, checks.problems

    def modes(body: Any, count: int = 12) -> Any:
        stiffness, mass = modal.assemble(body)
        squared, shapes = modal.eigsh(stiffness, k=count + 6, M=mass, sigma=-1.0, v0=np.ones(stiffness.shape[0]))
        return np.sqrt(np.maximum(squared[6:], 0)), shapes[:, 6:]

    def tune_stiffness(body: Any) -> Any:
        scene, rng = body.scene, np.random.default_rng(body.scene.seed)
        squash = rng.uniform(0.10, 0.20)  # of its height, roughly, by an impact at `speed`
        scene.info["speed_m_s"], scene.info["height_m"] = speed, height = float(rng.uniform(0.2, 0.8)), float(rng.uniform(0.02, 0.05))
        impact = speed**2 + 2 * 9.81 * height
        body.set_young([float(f"{(scene.density * impact / squash**2)[0]:.4g}")])
        scene.info["velocity_m_s"] = [float(rng.uniform(-0.1, 0.1)), 0.0, -speed]
        scene.info["spin_rad_s"] = float(rng.uniform(-1.5, 1.5))
        low = (scene.mesh.vertices @ scene.world_from_object.T)[:, 2].min()
        scene.floor_z = float(low - height)
        scene.gravity, scene.look["mount"] = np.array([0.0, 0.0, -9.81]), (1e-4, 1e-4, 1e-4)
        scene.force.scale, scene.force.bursts, scene.force.text = 0.0, [], "none: thrown on a floor"
        scene.lead_in_frames = 0
        body._compile()  # the floor and gravity are in the model
        return modes(body)

    maker.tune_stiffness, modal.modes = tune_stiffness, modes
    maker.tune_force = lambda *_: None
    maker.simulate_within_limits = lambda body, omega: _thrown(body, simulate)
    files.truth_arrays = lambda body, camera, motion, masks, stamps: truth(body, camera, motion, masks, stamps) | {"contact_force": motion.contact.astype(np.float32), "has_contact": True, "force": 0 * motion.force.astype(np.float32)}
    files.clamp_box = lambda body: np.zeros(6)

    def told(body: Any) -> str:
        lines = given(body).replace("floor_z_m: null", f"floor_z_m: {body.scene.floor_z:.5g}").replace("at_rest: true ", "at_rest: false").splitlines()
        return "\n".join("  clamp_box_m: null" if "clamp_box_m" in line else line for line in lines) + "\n"

    def figures(body: Any, camera: Any, motion: Any, *others: Any) -> dict[str, Any]:
        motion.force_now[1, 0, 0] = 1e-30  # the generator asks for the frames on which a force acts
        return dict(measure(body, camera, motion, *others))

    files.given_yaml, checks.measure = told, figures
    asked = ("first frequency", "object stays above", "at rest", "sag")
    checks.problems = lambda scene, measured: [name for name in problems(scene, measured) if not name.startswith(asked)]


def _thrown(body: Any, simulate: Any) -> Any:
    """Steps the flight and the impact; contact is a stiff, damped penalty with Coulomb friction on every node."""
    mujoco = importlib.import_module("mujoco")
    scene, mesh, model, data = body.scene, body.scene.mesh, body.model, body.data
    body.reset()
    substeps = round(1 / simulate.FPS / scene.time_step)
    model.opt.timestep = step = 1 / simulate.FPS / substeps
    world = scene.world_from_object
    arm = (mesh.vertices[body.free_vertices] - mesh.vertices.mean(0)) @ world.T
    start = np.array(scene.info["velocity_m_s"]) + np.cross([0.0, scene.info["spin_rad_s"], 0.0], arm)
    mujoco.mj_forward(model, data)
    data.qvel[body.dofs] = (start @ world).ravel()
    mass = body.mass[body.free_vertices][:, None]
    rows: dict[str, list[Any]] = {k: [] for k in ("positions", "velocities", "contact", "qpos")}
    for k in range(scene.frames):
        mujoco.mj_forward(model, data)
        rows["positions"].append(data.flexvert_xpos.copy())
        rows["velocities"].append(body.velocities())
        rows["qpos"].append(data.qpos.copy())
        mean = np.zeros((len(mesh.vertices), 3))
        for _ in range(substeps if k < scene.frames - 1 else 0):
            push = mass * _floor_push(data.flexvert_xpos[body.free_vertices] @ world.T, data.qvel[body.dofs].reshape(-1, 3) @ world.T, scene.floor_z)
            data.qfrc_applied[body.dofs] = (push @ world).ravel()
            mean[body.free_vertices] += push @ world / substeps
            mujoco.mj_step(model, data)
        rows["contact"].append(mean)
        if not np.isfinite(data.qpos).all() or np.abs(data.qpos).max() > 3:
            raise RuntimeError(f"simulation unstable at frame {k}")
    clip = {k: np.array(v) for k, v in rows.items()}
    for key in ("positions", "velocities", "contact"):
        clip[key] = clip[key] @ world.T
    nothing = np.zeros_like(clip["contact"])
    motion = simulate.Motion(clip["positions"], clip["velocities"], nothing, nothing.copy(), clip["qpos"], step)
    motion.contact = clip["contact"]
    return motion


def _floor_push(positions: np.ndarray, velocities: np.ndarray, floor_z: float) -> np.ndarray:
    """Acceleration (N, 3) m/s^2 of nodes by the floor, world."""
    depth = np.maximum(floor_z - positions[:, 2], 0.0)
    normal = np.maximum(CONTACT_RATE**2 * depth - 2 * CONTACT_DAMPING * CONTACT_RATE * velocities[:, 2] * (depth > 0), 0.0)
    speed = np.linalg.norm(velocities[:, :2], axis=1)
    rub = -FRICTION * normal * np.minimum(speed / SLIP_M_S, 1.0) / np.maximum(speed, 1e-9)
    return np.column_stack([rub[:, None] * velocities[:, :2], normal])


def main(arguments: list[str]) -> int:
    """Makes one scene; returns the generator's exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("generator", type=Path)
    parser.add_argument("--family", choices=(*FAMILIES, *GENERATORS), help="default: drawn of the generator's")
    parser.add_argument("--hidden", action="store_true", help="all parts look alike")
    parser.add_argument("--plain", action="store_true", help="parts of one colour each, without texture")
    parser.add_argument("--force", help="kind of force, default drawn")
    options, rest = parser.parse_known_args(arguments)
    sys.path.insert(0, str(options.generator))
    maker = importlib.import_module("make_scene")
    extend(maker, options)
    return int(maker.main([*rest, *(["--family", options.family] if options.family else [])]))


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(code)  # the software renderer may hang on a normal exit
