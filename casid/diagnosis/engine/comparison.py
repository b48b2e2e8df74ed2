"""Comparison of causes that were fitted in one another's place: their order, and which of them are equivalent.

With a correct model the whitened residuals are white, and a difference of likelihood-ratio statistics can be taken at
its face value. A real aircraft leaves residuals that are correlated over seconds. Along a given direction of the
readings, their sum then has a variance larger than one by a factor that is estimated from stretches of record. The
difference of two statistics is divided by this factor, taken along the direction in which the two causes differ (Royall
and Tsou 2003, robust adjustment of a likelihood).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.cause import Gate, at_most
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.acceptance import is_small
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.screening import equivalence
from casid.model.effect import Effect

_EQUIVALENT = "screening.equivalent"


def ranked(
    trials: Sequence[Trial], nameable: Collection[Trial], criteria: Criteria
) -> tuple[list[Trial], tuple[Trial, ...]]:
    """Order the trials and find those that are equivalent to the first.

    The first is the trial that explains most, with three exceptions. A special case comes before an equivalent general
    one: a constant delay comes before a drifting clock. The same cause in fewer records with the opposite sign comes
    first if it explains as much. A hardware fault that is too small to matter comes first if it explains clearly more;
    without it, another cause would be named for its effect.

    Parameters
    ----------
    trials
        The trials of a round.
    nameable
        Those that can be named, or are too small for that.
    criteria
        The thresholds.

    Returns
    -------
    ordered
        The trials, best first.
    equivalents
        The trials equivalent to the first; empty if no trial that matters is `nameable`.
    """
    matter = [t for t in nameable if t.meaningful]
    ordered = _in_order(trials, matter)
    if not matter:
        return ordered, ()
    first = ordered[0]
    small = max((t for t in nameable if not t.meaningful), key=lambda t: t.gain.total, default=first)
    if small.gain.total > first.gain.total + equivalence(first.gain.raw, criteria):
        return _moved_first(small, ordered), ()
    alike = equivalents_of(first, ordered, criteria)
    simpler = [t for t in alike if t in matter and t.effect.kind in first.effect.includes]
    simpler = simpler or _in_fewer_records(first, [t for t in matter if t in ordered], criteria)
    if simpler:
        ordered = _moved_first(simpler[0], ordered)
        alike = equivalents_of(simpler[0], ordered, criteria)
    return ordered, alike


def _in_fewer_records(first: Trial, trials: Sequence[Trial], criteria: Criteria) -> list[Trial]:
    """The same cause as the first in fewer records, if it explains as much.

    A cause that shows only as a difference between records is taken to be in the fewer of them.
    """
    records, near = len(first.candidate.attached.records), equivalence(first.gain.raw, criteria)
    same = [t for t in trials if t.effect.name == first.effect.name and first.gain.total - t.gain.total < near]
    return [t for t in same if 0 < len(t.candidate.attached.records) < records]


def _moved_first(one: Trial, trials: Sequence[Trial]) -> list[Trial]:
    return [one, *(t for t in trials if t is not one)]


def _in_order(trials: Sequence[Trial], nameable: Collection[Trial]) -> list[Trial]:
    """The trials, best first: `nameable` ones before others, then by likelihood-ratio statistic.

    If the first is a cause that the kinematic check can judge, the confirmed trial with the largest sum of both
    statistics comes first instead. An unconfirmed cause owes its statistic to the structure of the aerodynamics, which
    the kinematics do not contain. The exception is a first trial to which the kinematics assign a smaller size, as
    noise does, and a larger statistic than to the confirmed one.
    """
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
    """Trials whose likelihood-ratio statistic is too near that of the best one to prefer either, by the kinematics too.

    If the fingerprints of two causes have a small angle x, the difference of their statistics has a standard deviation
    of 2 sqrt(gain) sin x, whichever of the two is true. If the fingerprints are unrelated, both causes may be true,
    however near their statistics are. A hardware fault may be too small to matter and explain as much as a cause
    elsewhere that does matter.

    If the full model prefers another trial than a kinematic check that confirms both, the two are in dispute and
    equivalent. This happens to a lag beside a scale error, compared with a delay.
    """
    return tuple(t for t in possible_rivals(best, trials) if stands_beside(best, t, criteria).passed)


def ranked_behind(best: Trial, trials: Sequence[Trial], criteria: Criteria) -> dict[str, Gate]:
    """Name of an alternative -> its gate for being in one ambiguity set with the best trial."""
    return {t.candidate.name: stands_beside(best, t, criteria) for t in possible_rivals(best, trials)}


def stands_beside(best: Trial, trial: Trial, criteria: Criteria) -> Gate:
    """The gate that an alternative must pass to be in one ambiguity set with the best trial."""
    return at_most("gain behind the first, of what is equivalent", distance(best, trial, criteria), 1.0, _EQUIVALENT)


def possible_rivals(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Trials of other causes that might replace the best one.

    A variant of the best cause is not another cause. A cause that must be visible in the kinematics is included only if
    the kinematic check confirms it.
    """
    key = best.effect.key
    others = [t for t in trials if t.effect.key != key and not t.refuted and (t.meaningful or is_small(t))]
    return [t for t in others if t.check.confirmed or not t.effect.grounded]


