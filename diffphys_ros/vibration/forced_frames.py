"""Which frames are forced, and the free motion's frequencies and decays, from coordinates over time alone. numpy only.

A linear body that is left alone obeys q[k+2] = A q[k+1] + B q[k]; what a frame adds to that is a force in frames k, k+1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

COMMON_SHARE = 0.1  # of the track noise that is common to all points, at the least [chosen]
CURVED_SHARE = 0.02  # of the second differences: large swings change the frequency a little [chosen]
SECOND_NOISE = 6.0  # variance of a second difference over that of a frame: 1 + 4 + 1 [derived]
FORCED_SIGMA = 4.0  # misfit of the recursion that tells of a force [chosen]
FAINTER_SIGMA = 3.0  # the same where with that no tail is free, for it may be fitted to the fainter of two gusts then; if so it finds the tail to be as short as its misfit says [chosen]
ROBUST_ROUNDS = 6  # at which equations are those of a force is asked anew [numerical]
RIDGE = 1e-5  # of the largest coordinate: decides for coordinates that hardly move [numerical]
TAIL_RISE = 1.35  # growth of the misfit that ends the backward search for the start of the tail [chosen]
LEAST_EQUATIONS = 2.0  # scalar equations per unknown of the recursion, at the least [chosen]
LEAST_TAIL_FRAMES, LEAST_TAIL_PERIODS = 8, 0.7  # that a free tail lasts; periods are those of its leading oscillation [chosen]
FAINT_SIGMA = 2.0  # misfit down to which a run of forced frames is followed to its ends [chosen]
BRIDGE = 4  # free frames between forced ones that are taken as a zero crossing of the force [chosen]
FASTEST = 0.45  # of the frame rate: faster oscillations are not resolved by the frames [derived: a tenth below half of it]
GLITCH_ROWS = 3  # equations that one wrong frame spoils [derived]
VAGUEST = 0.15  # standard deviation of log10 E, twice that of the log frequency, from which a tail tells no stiffness [chosen]
LARGEST_GROWTH, SURELY = 0.25, 3.0  # of the log amplitude over a free tail; and standard deviations of it [chosen]
WORST_TAIL = 0.15  # misfit of the recursion, as a share of the motion in the tail, beyond which there is no free tail [chosen]


def least_tail_frames(hz: float, period_s: float) -> int:
    """Frames that a free tail lasts at the least, whose leading oscillation has this frequency."""
    return max(LEAST_TAIL_FRAMES, int(np.ceil(LEAST_TAIL_PERIODS / (hz * period_s))))


@dataclass(frozen=True)
class Support:
    """Forced frames and free oscillation."""

    forced: np.ndarray  # bool, (T,): a force acts in [t_k, t_k+1)
    has_free_tail: bool
    frequencies_hz: np.ndarray  # leading first, (n,)
    decay_per_s: np.ndarray  # (n,)
    sigma_m: float  # misfit of one coordinate of the recursion in the tail [m]
    centre: np.ndarray | None = None  # of the free motion [m], (n,); None: frame 0 is it, or the recursion has none within the motion

    @property
    def allowed(self) -> np.ndarray:
        """The forced frames and one more on each side: onsets are weak, bool, (T,)."""
        f = self.forced
        return f | np.r_[f[1:], False] | np.r_[False, f[:-1]]

    def grown(self, before: int, after: int) -> Support:
        """The same with more forced frames before the first and after the last."""
        forced = self.forced.copy()
        active = np.flatnonzero(forced)
        if len(active):
            forced[max(active[0] - before, 0) : active[0]] = True
            forced[active[-1] : active[-1] + after + 1] = True
        return replace(self, forced=forced)

    @property
    def tail_start(self) -> int:
        """First frame after which no force acts."""
        active = np.flatnonzero(self.allowed)
        return int(active[-1] + 1) if len(active) else 0


def find_support(coordinates: np.ndarray, known: np.ndarray, period_s: float, *, at_rest: bool, noise_m: float) -> Support:
    """Forced frames and frequencies of coordinates (T, n) [m]. Frames with known = False are stepped over.

    at_rest: frame 0 is an equilibrium, so that the oscillation is about zero; otherwise its centre is free.
    noise_m: standard deviation of one coordinate of one track [m]; a share of it is the floor of the misfit that tells of a force.
    """
    rows = Rows.of(coordinates, known, at_rest)
    start = start_of_tail(rows)
    if start is None:
        return Support(np.ones(len(coordinates), bool), False, np.zeros(0), np.zeros(0), 0.0)
    read = partial(_support, rows, start, coordinates=coordinates, known=known, period_s=period_s, at_rest=at_rest, noise_m=noise_m)
    usual = read(FORCED_SIGMA)
    if usual.has_free_tail:
        return usual
    closer = read(FAINTER_SIGMA)
    return closer if closer.has_free_tail and closer.tail_start > start else usual


def _support(rows: Rows, start: int, forced_sigma: float, *, coordinates: np.ndarray, known: np.ndarray, period_s: float, at_rest: bool, noise_m: float) -> Support:
    """The same by the recursion over the rows from `start` on, less those that it misses by `forced_sigma`."""
    matrix, misfit, keep, sigma, floor = rows.robust(start, coordinates[known], noise_m, forced_sigma)
    glitch = _glitches(rows.usable & ~keep, rows.target - rows.source @ matrix, rows.usable)
    faint = rows.usable & (misfit > FAINT_SIGMA * sigma)
    forced = _frames(_followed(rows.usable & ~keep & ~glitch, faint & ~glitch, rows.usable), len(coordinates))
    tail = np.flatnonzero(forced)[-1] + 2 if forced.any() else 0
    frequencies, decays = _oscillation(matrix, coordinates[tail:], period_s)
    sigma_one = float(sigma) / np.sqrt(coordinates.shape[1])
    free = _is_free(coordinates[tail:], frequencies, sigma_one, period_s) and (forced.any() or not at_rest)  # something set it moving
    free = free and _tells(_leading(matrix, coordinates[tail:]), rows.leading_sd(keep, matrix, coordinates[tail:], floor), len(coordinates) - tail)
    return Support(forced, bool(free), frequencies, decays, sigma_one, None if at_rest else _within(rows.centre(matrix), coordinates[known]))


@dataclass(frozen=True)
class Rows:
    """Equation k: target[k] = source[k] @ matrix, for frames k, k + 1, k + 2."""

    target: np.ndarray  # (T-2, n)
    source: np.ndarray  # (T-2, 2 n [+ 1])
    usable: np.ndarray  # bool, (T-2,)

    @classmethod
    def of(cls, q: np.ndarray, known: np.ndarray, at_rest: bool) -> Rows:
        source = np.column_stack([q[1:-1], q[:-2]] + ([] if at_rest else [np.full(len(q) - 2, np.abs(q).max())]))
        return cls(q[2:], source, known[2:] & known[1:-1] & known[:-2])

    def fit(self, keep: np.ndarray) -> np.ndarray:
        """Least-squares matrix (2 n [+ 1], n), with a touch of ridge for coordinates that hardly move."""
        ridge = RIDGE * np.abs(self.source).max() * np.eye(self.source.shape[1])
        zero = np.zeros((len(ridge), self.target.shape[1]))
        return np.linalg.lstsq(np.vstack([self.source[keep], ridge]), np.vstack([self.target[keep], zero]), rcond=None)[0]

    def robust(self, start: int, moved: np.ndarray, noise_m: float, forced_sigma: float = FORCED_SIGMA) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, float]:
        """Matrix of the equations from `start` on without those of a force, the misfits (T-2,) of all under it, which were kept, their usual
        misfit, and the floor of one coordinate of that, for known coordinates `moved` (F, n). Those of a force are missed by `forced_sigma` times the
        usual. The few between them, where it passes zero, are its own: with them the recursion learns the force, until no equation stands out."""
        second = np.diff(moved, 2, axis=0)  # six times the noise variance; what the recursion has to explain
        floor = float(np.hypot(COMMON_SHARE * noise_m * np.sqrt(SECOND_NOISE), CURVED_SHARE * np.sqrt((second**2).mean())))
        keep = self.usable & (np.arange(len(self.target)) >= start)
        for _ in range(ROBUST_ROUNDS):
            matrix = self.fit(keep)
            misfit = self.misfit(matrix)
            sigma = float(max(np.sqrt((misfit[keep] ** 2).mean()), floor * np.sqrt(self.target.shape[1])))
            keep = self.usable & ~bridged(self.usable & (misfit >= forced_sigma * sigma))
        return matrix, misfit, keep, sigma, floor

    def centre(self, matrix: np.ndarray) -> np.ndarray:
        """The coordinates (n,) at which a recursion with a constant stays."""
        n = matrix.shape[1]
        still: np.ndarray = np.linalg.lstsq((np.eye(n) - matrix[:n] - matrix[n : 2 * n]).T, self.source[0, -1] * matrix[-1], rcond=None)[0]
        return still

    def leading_sd(self, keep: np.ndarray, matrix: np.ndarray, tail: np.ndarray, floor: float) -> np.ndarray:
        """Standard deviations (2,) of `_leading(matrix, tail)` for a matrix fitted to the equations `keep`, by their residual per degree of
        freedom, `floor` [m] at the least; infinite where the equations are no more than the unknowns or a matrix as likely does not swing."""
        unknowns = len(matrix)
        spare = int(keep.sum()) - unknowns
        if spare < 1:
            return np.full(2, np.inf)
        source, rest = self.source[keep], (self.target - self.source @ matrix)[keep]
        noise = np.sqrt(np.maximum((rest**2).sum(0) / spare, floor**2))
        told, turn = np.linalg.eigh(np.linalg.pinv(source.T @ source, hermitian=True))
        spread = turn * np.sqrt(np.maximum(told, 0.0))
        steps = [np.outer(direction, column) for direction in spread.T for column in np.diag(noise)]
        moved = np.array([[_leading(matrix + side * step, tail) for side in (-1, 1)] for step in steps])
        return np.sqrt(np.square(moved - _leading(matrix, tail)).mean(1).sum(0))

    def misfit(self, matrix: np.ndarray) -> np.ndarray:
        """Norm of the residual of every equation [m], (T-2,)."""
        return np.linalg.norm(self.target - self.source @ matrix, axis=1)


def start_of_tail(rows: Rows) -> int | None:
    """First equation of the longest tail whose misfit stays near that of the last frames; None if the clip is too short."""
    unknowns = rows.source.shape[1]
    least = int(np.ceil(LEAST_EQUATIONS * unknowns))
    starts = [s for s in range(len(rows.target)) if rows.usable[s:].sum() >= least]
    if len(starts) < 2:
        return None
    spread = []
    for s in starts:
        keep = rows.usable & (np.arange(len(rows.usable)) >= s)
        spread.append(np.sqrt((rows.misfit(rows.fit(keep))[keep] ** 2).sum() / (keep.sum() - unknowns)))
    level = np.median(spread[len(spread) // 2 :])
    for index in range(len(starts) - 1, -1, -1):
        if spread[index] > TAIL_RISE * level and index < len(starts) - 3:
            return starts[index + 1]
    return starts[0]


def _glitches(forced_rows: np.ndarray, residual: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Short runs whose residuals change sign from row to row: a frame that was seen wrongly, not pushed. A run beside a lost frame may be
    the rest of a longer one."""
    found = np.zeros_like(forced_rows)
    for first, last in runs(forced_rows):
        run = residual[first : last + 1]
        if usable[max(first - 1, 0) : last + 2].all() and len(run) <= GLITCH_ROWS and ((run[1:] * run[:-1]).sum(1) < 0).all():
            found[first : last + 1] = True
    return found


