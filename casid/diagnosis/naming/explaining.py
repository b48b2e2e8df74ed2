"""Does a cause explain what was missing, or does it imitate it?

An effect outside the catalogue can be imitated in part by something in it. A cause that leaves most of what an
anonymous input at the same station gains is such an imitation; and a wrong name distorts what it is put beside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from casid.diagnosis.criteria import Criteria, DoubtCriteria
from casid.diagnosis.evidence.evidence import Evidence, is_sure, weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_at
from casid.diagnosis.naming.round import Trial
from casid.diagnosis.naming.size import meaningful_share, missing_share
from casid.model.effect import Effect
from casid.model.station import Station, coefficient, reading


def doubt(before: Sequence[MissingInput], after: Sequence[MissingInput], last: Trial, evidence: Evidence) -> str:
    """Why the last cause is not believed, in words; "" when it is.

    before, after  what was missing before it and the causes named since, and what is missing beside them
    evidence       of the model that has it

    It is believed when what was missing is gone where it enters and where it helped most, and not only thinned out. Or
    it gains more than an input of any shape could where it enters, or anywhere. Or it explains nearly all that is
    missing where it enters, small terms of the structure apart; or kinematics, which know no aerodynamics, find it too.
    Never when one of `_AGAINST` holds.
    """
    seen = _Seen(was={m.station: m.gain for m in before}, after=after, last=last, evidence=evidence)
    for words, holds in _AGAINST.items():
        if holds(seen):
            return words
    if seen.effect.improbable or seen.gains_more_than_any_input or seen.kinematics_agree or seen.explains_nearly_all:
        return ""
    judged = seen.judged
    if not judged and max(seen.left.values()) > last.gain.total:
        return "leaves what is missing as it was, and that is more than it gains"
    return "" if seen.gone(judged) else "leaves unexplained what is missing"


def mostly_gone(before: float, left: float, criteria: DoubtCriteria, part: float | None = None) -> bool:
    """Whether of what an unknown input gained `before`, what is `left` is little: noise, or less than `part` of it."""
    return left < max((criteria.left if part is None else part) * before, criteria.noticeable)


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

    def gone(self, stations: Sequence[str] | set[str], part: float | None = None) -> bool:
        return all(mostly_gone(self.was[s], self.left[s], self.by, part) for s in stations)

    @property
    def makes_more_missing(self) -> bool:
        more = max(self.by.noticeable, self.by.worse_part * self.last.gain.raw)
        worse = (m for m in self.after if m.gain > self.by.worse * self.was[m.station] + more)
        return any(missing_share(self.evidence.fit, m) > self.criteria.size.share for m in worse)

    @property
    def is_next_to_nothing(self) -> bool:
        return self.last.gain.total < self.by.negligible * max(self.left.values())

    @property
    def is_not_sure(self) -> bool:
        return not is_sure(self.evidence, self.last.candidate.name)

    @property
    def has_a_bias_that_drifts(self) -> bool:
        fit = self.evidence.fit
        biases = [a for a in fit.attached if a.effect.constant and meaningful_share(fit, a) >= 1.0]
        biased = [reading(a.effect.target) for a in biases]
        return not self.gone([s for s in biased if s in self.was], self.by.left_by_a_bias)

    @property
    def is_air_where_one_reading_drifts(self) -> bool:
        drift = max(gain for station, gain in self.was.items() if Station.at(station).kind == "reading")
        more = drift > self.criteria.turbulence.one_reading * self.last.gain.raw
        return more and self.effect.enters is not None and Station.at(self.effect.enters).kind == "wind"

    @property
    def is_improbable_and_leaves_something(self) -> bool:
        return self.effect.improbable and not self.gone(list(self.was))

    @property
    def bends_and_leaves_too_much(self) -> bool:
        bends = self.effect.quasi_steady or bool(self.effect.members)
        part, total = self.by.left_by_terms, self.last.gain.total
        gone = (mostly_gone(max(self.was[s], total), self.left[s], self.by, part) for s in self.own)
        return bends and not self.effect.improbable and not all(gone) and not self.explains_nearly_all

    @cached_property
    def explains_nearly_all(self) -> bool:
        """Whether little is left where it enters while the structure is taken as exact. Small terms that may be as
        large as they must be leave both the cause and what is missing little to gain."""
        left = _left_exactly(self.evidence, self.own)
        return bool(left) and all(gain < self.by.left_exactly * (self.last.gain.exact + gain) for gain in left)

    @property
    def gains_more_than_any_input(self) -> bool:
        return self.last.gain.raw > max(self.was[s] for s in self.own or self.was)

    @property
    def kinematics_agree(self) -> bool:
        own = reading(self.effect.target)
        drifts = own in self.was and not self.gone([own], self.by.left_by_a_fault)
        return self.last.confirmed and not drifts

    @property
    def judged(self) -> set[str]:
        """Stations at which what was missing must be gone: where it enters, and where it helped most, unless that is
        too little for an anonymous input to do what the cause does."""
        found = {max(self.own, key=lambda s: self.was[s])} if self.own else set()
        helped = max(self.was, key=lambda s: self.was[s] - self.left[s])
        if self.was[helped] - self.left[helped] > max(self.by.helped * self.last.gain.raw, self.by.noticeable):
            found.add(helped)
        return found


_AGAINST: dict[str, Callable[[_Seen], bool]] = {
    "makes more missing elsewhere": lambda seen: seen.makes_more_missing,
    "is next to nothing beside what is still missing": lambda seen: seen.is_next_to_nothing,
    "is not sure to be there at all": lambda seen: seen.is_not_sure,
    "is steady, but the reading drifts": lambda seen: seen.has_a_bias_that_drifts,
    "moves the air, but one reading that drifts tells more": lambda seen: seen.is_air_where_one_reading_drifts,
    "is contrary to the symmetry of an aircraft, and something is missing beside it": lambda seen: (
        seen.is_improbable_and_leaves_something
    ),
    "leaves too much missing where it enters, as an imitation does": lambda seen: seen.bends_and_leaves_too_much,
}
