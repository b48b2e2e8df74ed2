"""Causes compared that were fitted in one another's place: which comes first, and which the data cannot tell apart.

What a gain is worth depends on what the model leaves. Of a right model the whitened residuals are white, and a gain is
a drop of 2 ln L. What a real aircraft has beside any model stays in them for seconds. Along a direction of the readings
it adds up to a variance larger than one, by a factor that stretches of record show. A difference of gains then counts
for as much less (Royall and Tsou 2003, robust adjustment of a likelihood; of two causes, along what they differ in).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, at_most
from casid.diagnosis.engine.acceptance import is_small
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.screening import equivalence
from casid.model.effect import Effect

_EQUIVALENT = "screening.equivalent"


def ranked(
    trials: Sequence[Trial], nameable: Collection[Trial], criteria: Criteria
) -> tuple[list[Trial], tuple[Trial, ...]]:
    """(trials, best first; what is equivalent to the first). Nothing is equivalent where none that matters is
    `nameable`.

    First comes what explains most. Before it comes an equivalent of which it is a general case: a constant delay comes
    before a clock that drifts. So does the same cause in fewer records, the other way, that explains as much. And so
    does a fault of hardware that is too small to matter, where it explains clearly more: left out, it would make a
    cause of something else.
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
    """The same cause in fewer records than the first, where it explains as much: what only shows as a difference
    between records is in the fewer."""
    records, near = len(first.candidate.attached.records), equivalence(first.gain.raw, criteria)
    same = [t for t in trials if t.effect.name == first.effect.name and first.gain.total - t.gain.total < near]
    return [t for t in same if 0 < len(t.candidate.attached.records) < records]


def _moved_first(one: Trial, trials: Sequence[Trial]) -> list[Trial]:
    return [one, *(t for t in trials if t is not one)]


def _in_order(trials: Sequence[Trial], nameable: Collection[Trial]) -> list[Trial]:
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
    others = [t for t in trials if t.effect.key != key and not t.refuted and (t.meaningful or is_small(t))]
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
    """Sine of the angle between two fingerprints; 1 where one was not fitted."""
    a, b = one.fingerprint, other.fingerprint
    if a.size != b.size:
        return 1.0
    cosine = float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
    return float(np.sqrt(max(1.0 - cosine**2, 0.0)))


def look_alike(one: Effect, other: Effect) -> bool:
    """Whether derivatives imitate one of them but for what shows as the other."""
    shown = {(one.shows_as, other.kind), (other.shows_as, one.kind)}
    return one.target == other.target and any(as_ == kind for as_, kind in shown)


def tempered(rounds: Sequence[Round], evidence: Evidence) -> tuple[Round, ...]:
    """Rounds of a search with their gains counted beside what its last model leaves, and what is equivalent by that."""
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
    """What it explains, whitened: as long as the root of its gain."""
    length = float(np.linalg.norm(trial.fingerprint))
    return trial.fingerprint * (np.sqrt(max(trial.gain.total, 0.0)) / max(length, 1e-300))


def _difference(one: Trial, other: Trial) -> np.ndarray:
    """What one of two causes explains otherwise than the other."""
    a, b = _response(one), _response(other)
    return a - np.copysign(1.0, a @ b) * b if a.size == b.size else np.zeros(0)


class Remainder:
    """What a fit leaves of the readings, its small terms fitted too, by stretches of record."""

    def __init__(self, evidence: Evidence) -> None:
        self._left = evidence.left
        self._first: Sequence[np.ndarray] = [
            np.arange(0, len(self._left), max(1, round(evidence.criteria.structure.stretch / record.dt)))
            for record in evidence.fit.flight.records
        ]

    def inflation(self, direction: np.ndarray) -> float:
        """Variance of what is left along a direction of the readings, where white noise has one; one at least."""
        square = float(direction @ direction)
        if direction.size != self._left.size or square == 0.0:
            return 1.0
        along = np.einsum("nrc,nrc->nr", direction.reshape(self._left.shape), self._left)
        sums = [np.add.reduceat(along[:, r], first) for r, first in enumerate(self._first)]
        return max(float(np.sum(np.concatenate(sums) ** 2)) / square, 1.0)
