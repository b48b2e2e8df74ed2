"""The acceptance gates of a cause.

A cause alone must have a sufficient likelihood-ratio statistic and a size that matters, is clear and is physically
possible, and the kinematic check must not reject it. As part of a set it must be significant, make nothing else worse,
and explain what was missing at its port.

The last gate guards against imitation. An effect that is not in the catalogue can be imitated in part by a cause that
is. Such an imitation leaves most of the likelihood-ratio statistic of a latent input at the same port, and a wrong name
distorts the causes that are estimated beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from casid.diagnosis.cause import Gate, all_passed, at_least, at_most
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.size import meaningful_share, missing_share, plausible, plausible_size
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import Evidence, sure
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.effect import Effect
from casid.model.station import Station, coefficient, reading


def required_gain(effect: Effect, criteria: Criteria) -> float:
    """Net likelihood-ratio statistic that a cause must reach to be named."""
    return criteria.naming.gain_of_an_instrument if effect.of_an_instrument else criteria.naming.gain


def clear_gain(base: FlightFit) -> float:
    """Likelihood-ratio statistic at which a cause of the smallest size that matters counts as clear.

    The value is larger if the noise was estimated with the model. Structural errors are then part of the residuals but
    not of the noise, and a negligible cause can be many standard deviations from zero.
    """
    by = base.criteria
    return by.significance.search if base.flight.noise_by_fit else by.naming.clear


def gains_enough(trial: Trial, earlier: Sequence[Trial], required: float, criteria: Criteria) -> Gate:
    """The gate on the likelihood-ratio statistic of a trial, in the presence of causes named earlier.

    The misfit that remains because an earlier cause, or turbulence, has only an approximate shape is no evidence for
    another cause. The kinematic check is not affected: it includes turbulence and contains no aerodynamics.

    Parameters
    ----------
    trial
        The fitted cause.
    earlier
        The causes named before it.
    required
        The part of the likelihood-ratio statistic of turbulence that counts as misfit of its approximate shape.
    criteria
        The thresholds.
    """
    gained = trial.gain.total if trial.effect.regressor else trial.gain.net
    of_a_name = "naming.gain_of_an_instrument" if trial.effect.of_an_instrument else "naming.gain"
    leave = [one.gain.raw for one in earlier if one.effect.kinematic or not trial.confirmed]
    prices = {
        of_a_name: required_gain(trial.effect, criteria),
        "naming.approximate": 0.0 if trial.confirmed else required,
        "naming.left_to_others": criteria.naming.left_to_others * max(leave, default=0.0),
    }
    highest = max(prices, key=lambda name: prices[name])
    return at_least("gain", gained, prices[highest], highest)


def can_be_named(trial: Trial) -> bool:
    """Whether a trial has a sufficient likelihood-ratio statistic, and either matters or is a small hardware fault."""
    enough = trial.enough is not None and trial.enough.passed
    return enough and (trial.meaningful or is_small(trial)) and not trial.refuted


def is_small(trial: Trial) -> bool:
    """Whether a trial is a hardware fault that is too small to matter: of an instrument, or between a record and its
    surface.
    """
    of_hardware = trial.effect.of_an_instrument or trial.effect.of_a_surface
    return of_hardware and trial.share < 1.0 and plausible(trial.candidate.attached)


def size_gates(
    fitted: FlightFit, one: Attached, share: float, gain: float, clear: float, confirmed: bool
) -> tuple[Gate, ...]:
    """The gates on the fitted size of a cause: it matters, is clear and possible, and an event begins inside a record.

    Parameters
    ----------
    fitted
        The fit with the cause.
    one
        The cause with its fitted values.
    share
        Its size, in units of the smallest size that matters.
    gain
        Its likelihood-ratio statistic.
    clear
        The statistic at which a cause of the smallest size that matters is clear.
    confirmed
        Whether the kinematic check confirms it.
    """
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
    """The gates on a size: it matters, and it is clear enough.

    The second gate is omitted for a cause that nothing in the aerodynamics can imitate (`unlike_aerodynamics`).
    """
    size = at_least("size, of what matters", share, 1.0, "size.share")
    if unlike_aerodynamics:
        return (size,)
    name = "naming.clear" if clear == criteria.naming.clear else "significance.search"
    return size, at_least("clearness", share**2 * gain, clear, name)


def explains(
    before: Sequence[MissingInput], after: Sequence[MissingInput], last: Trial, evidence: Evidence
) -> tuple[Gate, ...]:
    """The gates on the last cause of a set, up to the first one that fails.

    No objection of `_OBJECTIONS` may hold. A latent input at the port of the cause, and at the port where the cause
    helped most, must lose most of its likelihood-ratio statistic. There are two alternatives to the second requirement:
    the statistic of the cause exceeds that of a latent input at its port, or at any port; or the kinematic check, which
    contains no aerodynamics, confirms it.

    Parameters
    ----------
    before
        Latent inputs before the cause, and those named since the last accepted set, were added.
    after
        Latent inputs beside these causes.
    last
        The trial of the last cause.
    evidence
        Evidence of the model with the causes.
    """
    seen = _Seen(was={m.station: m.gain for m in before}, after=after, last=last, evidence=evidence)
    gates: list[Gate] = []
    for objection in _OBJECTIONS:
        gates += objection(seen)
        if not all_passed(gates):
            return tuple(gates)
    return tuple(gates) if seen.effect.improbable else (*gates, _explains_what_was_missing(seen))


def mostly_gone(before: float, left: float, criteria: Criteria, part: tuple[float, str] | None = None) -> Gate:
    """The gate on what is still missing at a port: at most a part of what was missing before, or no more than noise.

    `before` and `left` are the likelihood-ratio statistics of the latent input before and after the cause. `part` is
    the largest permitted ratio with the name of its criterion.
    """
    most, name = part or (criteria.doubt.left, "doubt.left")
    noise = at_most("gain still missing", left, criteria.verdict.missing, "verdict.missing")
    return at_most("part still missing", left / max(before, 1e-300), most, name, [noise])


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

    @property
    def criteria(self) -> Criteria:
        return self.evidence.criteria

    @property
    def most(self) -> tuple[float, str]:
        """The part that may be missing beside a cause that can imitate others, with the name of its criterion."""
        return self.criteria.doubt.left_by_terms, "doubt.left_by_terms"

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

    def gone(self, stations: Iterable[str], part: tuple[float, str] | None = None, least: float = 0.0) -> list[Gate]:
        """The gate of the worst of these ports on what may still be missing; empty without ports.

        `part` is the largest permitted ratio to what was missing before, or to `least` if that is more.
        """
        found = [self._gone(s, part, least) for s in stations]
        return [max(found, key=_nearness)] if found else []

    def _gone(self, station: str, part: tuple[float, str] | None, least: float) -> Gate:
        gate = mostly_gone(max(self.was[station], least), self.left[station], self.criteria, part)
        return replace(gate, gate=f"{gate.gate} at {Station.at(station).words}")

    @property
    def judged(self) -> set[str]:
        """Ports at which a latent input must lose its statistic: that of the cause, and that where the cause helped
        most.

        The second is omitted if the reduction there is too small for a latent input to act as the cause does.
        """
        found = {max(self.own, key=lambda s: self.was[s])} if self.own else set()
        helped = max(self.was, key=lambda s: self.was[s] - self.left[s])
        least = max(self.criteria.doubt.left * self.last.gain.raw, self.criteria.verdict.missing)
        if self.was[helped] - self.left[helped] > least:
            found.add(helped)
        return found


def _makes_nothing_worse(seen: _Seen) -> list[Gate]:
    """The gate on ports where a latent input has more statistic than before the cause: its share must not matter."""
    criteria = seen.criteria
    more = max(criteria.verdict.missing, criteria.naming.approximate * seen.last.gain.raw)
    worse = [m for m in seen.after if m.gain > (1.0 + criteria.doubt.left) * seen.was[m.station] + more]
    shares = {m.place.words: missing_share(seen.evidence.fit, m) for m in worse}
    if not shares:
        return []
    most = max(shares, key=lambda place: shares[place])
    return [at_most(f"share newly missing at {most}", shares[most], criteria.size.share, "size.share")]


def _is_sure(seen: _Seen) -> list[Gate]:
    return list(sure(seen.evidence, seen.last.candidate.name))


def _is_no_bias_that_drifts(seen: _Seen) -> list[Gate]:
    """The gate on a reading with a constant error: no drift of the same reading may remain."""
    fit = seen.evidence.fit
    biases = [a for a in fit.attached if a.effect.constant and meaningful_share(fit, a) >= 1.0]
    biased = [reading(a.effect.target) for a in biases]
    return seen.gone([s for s in biased if s in seen.was], seen.most)


def _is_no_drift_of_one_reading(seen: _Seen) -> list[Gate]:
    """The gate on turbulence: it must have more likelihood-ratio statistic than the drift of any single reading."""
    if seen.effect.enters is None or Station.at(seen.effect.enters).kind != "wind":
        return []
    drift = max(gain for station, gain in seen.was.items() if Station.at(station).kind == "reading")
    part = drift / max(seen.last.gain.raw, 1e-300)
    most = seen.criteria.turbulence.one_reading
    return [at_most("gain of one drifting reading, of it", part, most, "turbulence.one_reading")]


def _is_symmetric_or_explains_all(seen: _Seen) -> list[Gate]:
    """The gate on a cause that contradicts the symmetry of an aircraft: nothing may remain missing at any port."""
    return seen.gone(seen.was) if seen.effect.improbable else []


def _is_no_imitation(seen: _Seen) -> list[Gate]:
    """The gate on a cause flexible enough to imitate others, a term or a configuration change: less may remain at its
    port.
    """
    effect = seen.effect
    if effect.improbable or not (effect.quasi_steady or effect.members):
        return []
    return seen.gone(seen.own, seen.most, seen.last.gain.total)


def _explains_what_was_missing(seen: _Seen) -> Gate:
    """The gate on the latent inputs at the judged ports, with its alternatives (see `explains`)."""
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