def distance(best: Trial, trial: Trial, criteria: Criteria) -> float:
    """How far a trial is behind the best one, in units of the largest distance of equivalents (see `equivalents_of`).

    The distance is infinite if the fingerprints of the two are unrelated.
    """
    by = criteria.naming
    angle, behind = sine(best, trial), best.gain.total - trial.gain.total
    disputed = trial.check.confirmed and trial.gain.total > best.gain.total
    if best.check.confirmed and trial.check.judges and not disputed:
        behind = max(behind, best.check.gain - trial.check.gain, np.inf if trial.check.doubtful else 0.0)
    ways = [np.inf]
    if angle < by.unrelated:
        ways.append(behind / (trial.inflation * equivalence(best.gain.raw, criteria)))
        if best.effect.regressor and trial.effect.regressor and best.effect.target == trial.effect.target:
            # Model discrepancy explains most of the effect of a term. Little of the statistic is left for a comparison.
            behind_exactly = best.gain.exact - trial.gain.exact
            ways.append(behind_exactly / (trial.inflation * equivalence(best.gain.exact, criteria)))
    if angle < by.alike:
        spread = 2.0 * np.sqrt(max(best.gain.total, 0.0) * trial.inflation) * angle
        ways.append(behind / max(by.alike_sigmas * spread, 1e-300))
    return float(min(ways))


def sine(one: Trial, other: Trial) -> float:
    """Sine of the angle between two fingerprints; 1 if one of the trials was not fitted."""
    a, b = one.fingerprint, other.fingerprint
    if a.size != b.size:
        return 1.0
    cosine = float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
    return float(np.sqrt(max(1.0 - cosine**2, 0.0)))


def look_alike(one: Effect, other: Effect) -> bool:
    """Whether two causes have the same target and one shows as the other, because derivatives reproduce the rest."""
    shown = {(one.shows_as, other.kind), (other.shows_as, one.kind)}
    return one.target == other.target and any(as_ == kind for as_, kind in shown)


def tempered(rounds: Sequence[Round], evidence: Evidence) -> tuple[Round, ...]:
    """The rounds with likelihood ratios weighted down for correlated residuals of the final model.

    The equivalents are determined again with these weights.
    """
    left = Remainder(evidence)
    return tuple(_tempered(one, left, evidence.criteria) if one.named else one for one in rounds)


def _tempered(round_: Round, left: Remainder, criteria: Criteria) -> Round:
    best = replace(round_.leader, inflation=left.inflation(_response(round_.leader)))
    rivals = [replace(one, inflation=left.inflation(_difference(round_.leader, one))) for one in round_.rivals]
    earlier = {one.effect.key for one in round_.equivalents}
    found = equivalents_of(best, [best, *rivals], criteria)
    kept = [one for one in rivals if one.effect.key in earlier and one not in found]
    behind = ranked_behind(best, rivals, criteria)
    return replace(round_, trials=(best, *rivals), equivalents=(*found, *kept), ranked=behind)


def _response(trial: Trial) -> np.ndarray:
    """Whitened response to a cause, scaled so that its norm is the square root of the likelihood-ratio statistic."""
    length = float(np.linalg.norm(trial.fingerprint))
    return trial.fingerprint * (np.sqrt(max(trial.gain.total, 0.0)) / max(length, 1e-300))


def _difference(one: Trial, other: Trial) -> np.ndarray:
    """The difference of the whitened responses to two causes, with the sign at which they are most alike."""
    a, b = _response(one), _response(other)
    return a - np.copysign(1.0, a @ b) * b if a.size == b.size else np.zeros(0)


class Remainder:
    """Whitened residuals of a fit, model discrepancy removed, in stretches of record."""

    def __init__(self, evidence: Evidence) -> None:
        self._left = evidence.left
        self._first: Sequence[np.ndarray] = [
            np.arange(0, len(self._left), max(1, round(evidence.criteria.structure.stretch / record.dt)))
            for record in evidence.fit.flight.records
        ]

    def inflation(self, direction: np.ndarray) -> float:
        """Variance of the residuals along a direction of the readings, at least 1; white residuals have 1."""
        square = float(direction @ direction)
        if direction.size != self._left.size or square == 0.0:
            return 1.0
        along = np.einsum("nrc,nrc->nr", direction.reshape(self._left.shape), self._left)
        sums = [np.add.reduceat(along[:, r], first) for r, first in enumerate(self._first)]
        return max(float(np.sum(np.concatenate(sums) ** 2)) / square, 1.0)
