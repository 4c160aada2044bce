"""Makes a scene of the generator's whose motion another solid than the generator's has computed (hyperelastic.py).

    python benchmarks/second_truth.py GENERATOR --seed 7 --quick --out DIR

Bodies, materials, forces, cameras and pictures are those of the seed. Law, elements' integration and time steps are not, and every cell of the
mesh is cut into eight (--refine 1: it is not), so that a recovery which is right on both has not learnt one simulator.
GENERATOR and other options as for other_scenes.py.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from hyperelastic import Marcher, Solid

SUBSTEPS = 8  # a frame
HELD_M = 1e-9  # nodes that lie no higher are clamped
SAID = "computed by a Neo-Hookean solid in implicit midpoint steps"


def solid_of(scene: Any, refine: int) -> tuple[Solid, np.ndarray]:
    """The scene's body, and the numbers of its nodes that are the mesh's vertices."""
    mesh, parts = scene.mesh, np.ndindex(refine, refine, refine)
    filled = np.argwhere(mesh.filled)
    part = mesh.cell_part[tuple(filled.T)]
    finer = (refine * filled[:, None] + np.array(list(parts))).reshape(-1, 3)
    cell = np.repeat(part, refine**3)
    constants = (np.asarray(each, float)[cell] for each in (scene.young, scene.poisson, scene.density))
    solid = Solid(finer, mesh.cell_size / refine, mesh.origin, *constants, scene.mass_damping, scene.stiffness_damping)
    number = {tuple(index): i for i, index in enumerate(solid.index.tolist())}
    wanted = np.rint((mesh.vertices - mesh.origin) / (mesh.cell_size / refine / 2)).astype(int)
    return solid, np.array([number[tuple(index)] for index in wanted.tolist()])


def run_with(simulate: Any, refine: int) -> Any:
    """In place of the generator's simulate.run."""

    def run(body: Any, slowest_omega: float) -> Any:
        scene = body.scene
        solid, vertices = solid_of(scene, refine)
        march = Marcher(solid, solid.nodes[:, 2] > HELD_M)
        weight = solid.weight(scene.gravity_in_object())
        u = march.equilibrium(weight) if scene.gravity.any() else np.zeros_like(solid.nodes)
        scene.info["sag_m"] = float(np.linalg.norm(u, axis=1).max())
        v, points, step = np.zeros_like(u), solid.nodes, 1 / simulate.FPS / SUBSTEPS
        rows: dict[str, list[np.ndarray]] = {k: [] for k in ("positions", "velocities", "force", "force_now", "qpos")}
        for k in range(scene.frames + scene.lead_in_frames):
            rows["positions"].append(scene.mesh.vertices + u[vertices])
            rows["velocities"].append(v[vertices])
            state = np.zeros(body.model.nq)
            state[body.dofs] = u[vertices][body.free_vertices].ravel()
            rows["qpos"].append(state)
            rows["force_now"].append(_on_vertices(body, scene.force(points, k / simulate.FPS)[vertices]))
            loads = [scene.force(points, k / simulate.FPS + (i + 0.5) * step) for i in range(SUBSTEPS)]
            rows["force"].append(_on_vertices(body, np.mean(loads, 0)[vertices]))
            for load in loads:
                u, v = march.stepped(u, v, solid.load(load) + weight, step)
        clip = {key: np.array(values)[scene.lead_in_frames :] for key, values in rows.items()}
        for key in ("positions", "velocities", "force", "force_now"):
            clip[key] = clip[key] @ scene.world_from_object.T
        return simulate.Motion(**clip, time_step=step)

    return run


def _on_vertices(body: Any, density: np.ndarray) -> np.ndarray:
    """Forces [N] on the vertices; what is clamped has none."""
    return np.asarray(density * body.scene.mesh.vertex_volume[:, None] * ~body.clamped[:, None])


def main(arguments: list[str]) -> int:
    """Makes one scene; returns the generator's exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("generator", type=Path)
    parser.add_argument("--refine", type=int, default=2, help="sub-cells of a cell along each axis")
    options, rest = parser.parse_known_args(arguments)
    sys.path.insert(0, str(options.generator))
    maker = importlib.import_module("make_scene")
    maker.simulate.run = run_with(maker.simulate, options.refine)
    truth, readme = maker.files.truth_arrays, maker.files.readme
    maker.files.truth_arrays = lambda body, *others: truth(body, *others) | {"damping_stiffness_beta_effective": body.scene.stiffness_damping}
    maker.files.readme = lambda stats: f"{readme(stats)}\nThe motion is {SAID}.\n"
    return int(maker.main(rest))


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(code)  # the software renderer may hang on a normal exit
