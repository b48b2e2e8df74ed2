"""What a cause must pass, by itself and in a set: all gates of a search.

By itself: its gain is enough, its size matters, is clear and possible, and kinematics do not refute it. In a set: it is
sure, it makes nothing worse, and what was missing where it enters is gone. An effect outside the catalogue can be
imitated in part by something in it. A cause that leaves most of what an anonymous input at the same station gains is
such an imitation; and a wrong name distorts what it is put beside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from casid.diagnosis.criteria import Criteria, DoubtCriteria
from casid.diagnosis.decision import Gate, all_passed, at_least, at_most
from casid.diagnosis.engine.size import meaningful_share, missing_share, plausible, plausible_size
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import Evidence, sure
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect
from casid.model.station import Station, coefficient, reading


def required_gain(effect: Effect, criteria: Criteria) -> float:
    """Net drop of the deviance that a cause must reach to be named."""
    return criteria.naming.gain_of_an_instrument if effect.of_an_instrument else criteria.naming.gain


def clear_gain(base: FlightFit) -> float:
    """Gain at which a cause that just matters is clear: misfit of the structure, where it is not in the noise, makes
    many sigmas of nothing."""
    by = base.criteria.naming
    return by.clear_of_misfit if base.flight.noise_by_fit else by.clear


def gains_enough(trial: Trial, earlier: Sequence[Trial], required: float, criteria: Criteria) -> Gate:
    """What the gain of a trial must pass, beside `earlier` causes.

    What the rough shape of an earlier cause, or of turbulence (`required`), leaves is no evidence for another cause.
    What kinematics find is: they include turbulence and know no aerodynamics.
    """
    gained = trial.gain.total if trial.effect.regressor else trial.gain.net
    of_a_name = "naming.gain_of_an_instrument" if trial.effect.of_an_instrument else "naming.gain"
    leave = [one.gain.raw for one in earlier if one.effect.kinematic or not trial.confirmed]
    prices = {
        of_a_name: required_gain(trial.effect, criteria),
        "turbulence.left": 0.0 if trial.confirmed else required,
        "naming.left_to_others": criteria.naming.left_to_others * max(leave, default=0.0),
    }
    highest = max(prices, key=lambda name: prices[name])
    return at_least("gain", gained, prices[highest], highest)


def can_be_named(trial: Trial) -> bool:
    """Whether a trial gains enough, and matters or is a fault of hardware that does not."""
    enough = trial.enough is not None and trial.enough.passed
    return enough and (trial.meaningful or is_small(trial)) and not trial.refuted


def is_small(trial: Trial) -> bool:
    """Whether it is a fault of an instrument, or between a record and its surface, that is too small to matter."""
    of_hardware = trial.effect.of_an_instrument or trial.effect.of_a_surface
    return of_hardware and trial.share < 1.0 and plausible(trial.candidate.attached)


def size_gates(
    fitted: FlightFit, one: Attached, share: float, gain: float, clear: float, confirmed: bool
) -> tuple[Gate, ...]:
    """What the fitted size of a cause must pass: it matters, is clear, is possible, and an event begins in a record."""
    alone = confirmed or one.effect.of_an_instrument
    gates = (*matters(share, gain, clear, fitted.criteria, alone), *plausible_size(one))
    if not one.onsets:
        return gates
    edge, within = fitted.criteria.screening.edge, fitted.criteria.events.at_start
    first = {record.name: record.t[0] + edge for record in fitted.flight.records}
    latest = max(onset - first[record] for record, onset in one.onsets.items())
    return (*gates, at_least("onset after the beginning of a record", latest, within, "events.at_start"))


def matters(
    share: float, gain: float, clear: float, criteria: Criteria, unlike_aerodynamics: bool = False
) -> tuple[Gate, ...]:
    """What a size must pass: it is at least the smallest that matters, and clear enough to be believed, unless nothing
    in the aerodynamics could look like it."""
    size = at_least("size, of what matters", share, 1.0, "size.share")
    if unlike_aerodynamics:
        return (size,)
    name = "naming.clear" if clear == criteria.naming.clear else "naming.clear_of_misfit"
    return size, at_least("clearness", share**2 * gain, clear, name)


def explains(
    before: Sequence[MissingInput], after: Sequence[MissingInput], last: Trial, evidence: Evidence
) -> tuple[Gate, ...]:
    """What the last cause must pass to be believed, up to the first gate that it fails.

    before, after  what was missing before it and the causes named since, and what is missing beside them
    evidence       of the model that has it

    None of `_OBJECTIONS` may hold. And what was missing must be gone where it enters and where it helped most, and not
    only thinned out. Instead, it may gain more than an input of any shape could where it enters, or anywhere; or
    kinematics, which know no aerodynamics, find it too.
    """
    seen = _Seen(was={m.station: m.gain for m in before}, after=after, last=last, evidence=evidence)
    gates: list[Gate] = []
    for objection in _OBJECTIONS:
        gates += objection(seen)
        if not all_passed(gates):
            return tuple(gates)
    return tuple(gates) if seen.effect.improbable else (*gates, _explains_what_was_missing(seen))


def mostly_gone(before: float, left: float, criteria: Criteria, part: tuple[float, str] | None = None) -> Gate:
    """What an unknown input that gained `before` must pass where `left` of it is still missing: a part of it at most
    (with its criterion), or noise."""
    most, name = part or (criteria.doubt.left, "doubt.left")
    noise = at_most("gain still missing", left, criteria.verdict.missing, "verdict.missing")
    return at_most("part still missing", left / max(before, 1e-300), most, name, [noise])


def _nearness(gate: Gate) -> tuple[bool, float]:
    """How near a gate is to failing, for the worst of several that each have alternatives."""
    return not gate.passed, min(one.value / one.threshold for one in (gate, *gate.or_else))


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
        gate = mostly_gone(max(self.was[station], least), self.left[station], self.criteria, part)
        return replace(gate, gate=f"{gate.gate} at {Station.at(station).words}")

    @property
    def judged(self) -> set[str]:
        """Stations at which what was missing must be gone: where it enters, and where it helped most, unless that is
        too little for an anonymous input to do what the cause does."""
        found = {max(self.own, key=lambda s: self.was[s])} if self.own else set()
        helped = max(self.was, key=lambda s: self.was[s] - self.left[s])
        if self.was[helped] - self.left[helped] > max(
            self.by.helped * self.last.gain.raw, self.criteria.verdict.missing
        ):
            found.add(helped)
        return found


def _makes_nothing_worse(seen: _Seen) -> list[Gate]:
    """Nothing that matters is missing elsewhere beside it that was not before."""
    more = max(seen.criteria.verdict.missing, seen.by.worse_part * seen.last.gain.raw)
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
    return seen.gone(seen.own, (seen.by.left_by_terms, "doubt.left_by_terms"), seen.last.gain.total)


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
    return replace(found, or_else=(*found.or_else, *alternatives))


_OBJECTIONS: tuple[Callable[[_Seen], list[Gate]], ...] = (
    _makes_nothing_worse,
    _is_sure,
    _is_no_bias_that_drifts,
    _is_no_drift_of_one_reading,
    _is_symmetric_or_explains_all,
    _is_no_imitation,
)
