"""A border of two materials that look alike, where stiffness shows it: two moduli explain the free motion that one does not.

The body is cut into zones along its limbs; each of the cuts between them is tried as the border, with a modulus on either side. The modes of
the cut body follow from one basis, so that a cut costs a fit of the free frames and no finite elements. What speaks for a border is the evidence
(MacKay 1992): how much better it explains the motion, over noise and over the errors of the model, less what its freedom buys. Where the border
lies, and how surely, follows from the misfits of neighbouring cuts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..config import Settings
from ..linear_systems import inverted
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from ..vibration.coordinates import observe
from .densities import DENSITY_CONTRAST, Densities
from .evidence import Evidence
from .free_tail import DETUNED, RATIO_SD, Physics, Tail
from .second_reading import support_of
from .tail_errors import TailErrors
from .uncertainty import OPEN_SD, contradiction
from .untold import TOLD, Untold
from .values import start_values, widened
from .zone_layout import Division, path_length

LEAST_EVIDENCE = 12.0  # for a border, a logarithm: up to 9.8 on 131 bodies without one, all but four below 3.3; 12.3 and more on 25 of 34 with one [docs/limits.md]
DOUBTFUL_EVIDENCE = 3.5  # of the same, from which on one is not ruled out either: up to 3.2 on 127 of those 131 [docs/limits.md]
MOST_LEFT = 2.5  # of a frame's misfit over what it may be, with such a border: what the modes miss by more for other reasons raises no doubt [docs/limits.md]
ZONE_SD = 0.05  # of ln E of each zone, by outline and thickness: what looks like a border of a few per cent is none [docs/limits.md]
MODES, VARIED = 8, 3  # of the basis; whose change with every zone's modulus it spans [numerical]
RATIOS = (0.3, 1.0, 3.0)  # of E beyond the border over that before it, at which searches begin [numerical]
MOST_LOG_SD = OPEN_SD * np.log(10.0)  # of ln E where a fit runs off [derived]
LEAST_PLACE_SD = 0.25  # of the border's place, in steps between cuts [numerical]


@dataclass(frozen=True)
class Parted:
    """A body with parts that stiffness tells apart, and what was found of it."""

    body: Body
    start: StartValues
    modal: ModalModel

    def doubted(self, sd: np.ndarray, places: str, *, hidden: bool) -> Parted:
        """With what is left open of log10 E, (n,), by the `places` of borders that were found, in words, and by one that may hide."""
        may = "stiffness may change where nothing can be seen: one more border would explain the free motion better than errors of the model do; segment.max_parts 1 says that it is of one material"
        found = (
            "stiffness changes where nothing can be seen, and the free motion does not tell well where",
            "a border of this part was found by stiffness",
            f"by stiffness, for they look alike: one modulus does not explain the free motion; border {places}",
        )
        said = [found] * bool(places) + [(may, may, may)] * hidden  # why a part is not known, what is said of one that is, where the parts come from
        why, known, source = ("; ".join(each) for each in zip(*said, strict=True))
        start = widened(self.start, sd, why)
        lost = self.start.identified & ~start.identified
        reasons = tuple(r if gone else f"{r.removesuffix('.')}; {known}." for gone, r in zip(lost, start.reasons, strict=True))
        return replace(self, body=replace(self.body, sources=self.body.sources | {"parts": source}), start=replace(start, reasons=reasons))


@dataclass(frozen=True)
class Cut:
    """A way to divide one of n parts of a body of K zones."""

    label: np.ndarray  # 0..n, the part of each zone then, from the clamp outwards, (K,)
    divided: int  # 0..n-1: which part; what lies beyond the cut is the next one, and the others count on
    before: int  # the zone at the cut, on the clamp's side
    place: float  # of the border: way from the clamp over the longest

    def beyond(self, other: Cut) -> bool:
        """Whether less of the same part lies beyond this cut than beyond another, and nothing else."""
        outer, others = self.label == self.divided + 1, other.label == other.divided + 1
        return self.divided == other.divided and not (outer & ~others).any() and bool((others & ~outer).any())


@dataclass(frozen=True)
class Tried:
    """The free frames' fit of a body."""

    cut: Cut
    chi2: float  # misfit and priors
    physics: Physics
    curvature: np.ndarray  # of half of chi2 by Physics.vector(), (S, S)

    @classmethod
    def best(cls, tail: Tail, cut: Cut, starts: Iterable[Physics]) -> Tried:
        """Of the searches from some starts."""
        cost, physics = min((tail.search(start) for start in starts), key=lambda pair: pair[0])
        return cls(cut, 2 * cost, physics, tail.curvature(physics))

    @property
    def contradicted(self) -> float:
        """By how much its frequencies contradict each other; at least 1."""
        return contradiction(inverted(self.curvature), self.physics.detune)

    @property
    def log_curvature(self) -> float:
        """Logarithm of its determinant."""
        return float(np.linalg.slogdet(self.curvature)[1])

    @property
    def variance(self) -> np.ndarray:
        """Of ln E of each part, (n,)."""
        return np.asarray(np.diag(inverted(self.curvature))[: len(self.physics.young)])


