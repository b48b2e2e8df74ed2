"""Does a cause explain what was missing, or does it imitate it?

An effect outside the catalogue can be imitated in part by something in it. A cause that leaves most of what an
anonymous input at the same station gains is such an imitation; and a wrong name distorts what it is put beside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from casid.diagnosis.evidence.evidence import Evidence, is_sure, weigh
from casid.diagnosis.evidence.missing_input import ONE_READING, READING, MissingInput, missing_at
from casid.diagnosis.naming.size import SHARE, meaningful_share, missing_share
from casid.diagnosis.result import Trial
from casid.model.effect import Effect

# part of a missing input's gain that may stay: of what truly acts hardly any does, of imitations a fifth and more; and
# what is little anyway
_EXPLAINED, _NOTICEABLE = 0.25, 150.0
_HELPED = 0.35  # part of a cause's gain that an input must lose to be looked at
_BENDS = 0.1  # `_EXPLAINED` of a term, which may bend to imitate anything, and of coefficients that switch together
# part that a right cause leaves where it enters of all that is missing there while the structure is taken as exact:
# 0.0001 to 0.0025 on the sets that were looked at, and imitations 0.15 and more
_HARDLY = 0.01
_STEADY, _HALF = 0.1, 0.5  # and at the reading that has a bias, which a drift imitates, or another fault
_AIR = "wind_"
_WORSE, _BESIDE = 1.3, 0.02  # times what was missing at a station, and part of the gain that may be missing besides
_NEXT_TO_NOTHING = 0.02  # of what is still missing: a model that misses so much more bends small things


def doubt(before: Sequence[MissingInput], after: Sequence[MissingInput], last: Trial, evidence: Evidence) -> str:
    """Why the last cause is not believed, in words; "" when it is.

    before, after  what was missing before it and the causes named since, and what is missing beside them
    evidence       of the model that has it

    It is believed when what was missing is gone where it enters and where it helped most, and not only thinned out; or
    it gains more than an input of any shape could where it enters, or anywhere; or it explains nearly all that is
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
    if not judged and max(seen.left.values()) > last.total:
        return "leaves what is missing as it was, and that is more than it gains"
    return "" if seen.gone(judged) else "leaves unexplained what is missing"


def mostly_gone(before: float, left: float, part: float = _EXPLAINED) -> bool:
    """Whether of what an unknown input gained `before`, what is `left` is little: noise, or less than `part` of it."""
    return left < max(part * before, _NOTICEABLE)


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
        stations = {self.effect.enters, *(f"d{member}" for member in self.effect.members)}
        return [s for s in self.was if s in stations]

    def gone(self, stations: Sequence[str] | set[str], part: float = _EXPLAINED) -> bool:
        return all(mostly_gone(self.was[s], self.left[s], part) for s in stations)

    @property
    def makes_more_missing(self) -> bool:
        more = max(_NOTICEABLE, _BESIDE * self.last.gain)
        worse = (m for m in self.after if m.gain > _WORSE * self.was[m.station] + more)
        return any(missing_share(self.evidence.fit, m) > SHARE for m in worse)

    @property
    def is_next_to_nothing(self) -> bool:
        return self.last.total < _NEXT_TO_NOTHING * max(self.left.values())

    @property
    def is_not_sure(self) -> bool:
        return not is_sure(self.evidence, self.last.candidate.name)

    @property
    def has_a_bias_that_drifts(self) -> bool:
        fit = self.evidence.fit
        biases = [a for a in fit.attached if a.effect.constant and meaningful_share(fit, a) >= 1.0]
        biased = [READING + a.effect.target for a in biases]
        return not self.gone([s for s in biased if s in self.was], _STEADY)

    @property
    def is_air_where_one_reading_drifts(self) -> bool:
        drift = max(gain for station, gain in self.was.items() if station.startswith(READING))
        return (self.effect.enters or "").startswith(_AIR) and drift > ONE_READING * self.last.gain

    @property
    def is_improbable_and_leaves_something(self) -> bool:
        return self.effect.improbable and not self.gone(list(self.was))

    @property
    def bends_and_leaves_too_much(self) -> bool:
        bends = self.effect.quasi_steady or bool(self.effect.members)
        gone = (mostly_gone(max(self.was[s], self.last.total), self.left[s], _BENDS) for s in self.own)
        return bends and not self.effect.improbable and not all(gone) and not self.explains_nearly_all

    @cached_property
    def explains_nearly_all(self) -> bool:
        """Whether little is left where it enters while the structure is taken as exact. Small terms that may be as
        large as they must be leave both the cause and what is missing little to gain."""
        left = _left_exactly(self.evidence, self.own)
        return bool(left) and all(gain < _HARDLY * (self.last.exact + gain) for gain in left)

    @property
    def gains_more_than_any_input(self) -> bool:
        return self.last.gain > max(self.was[s] for s in self.own or self.was)

    @property
    def kinematics_agree(self) -> bool:
        reading = READING + self.effect.target
        drifts = reading in self.was and not mostly_gone(self.was[reading], self.left[reading], _HALF)
        return self.last.confirmed and not drifts

    @property
    def judged(self) -> set[str]:
        """Stations at which what was missing must be gone: where it enters, and where it helped most, unless that is
        too little for an anonymous input to do what the cause does."""
        found = {max(self.own, key=lambda s: self.was[s])} if self.own else set()
        helped = max(self.was, key=lambda s: self.was[s] - self.left[s])
        if self.was[helped] - self.left[helped] > max(_HELPED * self.last.gain, _NOTICEABLE):
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
