"""Does a cause explain what was missing, or does it imitate it?

An effect outside the catalogue can be imitated in part by something in it. A cause that leaves most of what an
anonymous input at the same station gains is such an imitation; and a wrong name distorts what it is put beside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from casid.diagnosis.criteria import Criteria, DoubtCriteria
from casid.diagnosis.decision import Gate, all_passed, at_least, at_most
from casid.diagnosis.evidence.evidence import Evidence, sure, weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_at
from casid.diagnosis.naming.round import Trial
from casid.diagnosis.naming.size import meaningful_share, missing_share
from casid.model.effect import Effect
from casid.model.station import Station, coefficient, reading


def explains(
    before: Sequence[MissingInput], after: Sequence[MissingInput], last: Trial, evidence: Evidence
) -> tuple[Gate, ...]:
    """What the last cause must pass to be believed, up to the first gate that it fails.

    before, after  what was missing before it and the causes named since, and what is missing beside them
    evidence       of the model that has it

    None of `_OBJECTIONS` may hold. And what was missing must be gone where it enters and where it helped most, and not
    only thinned out. Instead, it may gain more than an input of any shape could where it enters, or anywhere; or
    kinematics, which know no aerodynamics, find it too; or it explains nearly all that is missing where it enters,
    small terms of the structure apart.
    """
    seen = _Seen(was={m.station: m.gain for m in before}, after=after, last=last, evidence=evidence)
    gates: list[Gate] = []
    for objection in _OBJECTIONS:
        gates += objection(seen)
        if not all_passed(gates):
            return tuple(gates)
    return tuple(gates) if seen.effect.improbable else (*gates, _explains_what_was_missing(seen))


def mostly_gone(before: float, left: float, criteria: DoubtCriteria, part: tuple[float, str] | None = None) -> Gate:
    """What an unknown input that gained `before` must pass where `left` of it is still missing: a part of it at most
    (with its criterion), or noise."""
    most, name = part or (criteria.left, "doubt.left")
    noise = at_most("gain still missing", left, criteria.noticeable, "doubt.noticeable")
    return at_most("part still missing", left / max(before, 1e-300), most, name, [noise])


def _nearness(gate: Gate) -> tuple[bool, float]:
    """How near a gate is to failing, for the worst of several that each have alternatives."""
    return not gate.passed, min(one.value / one.threshold for one in (gate, *gate.or_else))


def _left_exactly(evidence: Evidence, stations: Sequence[str]) -> list[float]:
    """What an unknown input gains at these stations while the structure is taken as exact."""
    return [m.gain for m in missing_at(weigh(evidence.fit, discrepancy=False), stations)]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen:
    """Gains of anonymous inputs by station before a cause, and what is missing beside it."""

    was: dict[str, float]
    after: Sequence[MissingInput]
    last: Trial
    evidence: Evidence

    @property
    def criteria(self) -> Criteria:
        return self.evidence.criteria

    @property
    def by(self) -> DoubtCriteria:
        return self.criteria.doubt

    @cached_property
    def left(self) -> dict[str, float]:
        """Gains beside it."""
        return {m.station: m.gain for m in self.after}

    @property
    def effect(self) -> Effect:
        return self.last.effect

    @property
    def own(self) -> list[str]:
        """The stations at which it enters."""
        stations = {self.effect.enters, *(coefficient(member) for member in self.effect.members)}
        return [s for s in self.was if s in stations]

    def gone(self, stations: Iterable[str], part: tuple[float, str] | None = None, least: float = 0.0) -> list[Gate]:
        """What must pass where `part` of what was missing, or of `least`, may stay at most: the worst station."""
        found = [self._gone(s, part, least) for s in stations]
        return [max(found, key=_nearness)] if found else []

    def _gone(self, station: str, part: tuple[float, str] | None, least: float) -> Gate:
        gate = mostly_gone(max(self.was[station], least), self.left[station], self.by, part)
        return replace(gate, gate=f"{gate.gate} at {Station.at(station).words}")

    @cached_property
    def nearly_all(self) -> Gate:
        """Little is left where it enters while the structure is taken as exact. Small terms that may be as large as
        they must be leave both the cause and what is missing little to gain."""
        left = _left_exactly(self.evidence, self.own)
        worst = max((gain / max(self.last.gain.exact + gain, 1e-300) for gain in left), default=1.0)
        return at_most("part still missing, structure exact", worst, self.by.left_exactly, "doubt.left_exactly")

    @property
    def judged(self) -> set[str]:
        """Stations at which what was missing must be gone: where it enters, and where it helped most, unless that is
        too little for an anonymous input to do what the cause does."""
        found = {max(self.own, key=lambda s: self.was[s])} if self.own else set()
        helped = max(self.was, key=lambda s: self.was[s] - self.left[s])
        if self.was[helped] - self.left[helped] > max(self.by.helped * self.last.gain.raw, self.by.noticeable):
            found.add(helped)
        return found


def _makes_nothing_worse(seen: _Seen) -> list[Gate]:
    """Nothing that matters is missing elsewhere beside it that was not before."""
    more = max(seen.by.noticeable, seen.by.worse_part * seen.last.gain.raw)
    worse = [m for m in seen.after if m.gain > seen.by.worse * seen.was[m.station] + more]
    shares = {m.place.words: missing_share(seen.evidence.fit, m) for m in worse}
    if not shares:
        return []
    most = max(shares, key=lambda place: shares[place])
    return [at_most(f"share newly missing at {most}", shares[most], seen.criteria.size.share, "doubt.worse")]


def _is_sure(seen: _Seen) -> list[Gate]:
    return list(sure(seen.evidence, seen.last.candidate.name))


def _is_no_bias_that_drifts(seen: _Seen) -> list[Gate]:
    """A reading with a constant error does not drift."""
    fit = seen.evidence.fit
    biases = [a for a in fit.attached if a.effect.constant and meaningful_share(fit, a) >= 1.0]
    biased = [reading(a.effect.target) for a in biases]
    return seen.gone([s for s in biased if s in seen.was], (seen.by.left_by_terms, "doubt.left_by_terms"))


def _is_no_drift_of_one_reading(seen: _Seen) -> list[Gate]:
    """Moving air gains more than one reading that drifts."""
    if seen.effect.enters is None or Station.at(seen.effect.enters).kind != "wind":
        return []
    drift = max(gain for station, gain in seen.was.items() if Station.at(station).kind == "reading")
    part = drift / max(seen.last.gain.raw, 1e-300)
    most = seen.criteria.turbulence.one_reading
    return [at_most("gain of one drifting reading, of it", part, most, "turbulence.one_reading")]


def _is_symmetric_or_explains_all(seen: _Seen) -> list[Gate]:
    """What is contrary to the symmetry of an aircraft leaves nothing missing anywhere."""
    return seen.gone(seen.was) if seen.effect.improbable else []


def _is_no_imitation(seen: _Seen) -> list[Gate]:
    """What bends, and so imitates anything, leaves less missing where it enters."""
    effect = seen.effect
    if effect.improbable or not (effect.quasi_steady or effect.members):
        return []
    part = seen.by.left_by_terms, "doubt.left_by_terms"
    return [
        gate if gate.passed else replace(gate, or_else=(*gate.or_else, seen.nearly_all))
        for gate in seen.gone(seen.own, part, seen.last.gain.total)
    ]


def _explains_what_was_missing(seen: _Seen) -> Gate:
    """What was missing is gone where it must be, or one of the alternatives passes."""
    most = max(seen.was[s] for s in seen.own or seen.was)
    alternatives = [at_least("gain, of what any input gains there", seen.last.gain.raw / max(most, 1e-300), 1.0)]
    own = reading(seen.effect.target)
    if seen.last.confirmed:
        drifts = seen.gone([own] if own in seen.was else [])
        alternatives += drifts or [at_least("confirmed by kinematics", 1.0, 1.0)]
    judged = seen.judged
    (found,) = seen.gone(judged) or [
        at_most("largest gain still missing, of it", max(seen.left.values()) / max(seen.last.gain.total, 1e-300), 1.0)
    ]
    if not found.passed and not any(gate.passed for gate in alternatives):
        alternatives.append(seen.nearly_all)
    return replace(found, or_else=(*found.or_else, *alternatives))


_OBJECTIONS: tuple[Callable[[_Seen], list[Gate]], ...] = (
    _makes_nothing_worse,
    _is_sure,
    _is_no_bias_that_drifts,
    _is_no_drift_of_one_reading,
    _is_symmetric_or_explains_all,
    _is_no_imitation,
)
