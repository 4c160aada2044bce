"""Start values: from tracks and the filled body to Young's moduli, damping and force, without any simulation."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..config import Settings
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from ..vibration.coordinates import observe
from ..vibration.forced_frames import Support, find_support, least_tail_frames
from ..vibration.thinning import find_slow_support
from .clamp_doubt import clamp_doubt
from .densities import DENSITY_CONTRAST, Densities
from .evidence import Belief, Evidence
from .force import Solution
from .free_tail import FREQUENCY_SD
from .lower_bound import lower_bounds
from .material_doubt import material_doubt
from .stages import Fit, guess, guessed, joint, modes, run
from .uncertainty import OPEN_SD, Bend, detuning_log10_sd, log10_young_sd, of_held_modes, of_shapes, outline_sd
from .untold import TOLD, Ratios, Untold

ALARM_NOISE, ALARM_SHARE = 5.0, 0.12  # misfit over the coherent noise and over the motion that together ask for an alarm [chosen]
MOST_DETUNING = 0.07  # of a mode's log frequency: no error of the outline makes so much, the body is not the one that was told, and E means nothing [chosen]
STRANGE = 3.0  # of its standard deviations by which a frequency is off: then that is why E is not known [derived]
WIDEST_SD = 0.3  # of log10 E that still counts as identified: a factor of two [chosen]
WIDEST_DOUBT_SD = 0.2  # of what the body's shape leaves open of log10 E: a border is there or is not, and nothing lies between [chosen]
GUESS_SD = 0.5  # of log10 E of a guess [chosen]
STARTS = (0.3, 1.0, 3.0)  # factors on the guess, of the joint fit [numerical]
AGREEMENT = 0.05  # of log10 E between starts that still counts as one answer [chosen]
RIVALS, RIVAL_SHARE = "another stiffness explains the free motion nearly as well", 0.7  # of a standard deviation: half of its square [derived]
FINER = 0.6  # sides of elements for an outline, over the usual: its one frequency is known to .1 %, and the usual ones have it .4 % high [chosen]
NEARLY = 1.5  # times the lowest cost: starts that end above it have not arrived [chosen]
LONE_SD, LEAST_SD = float(np.log10(3.0)), 0.1  # of log10 E where one start alone arrives: what starts lie apart; and at the least [derived]


def start_values(
    body: Body,
    tracks: Tracks,
    period_s: float,
    settings: Settings,
    *,
    camera: Camera | None = None,
    belief: Belief | None = None,
    guess_scale: float = 1.0,
) -> tuple[StartValues, ModalModel]:
    """Young's modulus per part and damping from the free tail, force from all frames, and the modes they came from.

    Args:
        body: filled solid.
        tracks: surface points.
        period_s: time between frames [s].
        settings: `scene.at_rest` and `experiment.mode_count`.
        camera: for the lines of sight, where the tracks have no depth.
        belief: Young's moduli to take where there is no free tail; without it a guess from the clip's strongest frequency.
        guess_scale: factor on the first guess of Young's modulus, which the search must forget.
    """
    evidence = Evidence(body, tracks, observe(body, tracks, camera), period_s, settings, belief)
    return values_under(evidence, supported(evidence), guess_scale)


def values_under(evidence: Evidence, support: Support, guess_scale: float = 1.0) -> tuple[StartValues, ModalModel]:
    """The same where it is known which frames may carry a force, and whether a free tail follows them."""
    from ..elements.assemble import Elements
    from ..elements.mesh import element_size, solid_mesh

    body, tracks, settings = evidence.body, evidence.tracks, evidence.settings
    untold = Untold(Densities.open(body, settings.scene), Ratios.open(body, settings.scene) if evidence.of_points else None)
    mesh = solid_mesh(body, (FINER if tracks.normals is not None else 1.0) * element_size(body))
    elements = Elements.of(body, mesh, apart=untold.densities is not None)
    stages = modes(elements, guess_scale) if support.has_free_tail else guess(elements, guess_scale)
    fit = _tuned(run(stages, Fit.begun(replace(evidence, untold=untold if support.has_free_tail else TOLD), elements, support)))
    if fit.evidence.untold.size and _explained_badly(fit):  # then they tell what is no free motion
        fit = _tuned(run(stages, Fit.begun(evidence, elements, support)))
    held_sd = clamp_doubt(fit, mesh)
    return bounded(values_of(fit, clamp_sd=held_sd), fit, clamp_sd=held_sd), fit.modal


def _tuned(fit: Fit) -> Fit:
    """The same with what was found in body and modal model; without the frequencies of modes that do not explain the free motion, which are none."""
    tuned = fit.tuned
    if fit.support.has_free_tail and _explained_badly(tuned):
        return replace(fit, physics=fit.physics.tuned).tuned
    return tuned


def joint_wanted(start: StartValues, settings: Settings) -> bool:
    """Whether force and stiffness are to be found together: where that is asked for, or no free tail tells the stiffness."""
    schedule = settings.experiment.schedule
    return schedule == "joint" or (schedule == "auto" and not start.has_free_tail)


def joint_values(
    body: Body, tracks: Tracks, period_s: float, settings: Settings, start: StartValues, modal: ModalModel, *, camera: Camera, believed: bool = False
) -> StartValues:
    """`start` with moduli, damping, forced frames and force found jointly; its moduli are the guess, held to within their
    standard deviations where they are `believed`. Other arguments as for start_values, whose results start and modal are."""
    belief = start if believed and not start.has_free_tail else None
    evidence = Evidence(body, tracks, observe(body, tracks, camera), period_s, settings, belief)
    begun = Fit(evidence, modal, everywhere(supported(evidence)), guessed(start.young))
    found = [run(joint(), replace(begun, physics=guessed(start.young * factor))) for factor in STARTS]
    costs = [fit.whole.solve(fit.physics, fit.load).cost for fit in found]
    best, cost = found[int(np.argmin(costs))], min(costs)
    logs = np.array([np.log10(fit.physics.young) for fit, c in zip(found, costs, strict=True) if c <= NEARLY * cost])
    spread = np.ptp(logs, axis=0) if len(logs) > 1 else np.full(logs.shape[1], LONE_SD)
    free, frequencies = int((~best.whole.allowed).sum()), modal.frequencies(best.physics.young)
    needed = least_tail_frames(max(frequencies[0], one_swing_hz(evidence)), period_s)  # a shorter swing passes for a push
    open_sd = best.whole.left_open(best.physics, best.load, believed=evidence.believed) / np.log(10.0)
    motion = of_motion(best)
    missed, moved = _missed_m(evidence, motion["track_cost"])
    badly = explained_badly(missed, evidence.motion.coherent_m, moved)
    told = (spread < AGREEMENT) & (open_sd < WIDEST_SD) & (free >= needed) & evidence.moves & (not badly)
    reason = (
        f"no free tail; joint fit of stiffness and force with {free} force-free frames (needs {needed}), "
        f"starts agree within {{:.2f}} in log10 E (needs {AGREEMENT:g}), which the motion under a free force tells to +-{{:.2f}} (needs {WIDEST_SD:g})"
        + (f", and the motion differs from the fitted by {1e3 * missed:.2f} mm of {1e3 * moved:.2f} mm; check mask, thickness and parts." if badly else ".")
    )
    sd = np.minimum(np.hypot(np.maximum(np.maximum(spread, open_sd), LEAST_SD), start.geometry_sd), OPEN_SD)
    return replace(
        start,
        **motion,
        log10_young_sd=sd if belief is None else np.minimum(sd, belief.log10_young_sd),
        identified=told,
        reasons=tuple(reason.format(s, o) for s, o in zip(spread, open_sd, strict=True)),
    )


def one_swing_hz(evidence: Evidence) -> float:
    """The frequency of one swing in the whole clip: a slower one cannot be told."""
    return 1 / (len(evidence.motion.known) * evidence.period_s)


def _missed_m(evidence: Evidence, track_cost: float) -> tuple[float, float]:
    """What a motion misses of the tracks beyond their own noise, and how far they move, root mean square [m]."""
    seen = evidence.motion
    square = float((seen.displacement**2).sum(2)[seen.valid].mean()) if seen.valid.any() else 0.0
    return math.sqrt(max(track_cost * square - 3 * evidence.tracks.noise_m**2, 0.0)), math.sqrt(square)


def supported(evidence: Evidence) -> Support:
    """Frames that may carry a force: all of them where no free tail is seen."""
    motion = evidence.motion
    find = find_support if evidence.tracks.normals is None else find_slow_support
    support = find(motion.coordinates, motion.known, evidence.period_s, at_rest=evidence.at_rest, noise_m=motion.noise_m)
    return support if support.has_free_tail and evidence.moves else everywhere(support)


def everywhere(support: Support) -> Support:
    """With a force in every frame."""
    return replace(support, forced=np.ones_like(support.forced), has_free_tail=False)


def values_of(fit: Fit, *, clamp_sd: np.ndarray | float = 0.0, density_contrast: float = DENSITY_CONTRAST) -> StartValues:
    """Force, spread and words for what a fit ended with; its modal model is tuned to the physics. `clamp_sd` (n,) is the standard deviation of log10 E
    by the clamp's place, `density_contrast` that of ln(density) of a part where none was given."""
    evidence, tail, free = fit.evidence, fit.tail, fit.support.has_free_tail
    detune = fit.physics.detune
    detuning = float(np.abs(detune).max(initial=0.0))
    fit = replace(fit, physics=fit.physics.tuned)
    residual = tail.missed_m(fit.physics)
    bend = Bend.of(tail, fit.physics) if free else None
    doubt = material_doubt(tail, fit.physics, bend, evidence.body, evidence.settings.scene, density_contrast, detune, twists=evidence.of_points)
    geometry_sd = np.hypot(_drawn_sd(evidence, clamp_sd), doubt.of_young)
    sd = _sd_of_tail(fit, bend, geometry_sd, detune) if bend is not None else sd_of_guess(evidence)
    holds = not (free and _explained_badly(fit))
    reasons = _with_clamp(_reasons(fit, sd, residual, detuning, holds=holds), clamp_sd)
    return StartValues(
        **of_motion(fit),
        log10_young_sd=sd,
        observed_hz=fit.support.frequencies_hz,
        decay_per_s=fit.support.decay_per_s,
        identified=np.array([not r[0] for r in reasons]),
        reasons=tuple(r[1] for r in reasons),
        has_free_tail=free,
        modes_hold=holds,
        geometry_sd=geometry_sd,
        young_lower=np.full(len(sd), np.nan),
        material=doubt,
        density=np.asarray(evidence.body.density, float),
        poisson=np.asarray(evidence.body.poisson, float),
        detuning=detuning,
    )


