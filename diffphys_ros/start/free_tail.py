"""Young's modulus per part and damping from the free tail: damped eigenmodes fitted to the tracks, no force model needed.

Variable projection (Golub and Pereyra 1973): the amplitudes of the modes enter linearly and are solved for inside, the search
runs over log E per part and the two damping constants. Several ratios between the parts are tried, each first scaled so that
the leading mode swings at the frequency seen, so that the result does not depend on the first guess.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import orth
from scipy.optimize import least_squares

from ..damping import Damping
from ..modes.detuned import Detuned
from ..modes.model import ModalModel
from ..vibration.coordinates import Projection
from ..vibration.forced_frames import FASTEST
from .untold import TOLD, Untold

MODEL_ERROR = 0.01  # of the motion: geometry, density, large rotations; no fit is trusted beyond it [chosen]
FREQUENCY_SD = 0.006  # of each mode's log frequency: errors of outline, thickness and density differ from mode to mode; with .01 told parts at the clamp lay .45 of their stated deviations off [docs/measurements/choices.md]
COUPLING_SD = FREQUENCY_SD / np.sqrt(2.0)  # of two neighbouring modes by the same errors: of a random symmetric matrix, beside its diagonal [derived]
RATIO_SD = np.log(10.0)  # prior standard deviation of the log ratio of neighbouring parts: half of it drew stiff outer parts to their neighbours [docs/measurements/choices.md]
MASS_DAMPING_SD, STIFFNESS_DAMPING_SD = 0.3, 5e-3  # weak priors [1/s], [s]: soft solids damp by their strain rate [chosen]
MOST_MASS_DAMPING, MOST_STIFFNESS_DAMPING = 10.0, 0.1  # bounds of the search, [1/s], [s] [chosen]
START_RATIOS = (0.05, 0.2, 0.5, 1.0, 2.5, 8.0)  # of E between parts, at which searches begin [numerical]
WIDEST = np.log(1e3)  # of E about the start of a search [numerical]
LEAST_YOUNG, MOST_YOUNG = 1.0, 1e13  # [Pa]; no gel is as soft and no solid as stiff: what nothing in the tail bounds goes no further [chosen]
MATCHES = 8  # rounds of scaling E to the frequency seen [numerical]
SLOWEST2 = 1e-2  # squared angular frequency [1/s^2] below which nothing swings [numerical]
SPANNED = 1e-9  # of the largest singular value of shapes: directions with less are none [numerical]
DETUNED = 4  # leading modes whose frequencies may be off on their own [chosen]


@dataclass(frozen=True)
class Physics:
    """A point of the search."""

    young: np.ndarray  # [Pa], (n,)
    damping: Damping[float]
    detune: np.ndarray  # log of the body's frequencies over the model's, leading modes, (k,)
    density: np.ndarray | None = None  # [kg/m^3], (n,); None: the model's
    poisson: np.ndarray | None = None  # Poisson's ratios (n,); None: the model's
    coupling: np.ndarray | None = None  # of each of these modes to the next (modes/detuned.py), (k - 1,); None: zeros

    @classmethod
    def of(cls, vector: np.ndarray, parts: int, untold: Untold = TOLD) -> Physics:
        """From log E per part, then alpha, beta, what is untold of the materials, coupling and detune, over their prior standard deviations."""
        alpha, beta = vector[parts : parts + 2] * (MASS_DAMPING_SD, STIFFNESS_DAMPING_SD)
        first = parts + 2 + untold.size
        own = first + (len(vector) - first) // 2
        coupling, detune = COUPLING_SD * vector[first:own], FREQUENCY_SD * vector[own:]
        return cls(np.exp(vector[:parts]), Damping(float(alpha), float(beta)), detune, *untold.of(vector[parts + 2 : first]), coupling)

    def vector(self, untold: Untold = TOLD) -> np.ndarray:
        """The inverse of `of`, (n + 2 + m + k - 1 + k,) with m unknowns of the materials."""
        damping = self.damping.mass_per_s / MASS_DAMPING_SD, self.damping.stiffness_s / STIFFNESS_DAMPING_SD
        coupling = np.zeros(self.couplings) if self.coupling is None else self.coupling
        return np.r_[np.log(self.young), damping, untold.unknown(self.density, self.poisson), coupling / COUPLING_SD, self.detune / FREQUENCY_SD]

    @property
    def couplings(self) -> int:
        """How many of them there are."""
        return max(len(self.detune) - 1, 0)

    @property
    def tuned(self) -> Physics:
        """The same where the model has the body's frequencies."""
        return replace(self, detune=np.zeros_like(self.detune), coupling=None)

    def detuned(self, squares: np.ndarray) -> Detuned:
        """The leading modes of a model of squared angular frequencies (r,) [1/s^2]."""
        return Detuned.of(squares, self.detune, self.coupling)

    def change(self, before: Physics) -> float:
        """Largest change of log E and log density of a part."""
        pairs = [(self.young, before.young)] + ([] if self.density is None or before.density is None else [(self.density, before.density)])
        return float(max(np.abs(np.log(now / then)).max() for now, then in pairs))

    def bounds(self, untold: Untold = TOLD) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of a search from here."""
        least, stiffest, free = np.log(LEAST_YOUNG), np.log(MOST_YOUNG), np.full(self.couplings + len(self.detune), np.inf)
        log_young = np.clip(np.log(self.young), least, stiffest)
        most = [MOST_MASS_DAMPING / MASS_DAMPING_SD, MOST_STIFFNESS_DAMPING / STIFFNESS_DAMPING_SD]
        low, high = np.maximum(log_young - WIDEST, least), np.minimum(log_young + WIDEST, stiffest)
        material_low, material_high = untold.bounds()
        return np.r_[low, 0.0, 0.0, material_low, -free], np.r_[high, most, material_high, free]


def prior_residual(vector: np.ndarray, parts: int) -> np.ndarray:
    """Residuals in standard deviations: log ratios of neighbouring parts, damping, what is untold of the materials, coupling and detuning."""
    return np.concatenate([np.diff(vector[:parts], axis=0) / RATIO_SD, vector[parts:]])


@dataclass(frozen=True)
class Tail:
    """Free motion of compressed tracks (see observation.Projection) from frame `first` on."""

    modal: ModalModel
    seen: Projection
    first: int
    period_s: float
    known: np.ndarray  # bool, (T,)
    at_rest: bool  # whether the oscillation is about the shape of frame 0
    sigma_m: float  # what a frame may miss [m]
    most_modes: int
    untold: Untold = TOLD  # of the materials, where a search is to find it
    detuned: int = DETUNED  # leading modes whose frequencies may be off
    weighed: Callable[[np.ndarray], np.ndarray] | None = None  # what a search makes of misfits in standard deviations, (K d, m); None: nothing
    data: np.ndarray = field(init=False)  # (K, d)
    times: np.ndarray = field(init=False)  # of the frames that count, after `first` [s], (K,)

    def __post_init__(self) -> None:
        frames = np.flatnonzero(self.known & (np.arange(len(self.known)) >= self.first))
        object.__setattr__(self, "data", self.seen.data[frames])
        object.__setattr__(self, "times", (frames - self.first) * self.period_s)

    @property
    def size_m(self) -> float:
        """Root mean square of the motion in the tail [m]."""
        return float(np.sqrt((self.data**2).sum(1).mean()))

    def missed_m(self, physics: Physics) -> float:
        """Root mean square of what the modes miss of a frame [m]; 0 without a free frame."""
        return float(np.sqrt((self.misfit(physics) ** 2).sum(1).mean())) if len(self.data) else 0.0

    def excess(self, physics: Physics) -> float:
        """Misfit over what a frame may miss; at least 1."""
        return max(self.missed_m(physics) / self.sigma_m, 1.0)

    def noise(self, physics: Physics) -> np.ndarray:
        """Covariance (d, d) of what a frame misses out of step with the modes, over sigma^2: noise of single frames, which the modes' amplitudes take on in
        part; what is missed in step is an error of shapes. As if one frame more had missed sigma in every direction: a short tail tells little of its noise."""
        clock, missed = self._missed(physics)
        frames, functions = clock.shape
        out = (missed - _in_time_with(clock, missed)) / self.sigma_m
        return (out.T @ out + np.eye(out.shape[1])) / (max(frames - functions, 0) + 1)

    def leading_mode(self, young: np.ndarray) -> int:
        """The eigenmode at `young` whose shape holds most of the tail's motion, of those that swing: a body that nothing holds drifts as well."""
        omega2, shapes = self.modal.eigen(young)
        seen = self.seen.operator @ shapes
        share = ((self.data @ seen) ** 2).sum(0) / np.maximum((seen**2).sum(0), 1e-300)
        return int(np.where(omega2 > SLOWEST2, share, -1.0)[: self.most_modes].argmax())

    def matched(self, young: np.ndarray, observed_hz: float) -> np.ndarray:
        """`young` times the factor at which the leading mode swings at the observed frequency (and nothing buckles)."""
        for _ in range(MATCHES):
            omega2 = self.modal.eigen(young)[0]
            if omega2[0] < 0:
                young = 2.0 * young
                continue
            young = young * np.clip((2 * np.pi * observed_hz) ** 2 / max(omega2[self.leading_mode(young)], SLOWEST2), 0.1, 10.0)
        return np.clip(young, LEAST_YOUNG, MOST_YOUNG)

    def misfit(self, physics: Physics) -> np.ndarray:
        """Observed minus modelled tail [m], (K, d), with the best amplitudes."""
        return self._missed(physics)[1]

    def swings(self, physics: Physics) -> np.ndarray:
        """The fitted motion of each mode over time, root mean square over the points [m], (K, k)."""
        clock, place, amplitude = self._fitted(physics)
        kinds = 2 if self.at_rest else 3
        return (clock * amplitude * np.linalg.norm(place, axis=0)).reshape(len(clock), -1, kinds).sum(2)

    def in_step(self, physics: Physics) -> np.ndarray:
        """What is missed in time with the modes [m], (K, d): errors of their shapes leave it, noise of single frames little."""
        return _in_time_with(*self._missed(physics))

    def rough(self, physics: Physics, directions: np.ndarray) -> float:
        """What is missed in time with the modes in some directions, an orthogonal projection (d, d), beyond the noise of frames, over the motion; mean square."""
        clock, missed = self._missed(physics)
        missed = missed @ directions
        in_step = _in_time_with(clock, missed)
        out, functions = missed - in_step, clock.shape[1]
        noise = functions / max(len(clock) - functions, 1) * (out**2).sum()
        return float(max((in_step**2).sum() - noise, 0.0) / ((self.data**2).sum() or 1.0))

    def smooth(self, physics: Physics, count: int) -> np.ndarray:
        """An orthonormal basis (d, m) of the shapes of the `count` leading modes as the tracks see them."""
        shapes = self.modal.eigen(physics.young, physics.density, physics.poisson)[1]
        return np.asarray(np.linalg.qr(self.seen.operator @ shapes[:, :count])[0])

    def bent(self) -> np.ndarray:
        """Projection (d, d) onto what the modal model can be bent into, as the tracks see it. Beside it lie errors that differ from point to point."""
        own = orth(self.seen.operator, rcond=SPANNED)
        return np.asarray(own @ own.T)

    def slope(self, physics: Physics, untold: Untold = TOLD) -> np.ndarray:
        """Derivatives (K d, S) of the misfit over sigma by the S entries of Physics.vector(untold).

        The amplitudes move along: with the misfit r = y - F a and N = F'F, da = N^-1 (dF' r - F' dF a) and dr = -dF a - F da.
        """
        clock, place, amplitude = self._fitted(physics)
        missed = self.data - (clock * amplitude) @ place.T
        by_clock, by_place = self._changes(physics, untold, clock)
        moved = (by_clock * amplitude) @ place.T + (clock * amplitude) @ np.swapaxes(by_place, 1, 2)  # dF a
        right = ((missed @ place) * by_clock).sum(1) + ((missed @ by_place - moved @ place) * clock).sum(1)
        by_amplitude = _least_squares(_normal(clock, place), right.T).T
        changes = -moved - (clock * by_amplitude[:, None]) @ place.T
        return changes.reshape(len(changes), -1).T / self.sigma_m

    def _missed(self, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
        """The functions of time (K, c k), and what they miss with the best amplitudes [m], (K, d)."""
        clock, place, amplitude = self._fitted(physics)
        return clock, self.data - (clock * amplitude) @ place.T

    def _fitted(self, physics: Physics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Functions of time (K, c k), shapes (d, c k) and the best amplitudes (c k,) of c functions for each of k modes."""
        omega, decay, seen = self._modes(physics)
        wave = np.exp(np.outer(self.times, 1j * omega - decay))
        shapes = [wave.real, wave.imag] + ([] if self.at_rest else [np.ones_like(wave.real)])
        clock, place = np.stack(shapes, 2).reshape(len(self.times), -1), np.repeat(seen, len(shapes), 1)
        return clock, place, _least_squares(_normal(clock, place), ((self.data @ place) * clock).sum(0))

    def _changes(self, physics: Physics, untold: Untold, clock: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the functions of time (S, K, c k) and of the shapes (S, d, c k) by the entries of Physics.vector(untold)."""
        omega, decay, _ = self._modes(physics)
        by_omega, by_decay, by_seen = self._mode_changes(physics, untold, omega, decay)
        kinds, times = clock.shape[1] // len(omega), self.times[:, None]
        real, imaginary = clock[:, 0::kinds], clock[:, 1::kinds]
        by_clock = np.zeros((len(by_omega), *clock.shape))
        by_clock[..., 0::kinds] = -times * (by_decay[:, None] * real + by_omega[:, None] * imaginary)
        by_clock[..., 1::kinds] = times * (by_omega[:, None] * real - by_decay[:, None] * imaginary)
        return by_clock, np.repeat(by_seen, kinds, 2)

    def _modes(self, physics: Physics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Damped angular frequencies and decays (k,) of the resolved modes, and their observed shapes (d, k)."""
        squares, shapes = self.modal.eigen(physics.young, physics.density, physics.poisson)
        model2 = self._resolved(squares)
        omega2, shapes = physics.detuned(model2).leading(model2, shapes[:, : len(model2)])
        decay = physics.damping.decay(omega2)
        return np.sqrt(np.maximum(omega2 - decay**2, SLOWEST2)), decay, self.seen.operator @ shapes

    def _resolved(self, squares: np.ndarray) -> np.ndarray:
        """Squared angular frequencies (k,) of the modes that the frames resolve."""
        count = (squares < (2 * np.pi * FASTEST / self.period_s) ** 2).sum()
        return np.maximum(squares[: min(max(int(count), 1), self.most_modes)], SLOWEST2)

    def _mode_changes(
        self, physics: Physics, untold: Untold, omega: np.ndarray, decay: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of what `_modes` says, (S, k) twice and (S, d, k), by the entries of Physics.vector(untold)."""
        parts, modes = len(physics.young), len(omega)
        material, first, squares, by_squares, by_shapes = self._material_changes(physics, untold)
        model2 = self._resolved(squares)
        leading = physics.detuned(model2)
        count, own = len(leading.omega), first + physics.couplings
        by_omega2, by_decay = (np.zeros((own + len(physics.detune), modes)) for _ in range(2))
        by_omega2[material] = np.where(squares[:modes] > SLOWEST2, by_squares[:, :modes], 0.0)
        by_matrix = leading.by_squares(by_omega2[:, :count])
        by_matrix[first:own] = COUPLING_SD * leading.by_coupling(physics.couplings)
        by_matrix[own : own + count] = FREQUENCY_SD * leading.by_detune()
        by_omega2[:, :count], mixed = leading.slopes(by_matrix)
        omega2, shapes = leading.leading(model2, self.modal.eigen(physics.young, physics.density, physics.poisson)[1][:, :modes])
        by_decay[:] = 0.5 * physics.damping.stiffness_s * by_omega2
        by_decay[parts], by_decay[parts + 1] = 0.5 * MASS_DAMPING_SD, 0.5 * STIFFNESS_DAMPING_SD * omega2
        by_omega = 0.5 * np.where(omega2 - decay**2 > SLOWEST2, by_omega2 - 2 * decay * by_decay, 0.0) / omega
        moved = np.zeros((len(by_omega2), len(shapes), modes))
        moved[material] = by_shapes[:, :, :modes]
        moved[:, :, :count] = moved[:, :, :count] @ leading.turn + shapes[:, :count] @ mixed
        return by_omega, by_decay, self.seen.operator @ moved

    def _material_changes(self, physics: Physics, untold: Untold) -> tuple[np.ndarray, int, np.ndarray, np.ndarray, np.ndarray]:
        """Which entries of Physics.vector(untold) are of materials, where coupling and detuning begin, the squared frequencies, and derivatives of
        these and of the shapes by those entries."""
        parts, modal = len(physics.young), self.modal
        density = physics.density if physics.density is not None or untold.densities is None else modal.density
        poisson = physics.poisson if physics.poisson is not None or untold.ratios is None else modal.poisson
        squares, by_squares, by_shapes = modal.eigen_changes(physics.young, density, poisson)
        given = [0 if each is None else len(each) for each in (density, poisson)]
        sought = np.repeat([untold.densities is not None, untold.ratios is not None], given)
        turn = untold.slope(density).T
        by_squares = np.concatenate([by_squares[:parts], turn @ by_squares[parts:][sought]])
        by_shapes = np.concatenate([by_shapes[:parts], np.tensordot(turn, by_shapes[parts:][sought], 1)])
        first = parts + 2 + untold.size
        return np.r_[:parts, parts + 2 : first], first, squares, by_squares, by_shapes

    def residual(self, vector: np.ndarray) -> np.ndarray:
        """Misfit over sigma and the priors, for least squares over Physics.of(vector)."""
        parts = len(self.modal.stiffness)
        missed = self.misfit(Physics.of(vector, parts, self.untold)).reshape(-1, 1) / self.sigma_m
        return np.concatenate([self._weighed(missed)[:, 0], prior_residual(vector, parts)])

    def search(self, start: Physics) -> tuple[float, Physics]:
        """Cost and physics at the minimum that is reached from a start."""
        low, high = start.bounds(self.untold)
        inside = np.clip(start.vector(self.untold), low + 1e-9, high - 1e-9)
        found = least_squares(self.residual, inside, bounds=(low, high), jac=self._slope, max_nfev=60)
        return float(found.cost), Physics.of(found.x, len(start.young), self.untold)

    def curvature(self, physics: Physics) -> np.ndarray:
        """Gauss-Newton matrix (S, S) of a search's cost by Physics.vector(untold), priors included."""
        slope = self._slope(physics.vector(self.untold))
        return np.asarray(slope.T @ slope)

    def _weighed(self, misfits: np.ndarray) -> np.ndarray:
        return misfits if self.weighed is None else self.weighed(misfits)

    def _slope(self, vector: np.ndarray) -> np.ndarray:
        parts = len(self.modal.stiffness)
        slope = self._weighed(self.slope(Physics.of(vector, parts, self.untold), self.untold))
        return np.concatenate([slope, prior_residual(np.eye(len(vector)), parts)])  # the priors are linear

    def fit(self, young: np.ndarray, observed_hz: float, decay_per_s: float) -> tuple[Physics, np.ndarray]:
        """The best of the searches from several ratios between the parts, each matched to the observed frequency; and the standard deviation (n,) of log10 E
        by the valleys that the others ended in.

        Args:
            young: first guess [Pa], (n,); only its order of magnitude counts.
            observed_hz, decay_per_s: of the leading oscillation.
        """
        beta = max(2 * decay_per_s, 0.0) / (2 * np.pi * observed_hz) ** 2
        still = np.zeros(self.detuned)
        damping = Damping(0.0, min(beta, 0.5 * MOST_STIFFNESS_DAMPING))
        starts = [Physics(self.matched(young * r, observed_hz), damping, still) for r in start_ratios(len(young))]
        found = [self.search(start) for start in starts]
        best = min(found, key=lambda pair: pair[0])
        if self.untold.densities is not None:
            found += [self.search(replace(best[1], density=density)) for density in self.untold.densities.others(best[1].density)]
            best = min(found, key=lambda pair: pair[0])
        return best[1], self._rivals_sd(best, found)

    def _rivals_sd(self, best: tuple[float, Physics], found: Sequence[tuple[float, Physics]]) -> np.ndarray:
        """How far minima lie from the best one, (n,) in log10 E, root mean square, each by its likelihood where a frame misses what the best one does."""
        likelihood = np.exp([(best[0] - cost) / self.excess(best[1]) ** 2 for cost, _ in found])
        apart = np.log10([physics.young / best[1].young for _, physics in found])
        return np.sqrt(likelihood @ apart**2 / likelihood.sum())


def _in_time_with(clock: np.ndarray, missed: np.ndarray) -> np.ndarray:
    """What of `missed` (K, d) the functions of time (K, c) explain with any amplitudes."""
    own = np.linalg.qr(clock)[0]
    return np.asarray(own @ (own.T @ missed))


def _normal(clock: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Normal matrix (c k, c k) of the amplitudes."""
    normal = (clock.T @ clock) * (place.T @ place)
    normal[np.diag_indices(len(normal))] *= 1 + 1e-9
    return normal


def _least_squares(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(normal, right, rcond=1e-10)[0]


def physical(size: int, parts: int) -> np.ndarray:
    """What the entries of a Physics.vector() must not fall below, (size,): a damping below 0 blows up what is stiff."""
    least = np.full(size, -np.inf)
    least[parts : parts + 2] = 0.0
    return least


def start_ratios(parts: int) -> list[np.ndarray]:
    """Factors on a uniform guess, (n,) each: all outer parts alike, and each outer part alone."""
    ratios = [np.r_[1.0, np.full(parts - 1, r)] for r in (START_RATIOS if parts > 1 else (1.0,))]
    if parts > 2:
        ratios += [np.where(np.arange(parts) == i, r, 1.0) for i in range(1, parts) for r in START_RATIOS if r != 1.0]
    return ratios
