"""Trials compared: which comes first, and which are equivalent."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, at_least, at_most
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.naming.round import Trial
from casid.diagnosis.naming.size import plausible

_EQUIVALENT = "screening.equivalent"


def gains_enough(trial: Trial, prices: Mapping[str, float]) -> Gate:
    """What the gain of a trial must pass: the highest of the prices, which are given by name of criterion."""
    gained = trial.gain.total if trial.effect.regressor else trial.gain.net
    highest = max(prices, key=lambda name: prices[name])
    return at_least("gain", gained, prices[highest], highest)


def can_be_named(trial: Trial) -> bool:
    """Whether a trial gains enough, and matters or is a fault of hardware that does not."""
    enough = trial.enough is not None and trial.enough.passed
    return enough and (trial.meaningful or _is_small(trial)) and not trial.refuted


def _is_small(trial: Trial) -> bool:
    """Whether it is a fault of an instrument, or between a record and its surface, that is too small to matter."""
    of_hardware = trial.effect.of_an_instrument or trial.effect.of_a_surface
    return of_hardware and trial.share < 1.0 and plausible(trial.candidate.attached)


def small_first(trials: Sequence[Trial], fits: Collection[Trial], criteria: Criteria) -> list[Trial]:
    """`trials` in their order, but first a fault of hardware that is too small to matter, where it explains clearly
    more than what can be named. Left out, it would make a cause of something else."""
    first = trials[0]
    small = max((t for t in fits if not t.meaningful), key=lambda t: t.gain.total, default=first)
    if small.gain.total <= first.gain.total + equivalence(first.gain.raw, criteria):
        return list(trials)
    return [small, *(t for t in trials if t is not small)]


def simplest_first(trials: Sequence[Trial], equivalents: Sequence[Trial], nameable: Collection[Trial]) -> list[Trial]:
    """`trials` in their order, but first an equivalent of the first that is a special case of it: a constant delay
    comes before a clock that drifts."""
    first = trials[0]
    simpler = [t for t in equivalents if t in nameable and t.meaningful and t.effect.kind in first.effect.includes]
    return [*simpler[:1], *(t for t in trials if t not in simpler[:1])]


def in_order(trials: Sequence[Trial], nameable: Collection[Trial]) -> list[Trial]:
    """Best first: by what they explain, those that are `nameable` before the others. Where the first is one that
    kinematics can judge, they have a say: what they find of another size, and what explains less to both together,
    stays behind what they confirm. It owes its gain to the aerodynamics' structure, of which they know nothing. Not
    what they find smaller, as noise in what makes it does, and what still explains more to them too."""
    ranked = sorted(trials, key=lambda t: (t not in nameable, -t.gain.total))
    confirmed = [t for t in ranked if t in nameable and t.check.confirmed]
    if confirmed and ranked[0].check.judges:
        first = max(confirmed, key=lambda t: t.gain.total + t.check.gain)
        leader = ranked[0].check
        if not (leader.smaller and leader.gain > first.check.gain):
            ranked.remove(first)
            ranked.insert(0, first)
    return ranked


def equivalents_of(best: Trial, trials: Sequence[Trial], criteria: Criteria) -> tuple[Trial, ...]:
    """Trials whose gain is too near to the best one's to prefer either, by kinematics too.

    The gains of two causes whose fingerprints are at a small angle x differ, whichever is true, with a 1-sigma of
    2 sqrt(gain) sin x. Where the fingerprints have nothing in common both may be true, however near the gains. A fault
    of hardware may be too small to matter and explain as much as one elsewhere that is not.

    What kinematics put second and confirm, and the whole model puts first, is in dispute between the two, as a lag
    beside a scale error is with a delay.
    """
    return tuple(t for t in possible_rivals(best, trials) if stands_beside(best, t, criteria).passed)


def ranked_behind(best: Trial, trials: Sequence[Trial], criteria: Criteria) -> dict[str, Gate]:
    """Name of a rival -> what it must pass to be in one set with the best trial."""
    return {t.candidate.name: stands_beside(best, t, criteria) for t in possible_rivals(best, trials)}


def stands_beside(best: Trial, trial: Trial, criteria: Criteria) -> Gate:
    """What a rival must pass to be in one set with the best trial."""
    return at_most("gain behind the first, of what is equivalent", distance(best, trial, criteria), 1.0, _EQUIVALENT)


def possible_rivals(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Trials of another cause than the best one that might stand in its place; a variant of it is no other cause, and
    what must show in kinematics is none unless they confirm it."""
    key = best.effect.key
    others = [t for t in trials if t.effect.key != key and not t.refuted and (t.meaningful or _is_small(t))]
    return [t for t in others if t.check.confirmed or not t.effect.grounded]


def distance(best: Trial, trial: Trial, criteria: Criteria) -> float:
    """How far a trial is behind the best one, in units of what is too near to prefer either (`equivalents_of`);
    infinite where the two have nothing in common."""
    by = criteria.naming
    angle, behind = sine(best, trial), best.gain.total - trial.gain.total
    disputed = trial.check.confirmed and trial.gain.total > best.gain.total
    if best.check.confirmed and trial.check.judges and not disputed:
        behind = max(behind, best.check.gain - trial.check.gain, np.inf if trial.check.doubtful else 0.0)
    ways = [np.inf]
    if angle < by.unrelated:
        ways.append(behind / (trial.inflation * equivalence(best.gain.raw, criteria)))
        if best.effect.regressor and trial.effect.regressor and best.effect.target == trial.effect.target:
            # other small terms explain most of what a term does, and little is left of its gain to compare with
            behind_exactly = best.gain.exact - trial.gain.exact
            ways.append(behind_exactly / (trial.inflation * equivalence(best.gain.exact, criteria)))
    if angle < by.alike:
        spread = 2.0 * np.sqrt(max(best.gain.total, 0.0) * trial.inflation) * angle
        ways.append(behind / max(by.alike_sigmas * spread, 1e-300))
    return float(min(ways))


def sine(one: Trial, other: Trial) -> float:
    """Sine of the angle between two fingerprints."""
    a, b = one.fingerprint, other.fingerprint
    cosine = float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
    return float(np.sqrt(max(1.0 - cosine**2, 0.0)))