def _drawn_sd(evidence: Evidence, clamp_sd: np.ndarray | float) -> np.ndarray:
    """Standard deviation of log10 E per part by outline and clamp, (n,)."""
    return np.hypot(outline_sd(evidence.body, evidence.tracks) / np.log(10.0), clamp_sd)


def widened(values: StartValues, extra: np.ndarray | float, why: str) -> StartValues:
    """With one more standard deviation of log10 E, one for all parts or one each (n,), of what the body's shape leaves open; a part that is known too badly with it is not identified,
    because of `why`, a clause."""
    sd = np.hypot(values.log10_young_sd, extra)
    lost = values.identified & ((sd > WIDEST_SD) | (extra > WIDEST_DOUBT_SD))
    reasons = tuple(f"log10 E is known to +-{s:.2f} only: {why}." if gone else reason for s, gone, reason in zip(sd, lost, values.reasons, strict=True))
    return replace(values, log10_young_sd=sd, geometry_sd=np.hypot(values.geometry_sd, extra), identified=values.identified & ~lost, reasons=reasons)


def bounded(values: StartValues, fit: Fit, *, clamp_sd: np.ndarray | float = 0.0) -> StartValues:
    """With the least moduli of parts whose own are not known though the modes explain the free motion."""
    explained = values.has_free_tail and values.modes_hold and values.detuning <= MOST_DETUNING
    wanted = ~values.identified & explained
    if not wanted.any():
        return values
    lower = lower_bounds(fit.tail, fit.physics, _drawn_sd(fit.evidence, clamp_sd), wanted)
    least, name, unit = fit.evidence.body.scale.stiffness(lower, values.density)
    said = (f"{reason.removesuffix('.')}; {name} is at least {value:.2g} {unit}." if unit and np.isfinite(value) else reason for reason, value in zip(values.reasons, least, strict=True))
    return replace(values, young_lower=lower, reasons=tuple(said))


