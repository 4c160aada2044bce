"""The bar as a MuJoCo flex of quadratic 27-node corotational elements, its modes and its motion."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import eigsh, spsolve

from tools.sample_maker.bar import FPS, Bar
from tools.sample_maker.paint import assets

SUBSTEPS = 134  # implicit steps a frame, 0.25 ms: first-order damping of the integrator stays below the material's
KUHN_TETS = ([0, 4, 6, 7], [0, 4, 5, 7], [0, 2, 6, 7], [0, 2, 3, 7], [0, 1, 5, 7], [0, 1, 3, 7])  # of a cube, corners 4i + 2j + k
IMAGE_SIZE = (320, 240)
RUNS, SWAY_SHARE = 2, 0.2  # most runs to the wanted sway, and how near to it is near enough
SETTLING_STEP, SETTLING_LOSS, SETTLED = 2e-3, 0.15, 1e-10  # [s]; share of the velocity lost in a step; largest displacement in a step [m]


@dataclass
class Motion:
    """T frames of the N nodes, world frame."""

    positions: np.ndarray  # [m], (T, N, 3)
    velocities: np.ndarray  # [m/s], (T, N, 3)
    force: np.ndarray  # [N], mean over [t_k, t_k+1), (T, N, 3)
    states: np.ndarray  # of the simulator, for rendering, (T, nq)


class Body:
    """Compiled model. `tets` (M, 4) cut every element into 48 tetrahedra for rendering and for the truth file."""

    def __init__(self, bar: Bar, seed: int) -> None:
        self.bar, self.tets, self.tet_part = bar, *_tets(bar)
        files = assets(bar, seed)
        models = [mujoco.MjModel.from_xml_string(_xml(bar, self.tets, nu, list(files)), files) for nu in bar.poisson]
        count = len(bar.cell_part)
        # one compilation per Poisson ratio; the stiffness of an element is linear in Young's modulus
        unit = np.stack([m.flex_stiffness.reshape(count, 81, 81).copy() for m in models])
        self.unit = unit[bar.cell_part, np.arange(count)]
        self.model = models[0]
        self.model.flex_stiffness[:] = (self.unit * bar.young[bar.cell_part][:, None, None]).ravel()
        paint = [mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_MATERIAL, f"part{i}") for i in range(bar.shape.parts)]
        self.model.flex_matid[:] = np.array(paint)[self.tet_part].reshape(self.model.flex_matid.shape)
        self.free = np.flatnonzero(~bar.clamped)
        bodies = self.model.flex_nodebodyid[self.free]
        self.dofs = (self.model.body_dofadr[bodies][:, None] + np.arange(3)).ravel()
        self.model.dof_damping[self.dofs] = bar.mass_damping * np.repeat(bar.mass[self.free], 3)
        self.data = mujoco.MjData(self.model)

    def matrices(self, young: np.ndarray) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
        """Stiffness [N/m] and lumped mass [kg] of the free nodes about the rest shape, for Young's moduli (n,) [Pa]."""
        dofs = (3 * self.bar.cell_nodes[:, :, None] + np.arange(3)).reshape(len(self.bar.cell_nodes), -1)
        values = -self.unit * np.asarray(young)[self.bar.cell_part][:, None, None]
        place = np.repeat(dofs, 81, 1).ravel(), np.tile(dofs, (1, 81)).ravel()
        size = 3 * len(self.bar.nodes)
        stiffness = sparse.csr_matrix((values.ravel(), place), (size, size))
        free = (3 * self.free[:, None] + np.arange(3)).ravel()
        return stiffness[free][:, free].tocsc(), sparse.diags(np.repeat(self.bar.mass[self.free], 3)).tocsc()

    def frequencies(self, young: np.ndarray, count: int = 4) -> np.ndarray:
        """Lowest eigenfrequencies [Hz] without gravity for Young's moduli (n,) [Pa]."""
        stiffness, mass = self.matrices(young)
        squared = eigsh(stiffness, k=count, M=mass, sigma=0, v0=np.ones(stiffness.shape[0]), return_eigenvectors=False)
        return np.sqrt(np.sort(squared)) / (2 * np.pi)

    def set_gust(self) -> None:
        """First guess of the gust: the density that bends the bar statically by the wanted sway."""
        stiffness, _ = self.matrices(self.bar.young)
        unit = spsolve(stiffness, (self.bar.volume[self.free][:, None] * self.bar.push).ravel())
        self.bar.gust_peak = self.bar.sway * self.bar.shape.length / np.linalg.norm(unit.reshape(-1, 3), axis=1).max()

    def settle(self) -> None:
        """Brings the body from its stress-free shape to rest under gravity."""
        model, data, step = self.model, self.data, self.model.opt.timestep
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        if not self.bar.gravity.any():
            return
        model.opt.timestep, moved = SETTLING_STEP, np.inf
        while moved > SETTLED:
            mujoco.mj_step(model, data)
            data.qvel[:] *= 1 - SETTLING_LOSS
            moved = np.abs(data.qvel).max() * SETTLING_STEP
        model.opt.timestep, data.qvel[:], data.time = step, 0.0, 0.0

    def run(self, frames: int) -> Motion:
        """Simulates from rest."""
        model, data, bar = self.model, self.data, self.bar
        self.settle()
        step, volume = model.opt.timestep, bar.volume[self.free][:, None]
        rows: dict[str, list[np.ndarray]] = {name: [] for name in ("positions", "velocities", "force", "states")}
        for k in range(frames):
            mujoco.mj_forward(model, data)
            rows["positions"].append(data.flexvert_xpos.copy())
            rows["velocities"].append(self._full(data.qvel[self.dofs]))
            rows["states"].append(data.qpos.copy())
            loads = [bar.gust(k / FPS + (i + 0.5) * step) for i in range(SUBSTEPS)]
            rows["force"].append(self._full(np.mean(loads, 0) * volume))
            for load in loads if k < frames - 1 else []:
                data.qfrc_applied[self.dofs] = (load * volume).ravel()
                mujoco.mj_step(model, data)
        return Motion(**{name: np.array(row) for name, row in rows.items()})

    def _full(self, values: np.ndarray) -> np.ndarray:
        full = np.zeros((len(self.bar.nodes), 3))
        full[self.free] = values.reshape(-1, 3)
        return full


