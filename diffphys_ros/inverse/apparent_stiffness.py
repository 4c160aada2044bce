"""How stiff the solver's grid makes this very body: E_apparent / E, by a free vibration of the solver itself.

A grid of a few cells over the thickness bends within 1 % of right on bars, but is up to 20 % off where the section twists, and
shifts where parts of different stiffness meet (docs/measurements/accuracy.md). It is measured where it counts: the body is released in its
leading modes at small amplitude, and the frequencies of the simulated swing are compared with those of the finite elements.
A modulus fitted on the grid, times E_apparent / E, is the body's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import least_squares

from ..modes import ModalModel
from ..simulate import Simulator, substeps_per_frame
from ..types import Grid, Particles

PERIODS = 1.0  # of the slowest mode that is followed
STEPS_PER_PERIOD = 24  # samples of the fastest
AMPLITUDE = 0.004  # largest displacement over the body's length: small, so that the motion is linear
LOW, HIGH = 0.25, 2.5  # range of E_apparent / E that is believed
MOST_MODES = 2  # that the motion is divided among
UNMEASURED = 0.02  # log10 E: expected error on a free body, whose grid is not calibrated
LEFT_OVER = 0.005  # log10 E: what a corrected fit misses a truth on a grid twice as fine by (docs/measurements/accuracy.md)


@dataclass(frozen=True)
class Apparent:
    """Stiffness of the lattice over that of the body, mode by mode."""

    ratio: np.ndarray  # squared frequency ratios, (k,)
    share: np.ndarray  # of the observed motion, sums to 1, (k,)
    loss: np.ndarray  # log amplitude that the lattice alone takes of each mode in a substep, (k,)

    @property
    def value(self) -> float:
        """Geometric mean, weighted by the share of the motion."""
        return float(np.exp(self.share @ np.log(self.ratio)))

    @property
    def expected_log10_error(self) -> float:
        """Of a modulus that was corrected by `value`: one number cannot be right for modes that the grid stiffens differently."""
        spread = self.share @ np.log10(self.ratio / self.value) ** 2
        return float(np.sqrt(spread + LEFT_OVER**2))


def measure_apparent(particles: Particles, grid: Grid, modal: ModalModel, young: np.ndarray, share: np.ndarray, *, device: str = "cpu") -> Apparent:
    """Release the modes that carry `share` (k,) of the motion and fit their frequencies; young (n,) [Pa]. Gravity is left out."""
    omega, value, gradient = elastic_modes(modal, young, particles, np.arange(len(share)))
    ratio, loss = swings(particles, grid, young, omega, value, gradient, device=device)
    return Apparent(ratio, share, loss)


def elastic_modes(modal: ModalModel, young: np.ndarray, particles: Particles, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angular frequencies (k,) [rad/s], values (P, 3, k) and gradients (P, 3, 3, k) [1/m] of the chosen elastic modes (k,),
    counted from the slowest; zero at ghosts."""
    omega2, shapes = np.linalg.eigh(modal.elastic(young))
    value, gradient = (field @ shapes[:, chosen] for field in modal.evaluate(particles.x_rest))
    value[particles.ghost], gradient[particles.ghost] = 0.0, 0.0
    return np.sqrt(omega2[chosen]), value, gradient


def swing_ratios(
    particles: Particles, grid: Grid, young: np.ndarray, omega: np.ndarray, value: np.ndarray, gradient: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """Squared ratios (k,) of `swings`."""
    return swings(particles, grid, young, omega, value, gradient, device=device)[0]


def swings(
    particles: Particles, grid: Grid, young: np.ndarray, omega: np.ndarray, value: np.ndarray, gradient: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Squared ratios (k,) of the frequencies at which the solver swings in given mode shapes to the given ones, and the log amplitude
    (k,) that it takes of them in a substep: transfers between particles and grid smooth what they carry.

    All k modes start together, at velocities small enough for them not to meet. young (n,) [Pa]; the rest as `elastic_modes` gives it.
    """
    period_s = float(2 * np.pi / omega.max() / STEPS_PER_PERIOD)
    frames = int(np.ceil(PERIODS * 2 * np.pi / omega.min() / period_s))
    each = young[particles.part - 1]
    substeps = substeps_per_frame(each, particles.poisson, particles.density, dx=grid.dx, period_s=period_s)
    # in single precision a slow, slender body at so small a strain comes out with down to a third of its stiffness: what a substep strains it is rounded away
    simulator = Simulator(particles, grid, substeps=substeps, period_s=period_s, device=device, dtype=torch.float64)
    length = float(np.ptp(particles.x_rest, axis=0).max())
    rate = omega * AMPLITUDE * length / np.abs(value).max((0, 1))
    coordinates = _swing(simulator, value, gradient, rate, each, frames)
    ratio, decay = np.array([_squared_ratio_and_decay(q, w, period_s) for q, w in zip(coordinates.T, omega, strict=True)]).T
    return np.clip(ratio, LOW, HIGH), np.maximum(decay, 0.0) * period_s / substeps


def _swing(simulator: Simulator, value: np.ndarray, gradient: np.ndarray, rate: np.ndarray, young: np.ndarray, frames: int) -> np.ndarray:
    """Modal coordinates (frames + 1, k) of the simulated swing."""
    tensor, particles = simulator.tensor, simulator.particles
    mass = particles.mass * ~particles.ghost
    projection = np.einsum("p,pck->kpc", mass, value)
    gram = np.einsum("kpc,pcl->kl", projection, value)
    with torch.no_grad():
        state = simulator.rest(v=tensor(value @ rate), C=tensor(gradient @ rate))
        force = torch.zeros((frames, len(mass), 3), **simulator.options)
        states = simulator.rollout(state, tensor(young), tensor(particles.poisson), force, 0.0)
    moved = (states.x - states.x[:1]).double().cpu().numpy()
    return np.linalg.solve(gram, np.einsum("kpc,tpc->kt", projection, moved)).T


def _squared_ratio_and_decay(q: np.ndarray, omega: float, period_s: float) -> tuple[float, float]:
    """(frequency of q / omega)^2, and the rate [1/s] at which q decays, by a damped sine through the origin."""
    t, q = np.arange(len(q)) * period_s, q / np.abs(q).max()  # of order one: the solver's tolerances are absolute

    def wave(p: np.ndarray) -> np.ndarray:
        return np.exp(-p[1] * t) * np.stack([np.sin(omega * p[0] * t), np.cos(omega * p[0] * t) - 1])

    def residual(p: np.ndarray) -> np.ndarray:
        basis = wave(p).T
        return basis @ np.linalg.lstsq(basis, q, rcond=None)[0] - q

    fit = least_squares(residual, [1.0, 0.1], x_scale=[0.1, 1.0], bounds=([np.sqrt(LOW), -1.0], [np.sqrt(HIGH), 20.0]))
    return float(fit.x[0] ** 2), float(fit.x[1])


def motion_share(modal: ModalModel, young: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Share (k,) of each of the lowest modes in basis coordinates (T, r) over time, k <= MOST_MODES, sums to 1."""
    _, shapes = np.linalg.eigh(modal.elastic(young))
    energy = ((coordinates @ shapes) ** 2).mean(0)[:MOST_MODES]
    if not energy.any():
        return np.ones(1)  # start values that do not move: the lowest mode stands for all
    share = np.where(energy > 0.02 * energy.max(), energy, 0.0)
    kept = int(np.flatnonzero(share).max()) + 1
    return share[:kept] / share.sum()
