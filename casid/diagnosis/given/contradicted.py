"""Numbers of the aircraft file that flight contradicts.

A number is contradicted if it differs from the flight value by more than its stated uncertainty (10 % if none is
stated), and by more than three corrected standard deviations of the flight value.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from scipy.special import ndtri

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence, deviation_along, left_open, straight_lines
from casid.diagnosis.flight.evaluation import FlightFit, by_rows
from casid.diagnosis.flight.hypothesis import smallest_stated_std
from casid.estimation.residual_colour import (
    WhitePiece,
    coloured_score,
    estimated,
    gathered,
    noise_autocovariance,
    spread,
)
from casid.estimation.solvers.quadratic import inverse_along
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.effects import effect_of
from casid.model.numbers import with_deviation
from casid.model.plausible import Doubt, impossibilities, possible
from casid.model.system import Model
from casid.model.terms import VARIABLES, derivative_term, parse_term
from casid.model.usual_derivatives import missing_derivatives


@dataclass(frozen=True, kw_only=True)
class FlightValue:
    """One number from the records alone: its value and corrected 1-sigma, without the prior of the file; and whether
    they determine it better than the file does. Otherwise it is not fitted.

    A term that was added to the model changes the slope of a derivative along the flight. `value` is the slope where
    the term vanishes; `at_trim` is that at the trim of the file, with its 1-sigma. A linear model of a curved aircraft
    has the latter, but its file does not state so: it must differ from both to be contradicted.
    """

    value: float
    std: float
    determined: bool
    fitted_std: float = math.nan  # corrected 1-sigma of the fitted value, to which the prior of the file contributes
    at_trim: tuple[float, float] | None = None

    @property
    def stated(self) -> FlightValue:
        """Value by the slope that a linear model has."""
        return self if self.at_trim is None else replace(self, value=self.at_trim[0], std=self.at_trim[1])

    def nearest(self, given: float) -> FlightValue:
        """Return the value by the slope that is nearer to what the file states, in its own deviations."""
        return min((self, self.stated), key=lambda one: abs(one.value - given) / max(one.std, 1e-300))

    def against(self, given: float, margin: float, criteria: Criteria) -> bool:
        """Return True if both slopes differ from `given` by more than a margin and by more than three deviations."""
        sigmas = criteria.significance.sigmas
        both = (self, self.stated)
        return self.determined and all(abs(one.value - given) > max(margin, sigmas * one.std) for one in both)


def flight_values(
    evidence: Evidence, otherwise: FlightFit | None = None, others: Sequence[Mapping[str, float]] = ()
) -> dict[str, FlightValue]:
    """Name -> flight value of every fitted number of a model.

    A derivative is the slope of the straight line nearest along the records. The 1-sigma is the largest of those
    that allow for the model discrepancy, for differences between stretches of record, and for coloured residuals. Where
    the records leave it open how the air moves, `otherwise` is the fit in its other form, whose distance is part of
    the 1-sigma. The 95 % interval reaches the values of all `others`, explanations that change values by so much.
    """
    fit = evidence.fit
    found = {}
    quantile = float(ndtri(0.5 * (1.0 + fit.criteria.priors.holds)))
    coloured = coloured_deviation(fit)
    bends = _bends(fit) if fit.flight.coefficients else {}
    lines = straight_lines(evidence)
    wake = by_the_wake(evidence, lines)
    for i, slot in enumerate(fit.slots):
        value = float(fit.values[i])
        weight = float(fit.prior_weight[i])
        variance = float(lines[i] @ evidence.covariance @ lines[i])
        from_records = 1.0 - weight * variance
        slope = deviation_along(evidence, lines[i], value)
        corrected = max(math.hypot(slope, *left_open(evidence, i)), float(coloured[i]))
        corrected = math.hypot(corrected, float(wake[i]))
        if otherwise is not None:
            corrected = math.hypot(corrected, otherwise[slot.name] - value)
        corrected = math.hypot(corrected, max((abs(one.get(slot.name, 0.0)) for one in others), default=0.0) / quantile)
        if not (variance > 0.0 and from_records > 0.0):
            found[slot.name] = FlightValue(value=value, std=math.inf, determined=False, fitted_std=corrected)
            continue
        own = value + float(fit.prior_pull[i]) * variance / from_records
        determined = from_records > fit.flight.criteria.parts.half
        std = corrected / from_records
        one = FlightValue(value=own, std=std, determined=determined, fitted_std=corrected)
        found[slot.name] = replace(one, at_trim=_at_trim(evidence, lines[i], one, bends.get(slot.name, {})))
    return found


def by_the_wake(evidence: Evidence, lines: np.ndarray) -> np.ndarray:
    """(slots,) 1-sigma of the fitted values by the downwash at the tail, which arrives late, in a model without it.

    Beside the pitch rate, the rate of the angle of attack has the derivative of the pitch rate times the slope of the
    downwash, 2 CL_alpha / (pi A) (B. Etkin, Dynamics of Flight, 3.9). Records show the sum of the two; a file may state
    either of them.
    """
    fit = evidence.fit
    found = np.zeros(len(evidence.fit.slots))
    if not any(term == "alphadot" for _, term in evidence.terms):
        return found  # as of any system that is no aircraft
    number = {slot.name: i for i, slot in enumerate(fit.slots)}
    aircraft = fit.flight.aircraft
    lift = next((abs(fit.derivatives[name]) for name in ("CL_alpha", "CZ_alpha") if name in fit.derivatives), 0.0)
    slope = min(2.0 * lift * aircraft.moment_length_pitch**2 / (math.pi * aircraft.area), 1.0)
    for j, (coefficient, term) in enumerate(evidence.terms, len(fit.slots)):
        i = number.get(f"{coefficient}_q")
        if term == "alphadot" and i is not None:
            size = slope * abs(float(fit.values[i])) / evidence.factors[j - len(fit.slots)]
            found = np.hypot(found, size * lines[: len(fit.slots), j])
    return found


def _at_trim(
    evidence: Evidence, line: np.ndarray, one: FlightValue, bend: dict[int, float]
) -> tuple[float, float] | None:
    """Slope and its 1-sigma at the trim, with the added terms; None where these add nothing. `line` has the factors of
    the slope without them.
    """
    if not bend:
        return None
    along = line.copy()
    for j, part in bend.items():
        along[j] += part
    added = sum(part * float(evidence.fit.values[j]) for j, part in bend.items())
    variance = max(float(along @ evidence.covariance @ along), 0.0)
    return one.value + added, one.std * math.sqrt(variance / float(line @ evidence.covariance @ line))


def _bends(fit: FlightFit) -> dict[str, dict[int, float]]:
    """Name of a derivative -> number of a slot -> slope of the added term of that slot at the trim of the file; what
    the file does not state has its median along the flight."""
    number = {slot.name: i for i, slot in enumerate(fit.slots)}
    terms = [
        (one.effect.target, parse_term(one.effect.regressor), number[one.name])
        for one in fit.attached
        if one.effect.regressor and one.effect.quasi_steady and not one.onsets and one.name in number
    ]
    if not terms:
        return {}
    live = fit.batch.live
    middle = {
        name: float(np.median(np.broadcast_to(series, live.shape)[live]))
        for name, series in fit.regressors.items()
        if name in VARIABLES
    }
    trim = fit.flight.aircraft.trim
    middle |= {name: trim[name] for name in middle.keys() & trim.keys() - {"V"}}  # a term has its relative change
    found: dict[str, dict[int, float]] = {}
    for name in fit.derivatives:
        coefficient, term = derivative_term(name)
        if term.degree != 1:
            continue
        slopes = {i: own.slope(term.name, middle) for target, own, i in terms if target == coefficient}
        found[name] = {i: slope for i, slope in slopes.items() if slope}
    return found


def coloured_deviation(fit: FlightFit) -> np.ndarray:
    """(slots,) 1-sigma of the fitted values with the colour of their residuals; zero if it cannot be computed."""
    found = np.zeros(len(fit.slots))
    flat = by_rows(fit.columns)
    known = np.flatnonzero(np.einsum("ij,ij->j", flat, flat) > 0.0)
    if not len(known):
        return found
    prior = np.diag(fit.prior_weight[known])
    sums = gathered(_pieces(fit, known))
    every = np.eye(len(known))
    information = prior.copy()
    for own in sums.values():
        spread(information, own.gram(1.0))
    try:
        inverse = inverse_along(every, information)
        noise = noise_autocovariance(sums, prior, every)
    except np.linalg.LinAlgError:
        return found
    colours = {channel: estimated(noise[channel], own.count) for channel, own in sums.items()}
    score = prior + coloured_score(colours, sums, _pieces(fit, known), len(known))
    found[known] = np.sqrt(np.maximum(np.diagonal(inverse @ score @ inverse), 0.0))
    return found


def _pieces(fit: FlightFit, known: np.ndarray) -> Iterator[WhitePiece]:
    """Whitened sensitivities and innovations, one record after the other."""
    seen = fit.seen
    columns = np.arange(len(known))
    for record in range(fit.white.shape[1]):
        for channel in range(fit.white.shape[2]):
            here = seen[:, record, channel]
            if here.any():
                yield WhitePiece(
                    channel=channel,
                    record=record,
                    columns=columns,
                    rows=fit.columns[here, record, channel][:, known],
                    residuals=fit.white[here, record, channel],
                )


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """A number of the file that flight contradicts, or that cannot be."""

    in_json: ClassVar[str] = "parameter unit given flight std sigmas percent reversed impossible sentence"

    parameter: str  # name of a derivative or term, `actuator_lag(delta_e)` of an effect, "inertia"
    unit: str
    # value of the file, in `unit`; `flight` that of the records with its corrected 1-sigma `std`, NaN where nothing
    # was fitted
    given: float
    flight: float
    std: float
    reversed: bool  # flight has the other sign; `impossible` no aircraft has this value
    impossible: bool
    sentence: str

    @property
    def sigmas(self) -> float:
        """Difference between flight and file in corrected standard deviations."""
        return abs(self.flight - self.given) / self.std if self.std > 0.0 else math.nan

    @property
    def percent(self) -> float:
        """Difference between flight and file, as a part of the file's number."""
        return 100.0 * (self.flight / self.given - 1.0) if self.given else math.nan