@dataclass(frozen=True)
class Border:
    """The best cut, moved to where its neighbours' misfits say."""

    cut: Cut
    place: float  # way from the clamp over the longest
    place_sd: float
    log_young_sd: np.ndarray  # of ln E per part by the place alone, (n + 1,)


@dataclass(frozen=True)
class Zones:
    """A body cut into K zones, with the free frames' fit of any grouping of them."""

    evidence: Evidence
    start: StartValues
    division: Division
    volume: np.ndarray  # of each zone [m^3], (K,)
    modal: ModalModel  # with stiffness and inertia per zone
    weighed: bool  # whether densities that nobody told are fitted as well

    @classmethod
    def of(cls, evidence: Evidence, start: StartValues, *, weighed: bool) -> Zones:
        """Of a body whose parts have the start values' moduli."""
        from ..elements.assemble import Elements, modal_model

        division = Division.of(evidence.body)
        zoned = division.divide(evidence.body)
        modal = modal_model(Elements.of(zoned, apart=True), [start.young[division.part - 1]], [MODES], varied=VARIED)
        return cls(evidence, start, division, zoned.part_volumes_m3, modal, weighed)

    def tail(self, label: np.ndarray) -> Tail:
        """The free frames of a body whose zones are of the parts 0.. that `label` (K,) says."""
        count = int(label.max()) + 1

        def summed(values: np.ndarray) -> np.ndarray:
            return np.stack([values[label == part].sum(0) for part in range(count)])

        modal, volume = self.modal, summed(self.volume)
        density = summed(self.modal.density * self.volume) / volume
        of_zones = modal.stiffness, modal.by_poisson, modal.inertia, modal.prestress, modal.weight
        stiffness, by_poisson, inertia, prestress, weight = (summed(each) for each in of_zones)
        poisson = summed(modal.poisson * self.volume) / volume
        young = np.exp(summed(np.log(modal.reference) * self.volume) / volume)
        modal = replace(modal, stiffness=stiffness, by_poisson=by_poisson, poisson=poisson, inertia=inertia, prestress=prestress, weight=weight, density=density, reference=young)
        open_ = self.weighed and count > 1 and self.evidence.settings.scene.density_kg_m3 is None
        untold = Untold(Densities(density, volume, DENSITY_CONTRAST)) if open_ else TOLD
        return replace(self.evidence, untold=untold).tail(modal, support_of(self.start))

    def fitted(self) -> Tried:
        """Without a cut."""
        whole = Cut(self.division.part.astype(int) - 1, 0, 0, 0.0)
        tail = self.tail(whole.label)
        density = None if tail.untold.densities is None else self.start.density
        return Tried.best(tail, whole, [Physics(self.start.young, self.start.damping, np.zeros(DETUNED), density)])

    def tried(self, cut: Cut, uncut: Physics) -> Tried:
        """With one, begun at what was found without."""
        tail, own = self.tail(cut.label), np.insert(np.arange(len(uncut.young)), cut.divided + 1, cut.divided)
        density = None if tail.untold.densities is None or uncut.density is None else uncut.density[own]
        beyond = np.arange(len(own)) == cut.divided + 1
        return Tried.best(tail, cut, (replace(uncut, young=np.where(beyond, ratio, 1.0) * uncut.young[own], density=density) for ratio in RATIOS))

    def scan(self) -> Scan:
        """The fits with every cut, and without."""
        uncut = self.fitted()
        tried = [self.tried(cut, uncut.physics) for cut in cuts_of(self.division)]
        if not tried:
            return Scan(self.volume, uncut, tried)
        likely = min(tried, key=lambda each: each.chi2)
        weighed = self._weighed([uncut, *tried], self.errors(likely))
        best, tail = min(weighed[1:], key=lambda each: each.chi2), self.tail(likely.cut.label)
        return Scan(self.volume, weighed[0], weighed[1:], max(best.chi2 / tail.data.size, best.contradicted**2), tail.missed_m(likely.physics) / tail.sigma_m)

    def _weighed(self, fits: Iterable[Tried], errors: TailErrors) -> list[Tried]:
        """The same fits where misfits are weighed by what they may be."""
        return [Tried.best(replace(self.tail(each.cut.label), weighed=errors.whitened), each.cut, [each.physics]) for each in fits]

    def errors(self, likely: Tried) -> TailErrors:
        """What a fit may miss if a likely one is right, moduli of single zones among it."""
        label, physics = likely.cut.label, likely.physics
        by_zone = replace(physics, young=physics.young[label], density=None if physics.density is None else physics.density[label])
        zones = self.tail(np.arange(len(label))).slope(by_zone)[:, : len(label)] * ZONE_SD
        return TailErrors.if_right(self.tail(label), physics, zones)

    def divide(self, border: Border) -> Body:
        """The body with the border between two of its parts."""
        body, cut = self.evidence.body, border.cut
        away = path_length(body.inside)
        away = away / max(float(away[body.inside].max()), 1.0)
        zone = self.division.zone.astype(int) - 1
        near = (cut.label[zone] == cut.divided + 1) | (zone == cut.before)
        part = body.part.astype(int) + (body.part.astype(int) > cut.divided + 1)
        part = np.where(near, np.where(away > border.place, cut.divided + 2, cut.divided + 1), part)
        own = np.insert(np.arange(body.parts), cut.divided + 1, cut.divided)
        return body.with_parts(part[np.nonzero(body.inside)], body.density[own], body.poisson[own])