def swing(body: Body, frames: int) -> Motion:
    """The motion with the wanted sway: after each run the force is scaled."""
    body.set_gust()
    for _ in range(RUNS):
        motion = body.run(frames)
        sway = np.linalg.norm(motion.positions - motion.positions[0], axis=2).max() / body.bar.shape.length
        if abs(sway / body.bar.sway - 1) < SWAY_SHARE:
            break
        body.bar.gust_peak *= body.bar.sway / sway
    return motion


def clip_frames(bar: Bar, frequency: float) -> int:
    """Frames so that 1.4 periods of the first frequency [Hz] follow the gust, 36 at least."""
    return max(36, int(np.ceil((bar.gust_end + 1.4 / frequency) * FPS)) + 2)


def first_free_frame(motion: Motion) -> int:
    """First frame from which on no force acts."""
    return int(np.flatnonzero(np.abs(motion.force).max((1, 2)))[-1]) + 1


def _tets(bar: Bar) -> tuple[np.ndarray, np.ndarray]:
    corner = np.array(list(np.ndindex(2, 2, 2)))
    sub = 2 * bar.cell_index[:, None, None] + corner[:, None] + corner  # cells, sub-cubes, corners, xyz
    number = np.ravel_multi_index(tuple(sub.transpose(3, 0, 1, 2)), 2 * bar.cells + 1).reshape(-1, 8)
    return number[:, KUHN_TETS].reshape(-1, 4), np.repeat(bar.cell_part, 8 * len(KUHN_TETS))


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in np.ravel(values))


def _xml(bar: Bar, tets: np.ndarray, nu: float, files: list[str]) -> str:
    slides = "".join(f'<joint type="slide" axis="{a}"/>' for a in ("1 0 0", "0 1 0", "0 0 1"))
    bodies = "".join(
        f'<body name="n{i}" pos="{_numbers(bar.nodes[i])}"><inertial pos="0 0 0" mass="{bar.mass[i]:.9g}" diaginertia="1e-7 1e-7 1e-7"/>'
        f"{slides}</body>"
        for i in np.flatnonzero(~bar.clamped)
    )
    names = " ".join("root" if c else f"n{i}" for i, c in enumerate(bar.clamped))
    look = "".join(
        f'<texture name="{f[:-4]}" type="2d" file="{f}"/><material name="{f[:-4]}" texture="{f[:-4]}" specular="0" reflectance="0"/>'
        for f in files
    )
    mount = bar.size / 2 + 0.005
    mount[bar.axis] = 0.03
    centre = np.zeros(3)
    centre[bar.axis] = -0.03 * bar.sign
    away = np.array([-np.sin(bar.azimuth), np.cos(bar.azimuth), 0])
    texcoord = (bar.nodes - bar.low) @ np.array([[1, 0.45, 0], [0, 0.45, 1]]).T * 2.2 + 0.1
    return f'''<mujoco><option timestep="{1 / FPS / SUBSTEPS}" gravity="{_numbers(bar.gravity)}" integrator="discrete" solver="Newton" iterations="400"
 tolerance="1e-7"><flag contact="disable"/></option><size memory="800M"/><statistic center="0 0 0" extent="1"/>
<visual><global offwidth="{2 * IMAGE_SIZE[0]}" offheight="{2 * IMAGE_SIZE[1]}"/><quality shadowsize="0" offsamples="0"/>
<map znear="0.05" zfar="6"/><headlight ambient=".42 .42 .42" diffuse=".18 .18 .18" specular="0 0 0"/></visual><asset>{look}</asset>
<worldbody><light directional="true" castshadow="false" pos="0 0 3" dir="{_numbers(bar.light)}" diffuse=".55 .55 .52" specular="0 0 0"
 ambient="0 0 0"/><geom type="plane" size="3 3 .1" pos="{_numbers(1.1 * away)}" zaxis="{_numbers(-away)}" material="wall"/>
<geom type="plane" size="3 3 .1" pos="0 0 {bar.floor_m:g}" material="floor"/><camera name="camera" fovy="{bar.fovy}"/>
<geom type="box" size="{_numbers(mount)}" pos="{_numbers(centre)}" rgba=".36 .36 .38 1"/><body name="root">{bodies}</body></worldbody>
<deformable><flex name="bar" dim="3" radius="0.0002" cellcount="{_numbers(bar.cells)}" dof="quadratic" flatskin="true" material="part0"
 body="{" ".join(["root"] * len(bar.nodes))}" vertex="{_numbers(bar.nodes)}" element="{" ".join(map(str, tets.ravel()))}"
 texcoord="{_numbers(texcoord)}" node="{names}" nodecoord="{_numbers(np.where(bar.clamped[:, None], bar.nodes, 0))}">
<contact contype="0" conaffinity="0" selfcollide="none"/><elasticity young="1" poisson="{nu}" damping="{bar.stiffness_damping}"/></flex>
</deformable></mujoco>'''