def impossible(doubt: Doubt) -> Contradiction:
    """A number of the file that no aircraft has, whatever flight shows."""
    return Contradiction(
        parameter=doubt.parameter,
        unit=doubt.unit,
        given=doubt.given,
        flight=math.nan,
        std=math.nan,
        reversed=False,
        impossible=True,
        sentence=doubt.sentence,
    )


def contradicted(
    aircraft: Aircraft,
    flight: Mapping[str, FlightValue],
    criteria: Criteria | None = None,
    slopes: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Contradiction, ...]:
    """Numbers of the file that are inconsistent with flight: impossible ones, reversed signs, then by deviation.

    `slopes` of derivatives by tables and own aerodynamics, on which those of the file are increments.
    """
    by = criteria or Criteria()
    against = [*_derivatives(aircraft, flight, by, slopes), *_effects(aircraft, flight, by)]
    found = [*_impossible(aircraft, flight), *against]
    return tuple(sorted(found, key=lambda c: (not c.impossible, not c.reversed, -_rank(c.sigmas))))


def contradicted_parameters(
    model: Model, flight: Mapping[str, FlightValue], criteria: Criteria
) -> tuple[Contradiction, ...]:
    """Parameters of a model whose nominal values are inconsistent with the records, by deviation.

    They differ by more than their stated uncertainty (10 % if none is stated), and by more than three corrected
    standard deviations.
    """
    found = []
    for name, given in model.nominal.items():
        one = flight.get(name)
        margin = model.prior_std.get(name, criteria.parts.tenth * abs(given))
        if one and one.against(given, margin, criteria):
            unit = model.units.get(name, "")
            says = f"{name} is {_plain(given, unit)} in the model; the records say {_number(one, unit)}."
            found.append(replace(_against(name, unit, given, one, margin), sentence=says))
    return tuple(sorted(found, key=lambda one: -_rank(one.sigmas)))


