"""The acceptance gates of a cause, and the comparison of causes.

A cause alone must have a sufficient likelihood-ratio statistic and a size that matters, is clear and is physically
possible, and the kinematic check must not reject it. As part of a set it must be significant, make nothing else worse,
and explain what was missing at its port.

The last gate guards against imitation. An effect that is not in the catalogue can be imitated in part by a cause that
is. Such an imitation leaves most of the likelihood-ratio statistic of a latent input at the same port, and a wrong name
distorts the causes that are estimated beside it.

Causes that were fitted in one another's place are compared. With a correct model the whitened residuals are white, and
a difference of likelihood-ratio statistics can be taken at its face value. A real aircraft leaves residuals that are
correlated over seconds. Along a given direction of the readings, their sum then has a variance larger than one by a
factor that is estimated from stretches of record. The difference of two statistics is divided by this factor, taken
along the direction in which the two causes differ (Royall and Tsou 2003, robust adjustment of a likelihood).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from casid.diagnosis import comparisons as ask
from casid.diagnosis import gates
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.evidence import Evidence, sure
from casid.diagnosis.evidence.fingerprints import print_of
from casid.diagnosis.evidence.missing_input import MissingInput, missing_at
from casid.diagnosis.evidence.screening import Screen, equivalence
from casid.diagnosis.evidence.size import missing_size
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect
from casid.model.station import Station, coefficient, reading
from casid.model.terms import COEFFICIENTS


def gains_enough(trial: Trial, earlier: Sequence[Trial], required: float, criteria: Criteria) -> Gate:
    """The gate on the likelihood-ratio statistic of a trial, in the presence of causes named `earlier`.

    The kinematic check is not affected by them: it includes turbulence (of which `required` is misfit) and contains no
    aerodynamics.
    """
    left = max((one.gain.raw for one in earlier if one.effect.kinematic or not trial.confirmed), default=0.0)
    misfit = 0.0 if trial.confirmed else required
    return gates.gain(trial.effect, trial.decisive_gain, left, misfit, criteria)


def can_be_named(trial: Trial) -> bool:
    """Return True if a trial has a sufficient likelihood-ratio statistic, and either matters or is a small hardware
    fault."""
    enough = trial.enough is not None and trial.enough.passed
    return enough and (trial.meaningful or is_small(trial)) and not trial.refuted


def is_small(trial: Trial) -> bool:
    """Return True if a trial is a hardware fault that is too small to matter: of an instrument, or between a record and
    its surface."""
    return trial.effect.of_hardware and trial.share < 1.0 and gates.is_possible(trial.candidate.attached)


def size_gates(fitted: FlightFit, one: Attached, share: float, statistic: float, confirmed: bool) -> tuple[Gate, ...]:
    """The gates on the fitted size of a cause: it matters, is clear, possible and slow enough for the samples, and an
    event begins inside a record.

    `share` is its size in units of the smallest that matters; `confirmed` is True if the kinematic check finds it.
    """
    criteria = fitted.criteria
    alone = confirmed or one.effect.of_an_instrument
    clear = gates.clear_gain(one.effect, criteria, fitted.flight.noise_by_fit)
    found = (*gates.clear_size(share, statistic, clear, criteria, alone), *gates.possible(one))
    if not one.onsets:
        return found
    first = {record.name: record.t[0] + criteria.numerics.events.step for record in fitted.flight.records}
    latest = max(onset - first[record] for record, onset in one.onsets.items())
    return (*found, ask.ONSET.of(latest, criteria.numerics.events.fine, "numerics.events.fine"))


def explains(
    before: Sequence[MissingInput],
    after: Sequence[MissingInput],
    last: Trial,
    evidence: Evidence,
    kinematic: Sequence[Evidence] = (),
) -> tuple[Gate, ...]:
    """The gates on the last cause of a set, up to the first one that fails.

    No objection of `_OBJECTIONS` may hold. A latent input at the port of the cause, and at the port where the cause
    helped most, must lose most of its likelihood-ratio statistic. There are two alternatives to the second requirement:
    the statistic of the cause exceeds that of a latent input at its port, or at any port; or the kinematic check, which
    contains no aerodynamics, confirms it, and no drift of the same reading remains there.

    before     latent inputs before the cause, and those named since the last accepted set, were added
    after      latent inputs beside these causes
    evidence   evidence of the model with the causes
    kinematic  that of the kinematics, before and beside these causes, where there is one
    """
    was = {m.station: m.gain for m in before}
    seen = _Seen(was=was, after=after, last=last, evidence=evidence, kinematic=kinematic)
    asked: list[Gate] = []
    for objection in _OBJECTIONS:
        asked += objection(seen)
        if not all_passed(asked):
            return tuple(asked)
    return tuple(asked) if seen.effect.traits.improbable else (*asked, *_explains_what_was_missing(seen))


def _nearness(gate: Gate) -> tuple[bool, float]:
    """Sort key for the worst of several gates with alternatives: failed gates last, then by value over threshold."""
    return not gate.passed, min(one.value / one.threshold for one in (gate, *gate.or_else))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen:
    """The likelihood-ratio statistics of latent inputs before a cause (`was`, by port) and beside it (`after`)."""

    was: dict[str, float]
    after: Sequence[MissingInput]
    last: Trial
    evidence: Evidence
    kinematic: Sequence[Evidence]

    @property
    def criteria(self) -> Criteria:
        return self.evidence.criteria

    @cached_property
    def left(self) -> dict[str, float]:
        """Likelihood-ratio statistics of latent inputs beside the cause, by port."""
        return {m.station: m.gain for m in self.after}

    @property
    def effect(self) -> Effect:
        return self.last.effect

    @property
    def own(self) -> list[str]:
        """The ports at which the cause enters."""
        stations = {self.effect.enters, *(coefficient(member) for member in self.effect.members)}
        return [s for s in self.was if s in stations]

    def drift_gone(self, station: str) -> Gate:
        """The gate on what may still be missing at the reading of a confirmed cause, by the kinematics: what is missing
        of the aerodynamics does not look like a drift there.
        """
        was = self.was[station]
        left = self.left[station]
        if self.kinematic:
            was, left = (missing_at(one, [station])[0].gain for one in self.kinematic)
        return gates.still_missing(was, left, self.criteria, where=f" at {Station.at(station).words}")

    def gone(self, stations: Iterable[str], least: float = 0.0, *, flexible: bool = False) -> list[Gate]:
        """The gate of the worst of these ports on what may still be missing; empty without ports.

        It compares with what was missing before, or with `least` if that is more; see `gates.still_missing`.
        """
        by = self.criteria
        found = [
            gates.still_missing(max(self.was[s], least), self.left[s], by, f" at {Station.at(s).words}", flexible)
            for s in stations
        ]
        return [max(found, key=_nearness)] if found else []

    @property
    def judged(self) -> set[str]:
        """Ports at which a latent input must lose its statistic: that of the cause, and that where the cause helped
        most.

        The second is omitted if the reduction there is too small for a latent input to act as the cause does.
        """
        found = {max(self.own, key=lambda s: self.was[s])} if self.own else set()
        helped = max(self.was, key=lambda s: self.was[s] - self.left[s])
        least = max(self.criteria.parts.quarter * self.last.gain.raw, self.criteria.missing)
        if self.was[helped] - self.left[helped] > least:
            found.add(helped)
        return found


def concerned(evidence: Evidence, name: str) -> list[int]:
    """Return the indices of the fitted records in which an effect acts."""
    one = next(a for a in evidence.fit.attached if a.name == name)
    return [r for r, record in enumerate(evidence.fit.batch.names) if one.concerns(record)]


def sure_beside_all(evidence: Evidence, name: str) -> tuple[Gate, ...]:
    """Ask that the size of a named cause differs from zero beside all others, whichever record is left out."""
    asked = sure(evidence, name, concerned(evidence, name))
    return tuple(replace(gate, gate=gate.gate + ask.FINAL) for gate in asked)


def _makes_nothing_worse(seen: _Seen) -> list[Gate]:
    """The gate on ports where a latent input has more statistic than before the cause: its share must not matter."""
    criteria = seen.criteria
    more = max(criteria.missing, criteria.naming.approximate * seen.last.gain.raw)
    worse = [m for m in seen.after if m.gain > (1.0 + criteria.parts.quarter) * seen.was[m.station] + more]
    sizes = {m.place.words: missing_size(seen.evidence.fit, m) for m in worse}
    if not sizes:
        return []
    most = max(sizes, key=lambda place: sizes[place])
    return [ask.NEWLY_MISSING.of(sizes[most], 1.0, "size.share", where=f" at {most}")]


def _is_sure(seen: _Seen) -> list[Gate]:
    return list(sure(seen.evidence, seen.last.candidate.name))


def _is_no_bias_that_drifts(seen: _Seen) -> list[Gate]:
    """The gate on a constant error of a reading: no drift of the same reading may remain."""
    own = reading(seen.effect.target)
    return seen.gone([own] if seen.effect.traits.constant and own in seen.was else [], flexible=True)


def _is_symmetric_or_explains_all(seen: _Seen) -> list[Gate]:
    """The gate on a cause that contradicts the symmetry of an aircraft: nothing may remain missing at any port."""
    return seen.gone(seen.was) if seen.effect.traits.improbable else []


def _is_no_imitation(seen: _Seen) -> list[Gate]:
    """The gate on a cause flexible enough to imitate others, a term or a configuration change: less may remain at its
    port, and nothing beside a cause of last resort.
    """
    effect = seen.effect
    if effect.traits.improbable or not (effect.quasi_steady or effect.members):
        return []
    if effect.traits.last_resort:
        left = max((m for m in seen.after if m.station in seen.own), key=lambda m: m.gain)
        size = missing_size(seen.evidence.fit, left)
        noise = gates.no_more_than_noise(left.gain, seen.criteria)
        return [ask.MISSING_SIZE.of(size, 1.0, "size.share", [noise])]
    return seen.gone(seen.own, seen.last.gain.total, flexible=True)


def _explains_what_was_missing(seen: _Seen) -> list[Gate]:
    """The gate on the latent inputs at the judged ports, with its alternatives (see `explains`)."""
    most = max(seen.was[s] for s in seen.own or seen.was)
    alternatives = [ask.ANY_INPUT.of(seen.last.gain.raw / max(most, 1e-300), 1.0)]
    own = reading(seen.effect.target)
    judged = seen.gone(seen.judged) or alternatives[:1]
    if seen.last.confirmed and own in seen.was and not any(one.passed for one in (*judged, *alternatives)):
        alternatives.append(seen.drift_gone(own))
    return [replace(one, or_else=(*one.or_else, *alternatives)) for one in judged]


_OBJECTIONS: tuple[Callable[[_Seen], list[Gate]], ...] = (
    _makes_nothing_worse,
    _is_sure,
    _is_no_bias_that_drifts,
    _is_symmetric_or_explains_all,
    _is_no_imitation,
)


def ranked(
    trials: Sequence[Trial], nameable: Collection[Trial], criteria: Criteria
) -> tuple[list[Trial], tuple[Trial, ...]]:
    """Order the trials and find those that are equivalent to the first.

    The first is the trial that explains most, with four exceptions. A special case comes before an equivalent general
    one: a constant delay comes before a drifting clock. Of equivalent terms of one coefficient the simplest comes
    first. The same cause in fewer records with the opposite sign comes first if it explains as much. A hardware fault
    that is too small to matter comes first if it explains clearly more; without it, another cause would be named for
    its effect.

    nameable     those that can be named, or are too small for that
    equivalents  the trials equivalent to the first; empty if no trial that matters is `nameable`
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
    simpler = [t for t in alike if t in matter and t.effect.kind in first.effect.traits.includes]
    simpler = simpler or _of_lower_order(first, [t for t in alike if t in matter])
    simpler = simpler or _in_fewer_records(first, [t for t in matter if t in ordered], criteria)
    if simpler:
        ordered = _moved_first(simpler[0], ordered)
        alike = equivalents_of(simpler[0], ordered, criteria)
    return ordered, alike


