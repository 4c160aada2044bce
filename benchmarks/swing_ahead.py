"""A filmed swing fitted on its first half and let go on: how far the free end is off over the next five periods; and its first second, by a law that
was read from the frames after it.

usage: python benchmarks/swing_ahead.py FILM.mp4 [--setting value ...]     (the flags of diffphys recover)

Rest, clamp and scale are the outline's own, from the calm frames. Ahead: modulus, drag, and how both depend on the size of the swing, are fitted on frames 0
to the half alone, in windows that grow from one period, from the pose and velocity of the first frames, seven at the most. With which power of the strain the modulus
falls nobody knows: each of POWERS is fitted, and what is said is their mean, each by the probability that the half gives it. From later frames: modulus and drag are
those of the calm frames, softening and drag of squared speed are read from the second second, let go from its own first frames.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.config import Settings
from diffphys_ros.elements.plane import FlatSolid
from diffphys_ros.inverse.outlined import Outlined, outlined
from diffphys_ros.inverse.swing import SECONDS, Follower, calm_swing, first_frames
from diffphys_ros.inverse.yielding import Yielding, fitted
from diffphys_ros.progress import finished
from diffphys_ros.start import start_values
from diffphys_ros.start.place import probabilities

PERIODS, ROUNDS, LAST_ROUNDS = 5, 3, 8
SETTLED = 0.01  # gain of the cost, over it: less ends the search
BARELY = 1e-12  # beyond a bound: what is sought must not be shut in
POWERS = (1.0, 1.5, 2.0)  # of the strain
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a step, until one gains
STEPS = np.array([0.002, 0.1, 0.1, 0.05])  # of log frequency, drag [1/s], softening, drag of squared speed [1/m]
USUAL, SPREAD = np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.1, 10.0, 1.0, 1.0])
LEAST, MOST = np.array([-0.5, 0.0, 0.0, 0.0]), np.array([0.5, 20.0, 3.0, 3.0])
EXPECTED = 0.03  # error over motion that no such law explains


class Film:
    """A film whose outline is followed over its first half and five periods more."""

    def __init__(self, path: str, settings: Settings):
        seen: Outlined | None = finished(outlined(read_clip(path, settings), settings))
        if seen is None:
            raise SystemExit(f"{path}: its outline is not what is followed")
        start, _ = start_values(seen.body, seen.tracks, seen.clip.period_s, seen.settings, camera=seen.clip.camera)
        self.hz, self.period_s = float(start.observed_hz[0]), seen.whole.period_s
        specific = float(start.young[0] / seen.body.density[0])
        self.follower = Follower.of(FlatSolid.of(seen.body), seen.whole, seen, specific, seen.body).tuned(self.hz)
        self.calm = calm_swing(self.follower, seen, start, self.hz)
        first = first_frames(self.hz, self.period_s)
        self.half = len(seen.whole) // 2 - first // 2
        self.end = min(len(seen.whole) - first // 2, self.half + round(PERIODS / (self.hz * self.period_s)))
        poses = self.follower.poses(self.end + first // 2)
        if poses is None:
            raise SystemExit(f"{path}: the outline is lost")
        self.second = round(SECONDS / self.period_s)
        self.u, self.v = self._state(poses[:first])
        self.later = self._state(poses[self.second :][:first])
        self.told = self.follower.tip(poses[first // 2 :])

    def _state(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pose and velocity in the middle of some frames."""
        times = (np.arange(len(poses)) - len(poses) // 2) * self.period_s
        _, v, u = np.polyfit(times, poses, 2)
        return u, v

    def bent_by(self, power: float) -> Fitting:
        """Its first half, under a modulus that falls with that power of the strain."""
        return Fitting(self, replace(self.follower, plane=replace(self.follower.plane, power=power)))

    def first_second(self) -> dict[str, tuple[Yielding, float]]:
        """The error in the first second under the calm frames' law, under its own, and under the one that the second after it tells."""
        first, later = (self.told[k : k + self.second] for k in (0, self.second))
        laws = {"constant": Yielding(), "two numbers": self._read(first, (self.u, self.v))}
        if len(later) > self.second // 2:
            laws["from later frames"] = self._read(later, self.later)
        return {name: (law, error(self._let_go(law, (self.u, self.v), len(first)), first)) for name, law in laws.items()}

    def _read(self, told: np.ndarray, begin: tuple[np.ndarray, np.ndarray]) -> Yielding:
        found = fitted(lambda law: self._let_go(law, begin, len(told)), told)
        if found is None:
            raise SystemExit("the motion cannot be simulated")
        return found.law

    def _let_go(self, law: Yielding, begin: tuple[np.ndarray, np.ndarray], frames: int) -> np.ndarray | None:
        under = self.follower.obeying(law, self.calm)
        free = under.let_go(*begin, drag_per_s=self.calm.drag(law), drag_per_m=law.drag_per_m, hz=self.hz, frames=frames)
        return None if free is None else under.tip(free)


@dataclass(frozen=True)
class Fitting:
    """A film's first half and a way in which the modulus falls."""

    film: Film
    follower: Follower

    def tip(self, law: np.ndarray, frames: int) -> np.ndarray | None:
        """The free end (frames, 2) [px] under a law; None where the motion cannot be simulated."""
        film = self.film
        under = replace(self.follower, plane=replace(self.follower.plane, softens=law[2])).tuned(film.hz * np.exp(law[0]))
        free = under.let_go(film.u, film.v, drag_per_s=law[1], drag_per_m=law[3], hz=film.hz, frames=frames)
        return None if free is None else under.tip(free)

    def missed(self, law: np.ndarray, frames: int) -> np.ndarray | None:
        """What a law misses of the first frames, and of what is usual, each over what is expected."""
        tip, told = self.tip(law, frames), self.film.told[:frames]
        if tip is None:
            return None
        return np.concatenate([(tip - told).ravel() / (EXPECTED * np.linalg.norm(told - told.mean(0))), (law - USUAL) / SPREAD])

    def better(self, law: np.ndarray, missed: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
        """One step of Gauss and Newton on the first frames, shorter where it gains nothing: the law and what it misses. It stays within the bounds: where
        one number ends at its bound the others are fitted with it there."""
        nearby = [self.missed(law + step, frames) for step in np.diag(STEPS)]
        if any(each is None for each in nearby):
            return law, missed
        slope = np.stack([(each - missed) / step for each, step in zip(nearby, STEPS, strict=True) if each is not None], 1)
        step = lsq_linear(slope, -missed, (LEAST - law - BARELY, MOST - law + BARELY)).x
        for share in SHARES:
            trial = np.clip(law + share * step, LEAST, MOST)
            found = self.missed(trial, frames)
            if found is not None and _cost(found) < _cost(missed):
                return trial, found
        return law, missed

    def law(self) -> tuple[np.ndarray, float]:
        """The one that suits the first half best, and twice the logarithm of how unlikely it makes that."""
        film, found, missed = self.film, USUAL, None
        period = round(1 / (film.hz * film.period_s))
        for frames in sorted({min(n, film.half) for n in (period, 2 * period, film.half // 2, film.half)}):
            missed = self.missed(found, frames)
            if missed is None:
                return found, np.inf
            for _ in range(LAST_ROUNDS if frames == film.half else ROUNDS):
                before = _cost(missed)
                found, missed = self.better(found, missed, frames)
                if _cost(missed) > (1 - SETTLED) * before:
                    break
        return found, np.inf if missed is None else _cost(missed)


@dataclass(frozen=True)
class Ahead:
    """What the first half lets expect."""

    tip: np.ndarray  # the free end [px], (T, 2)
    law: np.ndarray  # mean over the powers
    power: float


def ahead(film: Film) -> Ahead:
    """The mean over all powers, each by its probability. Ends the program where no motion can be simulated."""
    fits = [film.bent_by(power) for power in POWERS]
    laws, costs = zip(*(fit.law() for fit in fits), strict=True)
    tips = [fit.tip(law, film.end) if np.isfinite(cost) else None for fit, law, cost in zip(fits, laws, costs, strict=True)]
    counts = np.array([np.inf if tip is None else cost for tip, cost in zip(tips, costs, strict=True)])
    if not np.isfinite(counts).any():
        raise SystemExit("the motion cannot be simulated")
    weight = probabilities(counts, np.full(len(POWERS), 1 / len(POWERS)), 1.0)
    return Ahead(sum((w * tip for w, tip in zip(weight, tips, strict=True) if tip is not None), np.zeros_like(film.told[: film.end])), weight @ np.array(laws), float(weight @ np.array(POWERS)))


def _cost(missed: np.ndarray) -> float:
    return float((missed**2).sum())


def error(tip: np.ndarray | None, told: np.ndarray) -> float:
    """Over the motion, root mean square; infinite where it cannot be simulated."""
    if tip is None:
        return np.inf
    return float(np.linalg.norm(tip - told) / np.linalg.norm(told - told.mean(0)))


def main(path: str, *flags: str) -> None:
    """Two lines for a film."""
    film = Film(path, config.layered([], config.flags_of(flags)))
    errors = (f"{100 * missed:.1f} % {name} (softens {own.softens:.2f}, drag {own.drag_per_m:.2f} /m)" for name, (own, missed) in film.first_second().items())
    print(f"{path}: the first second missed by {', '.join(errors)}", flush=True)
    found = ahead(film)
    tip, law, half = found.tip, found.law, film.half
    periods = (film.end - half) * film.period_s * film.hz
    print(
        f"{path}: {half} frames fitted to {100 * error(tip[:half], film.told[:half]):.1f} %, the next {periods:.1f} periods missed by {100 * error(tip[half:], film.told[half:]):.1f} %; "
        f"{film.hz * np.exp(law[0]):.3f} Hz, drag {law[1]:.2f} /s and {law[3]:.2f} /m, softens {law[2]:.2f} with power {found.power:.2f}"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