def _rank(sigmas: float) -> float:
    return sigmas if math.isfinite(sigmas) else math.inf


def _derivatives(
    aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria, slopes: Mapping[str, float]
) -> Iterator[Contradiction]:
    """The derivatives and terms that flight contradicts."""
    given = dict(aircraft.derivatives)
    given |= {f"{c}_{term}": value for c, row in aircraft.terms.items() for term, value in row.items()}
    for name, value in given.items():
        coefficient, term = derivative_term(name)
        whole = value + slopes.get(name, 0.0)
        margin = (aircraft.relative_uncertainty or criteria.parts.tenth) * abs(whole)
        margin = max(margin, smallest_stated_std(coefficient, criteria.parts))
        if name in flight and flight[name].against(value, margin, criteria):
            one = flight[name].stated
            yield _against(name, term.unit, whole, replace(one, value=one.value + slopes.get(name, 0.0)), margin)
    for name, value in missing_derivatives(aircraft).items():
        coefficient, term = derivative_term(name)
        margin = smallest_stated_std(coefficient, criteria.parts)
        if name in flight and flight[name].against(value, margin, criteria):
            one = flight[name].stated
            says = f"The file has no {name}; flight says {_number(one, term.unit)}."
            yield replace(_against(name, term.unit, value, one, margin), sentence=says)