def _sd_of_tail(fit: Fit, bend: Bend, geometry_sd: np.ndarray, detune: np.ndarray) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,): what a fit of the free frames and its rivals leave open, whose modes were off by `detune` (k,) or held."""
    tail, physics = fit.tail, fit.physics
    detuning = detuning_log10_sd(float(np.abs(detune).max(initial=0.0)))
    beyond = np.hypot(detuning, of_shapes(tail, physics, bend)) if tail.detuned else of_held_modes(tail, physics, bend)
    return np.minimum(np.hypot(np.hypot(log10_young_sd(tail, physics, bend, geometry_sd, detune), beyond), fit.rivals_sd), OPEN_SD)


def sd_of_guess(evidence: Evidence) -> np.ndarray:
    """Standard deviation of log10 E per part, (n,), where no motion tells it."""
    return np.full(evidence.body.parts, GUESS_SD) if evidence.belief is None else evidence.belief.log10_young_sd


def of_motion(fit: Fit) -> dict[str, Any]:
    """The fields of StartValues that say how the body moves and why."""
    whole, physics, load = fit.last(), fit.physics, fit.load
    solution = whole.solve(physics, load)
    return {
        "young": physics.young,
        "damping": physics.damping,
        "forced": whole.allowed,
        "footprint": fit.footprint,
        "force": solution.force,
        "initial_displacement": solution.initial_displacement,
        "initial_velocity": solution.initial_velocity,
        "frequencies_hz": whole.modal.frequencies(physics.young),
        "track_cost": _track_cost(fit, solution, load),
    }


def _track_cost(fit: Fit, solution: Solution, load: np.ndarray) -> float:
    """Mean squared misfit of the linear motion on the raw tracks over their mean squared motion."""
    q = fit.modal.respond(
        fit.physics.young,
        damping=fit.physics.damping,
        load=solution.force @ load.T,
        period_s=fit.evidence.period_s,
        initial_displacement=solution.initial_displacement,
        initial_velocity=solution.initial_velocity,
    )
    return fit.evidence.motion.misfit_share(fit.modal, q - q[:1])


def _reasons(fit: Fit, sd: np.ndarray, residual: float, detuning: float, *, holds: bool) -> list[tuple[bool, str]]:
    """Per part whether it is not identified, and a sentence."""
    if not fit.support.has_free_tail:
        why = "the clip shows no free oscillation of sufficient length" if fit.evidence.moves else "the object hardly moves"
        source = "a guess" if fit.evidence.belief is None else "the material prior's"
        return [(True, f"{why}, so this Young's modulus is {source}; record a longer tail without force.")] * len(sd)
    size = fit.tail.size_m
    if not holds:
        text = f"the free motion differs from the fitted modes by {1e3 * residual:.2f} mm of {1e3 * size:.2f} mm; check mask, thickness and parts."
        return [(True, text)] * len(sd)
    if detuning > MOST_DETUNING:
        text = (
            f"the modes explain the free motion only if a frequency of theirs is {100 * detuning:.0f} % off, at most {100 * MOST_DETUNING:.0f} % "
            "is allowed; check scene.gravity_m_s2, thickness, mask and parts."
        )
        return [(True, text)] * len(sd)
    why = "this part hardly strains in the free motion"
    if detuning > STRANGE * FREQUENCY_SD:
        why = f"a frequency of the modes is {100 * detuning:.1f} % off; check scene.gravity_m_s2, thickness, mask and parts"
    told = f"fitted to the free motion within {1e3 * residual:.2f} mm of {1e3 * size:.2f} mm."
    rivals = np.broadcast_to(fit.rivals_sd, len(sd))
    return [(True, f"log10 E is known to +-{s:.2f} only: {RIVALS if r > RIVAL_SHARE * s else why}.") if s > WIDEST_SD else (False, told) for s, r in zip(sd, rivals, strict=True)]


def _with_clamp(reasons: list[tuple[bool, str]], clamp_sd: np.ndarray | float) -> list[tuple[bool, str]]:
    """With what the clamp's place leaves open, where it is not told by a box."""
    if not np.any(clamp_sd):
        return reasons
    each = np.broadcast_to(clamp_sd, len(reasons))
    return [(open_, f"{text.removesuffix('.')}; where the held face lies leaves log10 E open by {s:.3f}.") for (open_, text), s in zip(reasons, each, strict=True)]


def _explained_badly(fit: Fit) -> bool:
    """Of a fit whose modal model has its frequencies."""
    return explained_badly(fit.tail.missed_m(fit.physics.tuned), fit.evidence.motion.coherent_m, fit.tail.size_m)


def explained_badly(residual_m: float, noise_m: float, size_m: float) -> bool:
    """Whether a model misses so much of a motion of that size that its stiffness cannot be believed."""
    return residual_m > ALARM_NOISE * noise_m and residual_m > ALARM_SHARE * size_m