def _followed(strong: np.ndarray, faint: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """The runs of `faint` equations that hold at least two strong ones in a row. Equations with a lost frame say nothing: runs go on
    through them, and what they hide beside a force may be one."""
    grown = np.zeros_like(strong)
    for first, last in runs(strong | faint | ~usable):
        told = strong[first : last + 1][usable[first : last + 1]]
        if (told[:-1] & told[1:]).any():
            grown[first : last + 1] = True
    return grown


def _frames(forced_rows: np.ndarray, frames: int) -> np.ndarray:
    """Frames that carry a force. Equation k holds the force of frames k and k + 1, so a run of equations a..b tells of a
    force in a + 1 .. b; a run of one tells of an outlier."""
    forced = np.zeros(frames, bool)
    for first, last in runs(forced_rows):
        forced[first + 1 : last + 1] = True
    return bridged(forced)


def bridged(forced: np.ndarray) -> np.ndarray:
    """The same frames (T,) and the few between them in which a force passes zero."""
    filled = forced.copy()
    for (_, end), (begin, _) in pairwise(runs(forced)):
        if begin - end - 1 <= BRIDGE:
            filled[end:begin] = True
    return filled


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _oscillation(matrix: np.ndarray, tail: np.ndarray, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and decays [1/s] of the recursion, by falling share of the tail's motion."""
    n = tail.shape[1]
    companion = np.block([[matrix[:n].T, matrix[n : 2 * n].T], [np.eye(n), np.zeros((n, n))]])
    values, vectors = np.linalg.eig(companion)
    rate = np.log(values.astype(complex) + 1e-300) / period_s
    swing = np.flatnonzero((rate.imag > 1e-6) & (rate.imag * period_s < 2 * np.pi * FASTEST))
    if not len(swing) or len(tail) < 3:
        return np.zeros(0), np.zeros(0)
    state = np.column_stack([tail[1:], tail[:-1]])
    share = [np.abs(np.linalg.pinv(vectors)[k] @ state.T).mean() * np.linalg.norm(vectors[:n, k]) for k in swing]
    order = swing[np.argsort(share)[::-1]]
    return rate[order].imag / (2 * np.pi), -rate[order].real


def _within(centre: np.ndarray, moved: np.ndarray) -> np.ndarray | None:
    """A centre (n,) about which known coordinates `moved` (F, n) lie; None where they do not."""
    return centre if ((moved.min(0) <= centre) & (centre <= moved.max(0))).all() else None


def _leading(matrix: np.ndarray, tail: np.ndarray) -> np.ndarray:
    """Log frequency and decay per frame of a recursion's leading oscillation, (2,); infinite where nothing swings."""
    frequencies, decays = _oscillation(matrix, tail, 1.0)
    return np.array([np.log(frequencies[0]), decays[0]]) if len(frequencies) else np.full(2, np.inf)


def _tells(leading: np.ndarray, sd: np.ndarray, frames: int) -> bool:
    """Whether an oscillation (see _leading) with standard deviations `sd` is known well enough, and does not grow: what grows is pushed."""
    growth, growth_sd = -leading[1] * frames, sd[1] * frames
    return bool(2 / np.log(10) * sd[0] < VAGUEST and growth < max(LARGEST_GROWTH, SURELY * growth_sd))


def _is_free(tail: np.ndarray, frequencies: np.ndarray, sigma: float, period_s: float) -> bool:
    if len(tail) < LEAST_TAIL_FRAMES or not len(frequencies):
        return False
    long_enough = len(tail) * period_s * frequencies[0] >= LEAST_TAIL_PERIODS
    second = np.sqrt((np.diff(tail, 2, axis=0) ** 2).mean())  # what the recursion has to explain
    return bool(long_enough and sigma < max(WORST_TAIL * second, 1e-9) * 2)