def _effects(aircraft: Aircraft, flight: Mapping[str, FlightValue], criteria: Criteria) -> Iterator[Contradiction]:
    """The same for the effects of the file."""
    for value in aircraft.effects:
        effect = effect_of(value)
        stated = _flight_says(effect, flight)
        margin = value.std or criteria.parts.tenth * abs(value.value)
        if stated is not None and stated.against(value.value, margin, criteria) and possible(effect, value.value):
            yield _against(effect.name, effect.unit, value.value, stated, margin)


def _impossible(aircraft: Aircraft, flight: Mapping[str, FlightValue]) -> Iterator[Contradiction]:
    """Numbers that no aircraft has: effects beyond a plausible size, and inertias that no rigid body has."""
    effects = {effect.name: effect for effect in map(effect_of, aircraft.effects)}
    for doubt in impossibilities(aircraft):
        stated = _flight_says(effects[doubt.parameter], flight) if doubt.parameter in effects else None
        says = f" Flight says {_number(stated, doubt.unit)}." if stated is not None and stated.determined else ""
        told = impossible(replace(doubt, sentence=f"{doubt.sentence}{says}"))
        yield replace(told, flight=stated.value, std=stated.std) if stated is not None else told


def _flight_says(effect: Effect, flight: Mapping[str, FlightValue]) -> FlightValue | None:
    """The flight value of the size of an effect, in the unit of the file."""
    one = flight.get(effect.name)
    return replace(one, value=effect.in_words({"value": one.value})["value"]) if one else None


def _against(name: str, unit: str, given: float, flight: FlightValue, margin: float) -> Contradiction:
    """Flight beside the file."""
    opposes = flight.value * given < 0.0 and min(abs(flight.value), abs(given)) > margin
    says = "says the opposite sign," if opposes else "says"
    return Contradiction(
        parameter=name,
        unit=unit,
        given=given,
        flight=flight.value,
        std=flight.std,
        reversed=opposes,
        impossible=False,
        sentence=f"{name} is {_plain(given, unit)} in the file; flight {says} {_number(flight, unit)}.",
    )


def _plain(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" if unit not in ("", "1") and not unit.startswith("1/") else f"{value:.3g}"


def _number(one: FlightValue, unit: str) -> str:
    """Value +- 1-sigma; a derivative per rad without its unit."""
    shown = "" if unit in ("", "1") or unit.startswith("1/") else f" {unit}"
    return with_deviation(one.value, one.std) + shown