def cuts_of(division: Division) -> Iterator[Cut]:
    """Between two neighbouring zones of a part, where that leaves the part in two pieces."""
    for k, pair in enumerate(division.neighbours):
        a, b = sorted((int(z) for z in pair), key=lambda z: division.away[z])
        if division.part[a] != division.part[b]:
            continue
        inside = division.part == division.part[a]
        rest = np.array([p for i, p in enumerate(division.neighbours) if i != k and inside[p].all()], int).reshape(-1, 2)
        graph = coo_matrix((np.ones(len(rest)), tuple(rest.T)), shape=(division.count,) * 2)
        piece = connected_components(graph, directed=False)[1]
        if piece[a] == piece[b]:
            continue
        divided = int(division.part[a]) - 1
        outer = inside & (piece == piece[b])
        label = division.part.astype(int) - 1
        label = label + ((label > divided) | outer)
        yield Cut(label, divided, a, 0.5 * float(division.away[a] + division.away[b]))


@dataclass(frozen=True)
class Scan:
    """What every cut makes of the free frames."""

    volume: np.ndarray  # of each zone [m^3], (K,)
    uncut: Tried
    tried: list[Tried]
    scale: float = 1.0  # of all misfits: what the best cut misses, or its frequencies, over what they may
    left: float = 1.0  # of a frame's misfit over what it may be, with a cut, at the least

    @property
    def best(self) -> Tried:
        """The cut with the least misfit; none where there is no cut."""
        return min(self.tried, key=lambda each: each.chi2, default=self.uncut)

    @property
    def evidence(self) -> float:
        """For one more border, anywhere, against none: logarithm of the ratio of their probabilities where both were as likely before."""
        return float(np.logaddexp.reduce(self._evidences()))

    def _evidences(self) -> np.ndarray:
        """Of every cut, all as likely before (Laplace's approximation; priors scaled like the misfits), (C,)."""
        gain = np.array([self.uncut.chi2 - each.chi2 for each in self.tried]) / self.scale
        spent = np.array([each.log_curvature - self.uncut.log_curvature for each in self.tried]) + 2 * np.log(RATIO_SD)
        return 0.5 * (gain - spent) - np.log(max(len(self.tried), 1))

    @property
    def doubtful(self) -> bool:
        """Whether one more border is not ruled out."""
        return self.evidence >= DOUBTFUL_EVIDENCE and self.left < MOST_LEFT

    def border(self) -> Border:
        """The best cut, moved to the least of the parabola through its own misfit and those of its neighbours inwards and outwards."""
        best = self.best
        inwards = [each for each in self.tried if best.cut.beyond(each.cut)]
        outwards = [each for each in self.tried if each.cut.beyond(best.cut)]
        sides = [max(inwards, key=lambda each: each.cut.place)] if inwards else []
        sides += [min(outwards, key=lambda each: each.chi2)] if outwards else []
        away = np.array([each.cut.place - best.cut.place for each in sides])
        step, shift, sd, side = float(np.abs(away).min(initial=0.5)), 0.0, np.inf, 0
        if len(sides) == 2:
            rise = np.array([each.chi2 - best.chi2 for each in sides]) / self.scale
            bend = float(np.diff(rise / away)[0] / np.ptp(away))
            if bend > 0:
                shift = float(np.clip(-(rise[0] / away[0] - bend * away[0]) / (2 * bend), -0.5 * step, 0.5 * step))
                sd, side = bend**-0.5, int(shift > 0)
        sd = float(np.clip(sd, LEAST_PLACE_SD * step, step))
        change = np.log(sides[side].physics.young / best.physics.young) / away[side] if sides else np.zeros(len(best.physics.young))
        return Border(best.cut, best.cut.place + shift, sd, np.abs(change) * sd)

    def _in_parts(self, square: np.ndarray) -> np.ndarray:
        """Means over each part, (n,), of what zones have, (K,)."""
        parts = self.uncut.cut.label
        return np.bincount(parts, self.volume * square) / np.bincount(parts, self.volume)

    def further_variance(self) -> np.ndarray:
        """Variance of ln E of a place in each part (n,), by one more border, anywhere, that is as likely as none before the misfits are looked at."""
        parts, found = self.uncut.cut.label, np.log(self.uncut.physics.young)
        weight = np.exp(self._evidences() - np.logaddexp(0.0, self.evidence))
        squares = [(np.log(each.physics.young)[each.cut.label] - found[parts]) ** 2 + self.scale * each.variance[each.cut.label] for each in self.tried]
        square = weight @ np.minimum(squares, MOST_LOG_SD**2).reshape(-1, len(parts))
        return self._in_parts(square)


