"""The flight value of each number of the aircraft file: without the prior that the file gives for it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.evidence.evidence import Evidence, deviation
from casid.diagnosis.flight.evaluation import FlightFit
from casid.estimation.residual_colour import (
    WhitePiece,
    coloured_score,
    estimated,
    gathered,
    noise_autocovariance,
    spread,
)
from casid.estimation.solvers.quadratic import inverse_along
from casid.model.terms import VARIABLES, derivative_term, parse_term


@dataclass(frozen=True, kw_only=True)
class FlightValue:
    """One number from the records alone: its value and corrected 1-sigma, without the prior of the file; and whether
    they determine it better than the file does. Otherwise it is not fitted.

    A term that was added to the model changes the slope of a derivative along the flight. `at_middle` is the slope,
    with its 1-sigma, at the middle of the flight; `value` is the slope where the term vanishes. A file does not say
    which of them it means.
    """

    value: float
    std: float
    determined: bool
    at_middle: tuple[float, float] | None = None

    def nearest(self, given: float) -> FlightValue:
        """By the slope that is nearer to what the file states, in its own deviations."""
        if self.at_middle is None:
            return self
        other = FlightValue(value=self.at_middle[0], std=self.at_middle[1], determined=self.determined)
        return min((self, other), key=lambda one: abs(one.value - given) / max(one.std, 1e-300))


def flight_values(evidence: Evidence) -> dict[str, FlightValue]:
    """Name -> flight value of every fitted number of a model.

    The 1-sigma is the largest of those that allow for the model discrepancy, for differences between stretches of
    record, and for coloured residuals.
    """
    fit, found = evidence.fit, {}
    coloured, bends = coloured_deviation(fit), _bends(fit)
    for i, slot in enumerate(fit.slots):
        value, weight = float(fit.values[i]), float(fit.prior_weight[i])
        variance = float(evidence.covariance[i, i])
        from_records = 1.0 - weight * variance
        corrected = max(deviation(evidence, slot.name), float(coloured[i]))
        if not (variance > 0.0 and from_records > 0.0):
            found[slot.name] = FlightValue(value=value, std=math.inf, determined=False)
            continue
        own = value + float(fit.prior_pull[i]) * variance / from_records
        determined = from_records > fit.flight.criteria.given.from_records
        one = FlightValue(value=own, std=corrected / from_records, determined=determined)
        found[slot.name] = replace(one, at_middle=_at_middle(evidence, i, one, bends.get(slot.name, {})))
    return found


def _at_middle(evidence: Evidence, index: int, one: FlightValue, bend: dict[int, float]) -> tuple[float, float] | None:
    """Slope and its 1-sigma at the middle of the flight, with the added terms; None where these add nothing."""
    if not bend:
        return None
    along = np.zeros(len(evidence.covariance))
    along[index] = 1.0
    for j, part in bend.items():
        along[j] = part
    added = sum(part * float(evidence.fit.values[j]) for j, part in bend.items())
    variance = max(float(along @ evidence.covariance @ along), 0.0)
    return one.value + added, one.std * math.sqrt(variance / float(evidence.covariance[index, index]))


def _bends(fit: FlightFit) -> dict[str, dict[int, float]]:
    """Name of a derivative -> number of a slot -> slope of the added term of that slot at the medians of the flight."""
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
    flat = fit.columns.reshape(fit.white.size, len(fit.slots))
    known = np.flatnonzero(np.einsum("ij,ij->j", flat, flat) > 0.0)
    if not len(known):
        return found
    prior = np.diag(fit.prior_weight[known])
    sums, every = gathered(_pieces(fit, known)), np.eye(len(known))
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
    seen, columns = fit.filter.linear.seen, np.arange(len(known))
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