def _of_lower_order(first: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """List the trials of simpler terms of the same coefficient, the simplest first: smooth ones before those with a
    bend, low powers before high ones."""

    def order(one: Trial) -> tuple[bool, int, int]:
        term = one.effect.regressor or ""
        factors = term.split("*")
        powers = [int(power) for _, _, power in (factor.partition("^") for factor in factors) if power.isdigit()]
        return "|" in term, len(factors) + sum(power - 1 for power in powers), len(factors)

    same = (t for t in trials if t.effect.kind == first.effect.kind and t.effect.target == first.effect.target)
    lower = [t for t in same if t.effect.regressor and order(t) < order(first)]
    return sorted(lower, key=lambda t: (order(t), -t.gain.total))


def _in_fewer_records(first: Trial, trials: Sequence[Trial], criteria: Criteria) -> list[Trial]:
    """The same cause as the first in fewer records, if it explains as much.

    A cause that shows only as a difference between records is taken to be in the fewer of them.
    """
    records = len(first.candidate.attached.records)
    near = equivalence(first.gain.raw, criteria)
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
    """Name of an alternative -> its gate for being in one ambiguity set with the best trial.

    A trial that cannot replace the best one, although it may pass its own gates, has the gate that explains it.
    """
    found = {t.candidate.name: ask.CONFIRMED.of(t.confirmed, 1.0) for t in trials if t.effect.traits.grounded}
    found |= {t.candidate.name: ask.BEST_FORM.failed() for t in trials if t.effect.key == best.effect.key}
    rivals = possible_rivals(best, trials)
    if not best.meaningful:
        small = f" {best.candidate.name}, which is too small to matter"
        return found | {t.candidate.name: ask.DECIDED_BEFORE.failed(small) for t in rivals}
    return found | {t.candidate.name: stands_beside(best, t, criteria) for t in rivals}


def stands_beside(best: Trial, trial: Trial, criteria: Criteria) -> Gate:
    """The gate that an alternative must pass to be in one ambiguity set with the best trial."""
    return ask.BEHIND.of(distance(best, trial, criteria), 1.0, "significance.chance")


def possible_rivals(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Trials of other causes that might replace the best one.

    A variant of the best cause is not another cause. A cause that must be visible in the kinematics is included only if
    the kinematic check confirms it.
    """
    key = best.effect.key
    others = [t for t in trials if t.effect.key != key and not t.refuted and (t.meaningful or is_small(t))]
    return [t for t in others if t.check.confirmed or not t.effect.traits.grounded]


def distance(best: Trial, trial: Trial, criteria: Criteria) -> float:
    """Return how far a trial is behind the best one, in units of the largest distance of equivalents (see
    `equivalents_of`).

    The distance is infinite if the fingerprints of the two are unrelated.
    """
    by = criteria.naming
    angle = sine(best, trial)
    behind = best.gain.total - trial.gain.total
    disputed = trial.check.confirmed and trial.gain.total > best.gain.total
    if best.check.confirmed and trial.check.judges and not disputed:
        behind = max(behind, best.check.gain - trial.check.gain, np.inf if trial.check.doubtful else 0.0)
    ways = [np.inf]
    if angle < unrelated(criteria):
        ways.append(behind / (trial.inflation * equivalence(best.gain.raw, criteria)))
        if {best.effect.target, trial.effect.target} & set(COEFFICIENTS):
            # Model discrepancy explains much of an effect of the aerodynamics, and less of others that imitate it: the
            # two statistics may disagree which is the better.
            behind_exactly = best.gain.exact - trial.gain.exact
            ways.append(behind_exactly / (trial.inflation * equivalence(best.gain.exact, criteria)))
    if angle < criteria.parts.most:
        spread = 2.0 * np.sqrt(max(best.gain.total, 0.0) * trial.inflation) * angle
        ways.append(behind / max(by.alike_sigmas * spread, 1e-300))
    return float(min(ways))


def near_rivals(round_: Round, criteria: Criteria) -> list[Trial]:
    """Trials of a round that may replace its leader: all that look alike, and a few that explain nearly as much in
    nearly the same way.
    """
    best = round_.leader
    possible = [t for t in round_.rivals if t.meaningful and not t.refuted]
    alike = [t for t in possible if look_alike(t.effect, best.effect)]
    enough = criteria.parts.most * best.gain.total
    near = [t for t in possible if t.gain.total > enough and sine(best, t) < unrelated(criteria)]
    return [*[t for t in near if t not in alike][: criteria.numerics.naming.few], *alike]


def unrelated(criteria: Criteria) -> float:
    """Return the sine of the angle between fingerprints above which they are unrelated."""
    return 1.0 - criteria.size.share


def may_come_near(evidence: Evidence, best: Trial, rival: Trial) -> bool:
    """Return True if a rival may come as near a named cause, beside all others, as equivalent causes are.

    The linearised model with the named cause predicts both: what the rival adds to it, and what the cause is then still
    worth. It predicts nothing of an effect that is not linear in its size, or has other values, nor of a rival term,
    which is model discrepancy too.
    """
    named = best.candidate.attached
    slots = [slot.name for slot in evidence.fit.slots]
    one = rival.candidate.attached
    criteria = evidence.criteria
    linear = all(a.effect.linear and set(a.values) == {"value"} for a in (one, named))
    if one.effect.regressor or not linear or named.name not in slots:
        return True
    judge, index, (print_, keep) = Screen(evidence), slots.index(named.name), print_of(evidence, one)
    left, match, _ = judge.projected([print_], keep[None])
    if left <= 0.0:
        return True
    along = float(judge.covariance[index] @ (keep @ print_.cross))
    size = evidence.fit[named.name] + judge.newton[index] - along * match / left
    behind = size**2 / (judge.covariance[index, index] + along**2 / left) - match**2 / left
    spread = 2.0 * np.sqrt(max(best.gain.total, 0.0)) * sine(best, rival)
    near = max(equivalence(best.gain.raw, criteria), criteria.naming.alike_sigmas * spread)
    return gates.promises_enough(near / max(behind, near), criteria).passed


def sine(one: Trial, other: Trial) -> float:
    """Sine of the angle between two fingerprints; 1 if one of the trials was not fitted."""
    # the sine of a small angle needs all digits
    a = one.fingerprint.astype(float)
    b = other.fingerprint.astype(float)
    if a.size != b.size:
        return 1.0
    cosine = float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
    return float(np.sqrt(max(1.0 - cosine**2, 0.0)))


def look_alike(one: Effect, other: Effect) -> bool:
    """Return True if one of two causes shows as the other, because derivatives reproduce the rest."""
    return other.key in one.traits.shows_as or one.key in other.traits.shows_as


def tempered(rounds: Sequence[Round], evidence: Evidence) -> tuple[Round, ...]:
    """The rounds with likelihood ratios weighted down for correlated residuals of the final model.

    The equivalents are determined again with these weights.
    """
    left = Remainder(evidence)
    return tuple(_tempered(one, left, evidence.criteria) if one.named else one for one in rounds)


def _tempered(round_: Round, left: Remainder, criteria: Criteria) -> Round:
    leader = round_.leader
    # against a stated uncertainty the statistic is that of the value itself, and no noise enters
    best = leader if leader.effect.size.stated else replace(leader, inflation=left.inflation(_response(leader)))
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
    a = _response(one)
    b = _response(other)
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