def parted_by_stiffness(
    body: Body, tracks: Tracks, period_s: float, settings: Settings, start: StartValues, modal: ModalModel, *, camera: Camera | None = None, draws: bool = True
) -> Parted | None:
    """The body with the borders that its free motion asks for, one after the other, or as it is and less sure where one more may hide; None where neither is so.

    Args: as for start_values, whose results start and modal are. `draws`: whether the free part of the motion is seen well enough to draw a border for it; where
        a joint fit found it, the force that is left in it asks for one as well.
    """
    variance, found, hidden = np.zeros(body.parts), Parted(body, start, modal), False
    words: list[str] = []
    while found.start.has_free_tail:
        evidence = Evidence(found.body, tracks, observe(found.body, tracks, camera), period_s, settings)
        zones = Zones.of(evidence, found.start, weighed=bool(words))
        scan = zones.scan()
        if scan.evidence < LEAST_EVIDENCE or not draws or found.body.parts == settings.segment.max_parts:
            hidden = scan.doubtful
            variance = variance + (scan.further_variance() if words or hidden else 0.0)
            break
        if not words and settings.scene.density_kg_m3 is None:
            zones = replace(zones, weighed=True)
            scan = zones.scan()
        border = scan.border()
        divided = zones.divide(border)
        variance = np.insert(variance, border.cut.divided + 1, variance[border.cut.divided]) + border.log_young_sd**2
        words.append(f"at {100 * border.place:.0f} +- {100 * border.place_sd:.0f} % of the way from the clamp")
        found = Parted(divided, *start_values(divided, tracks, period_s, settings, camera=camera))
    return found.doubted(np.sqrt(variance) / np.log(10.0), " and ".join(words), hidden=hidden) if words or hidden else None
