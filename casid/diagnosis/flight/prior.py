"""What is known of the parameters before the records: as the aircraft file states it, and nothing that it does not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from casid.diagnosis.criteria import Criteria, PriorCriteria
from casid.diagnosis.flight.regressors import Regressors
from casid.model.aircraft import Aircraft
from casid.model.causes import sensor_bias
from casid.model.system import Model
from casid.model.terms import Term, derivative_term

OFFSET = "bias_"  # and the channel: parameter of a model


class Believed(Protocol):
    """What is asked of what a model describes."""

    def model(self) -> Model: ...
    def prior_std(self, model: Model, name: str) -> float: ...


class Stated(Protocol):
    """What is asked of a flight."""

    @property
    def aircraft(self) -> Aircraft: ...
    @property
    def criteria(self) -> Criteria: ...
    def regressors(self, model: Model) -> Regressors: ...


def prior(flight: Believed, model: Model, names: Sequence[str | None]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and inverse variance of what is fitted; effects, and what has no name among the parameters, have none."""
    mean, weight = np.zeros(len(names)), np.zeros(len(names))
    of_the_file = flight.model().parameters
    for i, name in enumerate(names):
        if name in of_the_file:
            mean[i] = model.nominal[name]
            weight[i] = flight.prior_std(model, name) ** -2.0
    return mean, weight


def smallest_stated_std(coefficient: str, criteria: PriorCriteria | None = None) -> float:
    """Least uncertainty of a derivative: what is stated relative to one near zero says nothing."""
    known = criteria or PriorCriteria()
    return known.stated * known.typical.of(coefficient)


def derivative_std(flight: Stated, model: Model, name: str) -> float:
    """1-sigma as the file states it, or of a derivative that the file has at zero as large as it is in aircraft. Where
    that is not known, so loose that it says nothing, by what its regressor does in these records. An offset of an
    instrument is small beside what matters as a cause."""
    if name.startswith(OFFSET):
        channel = name.removeprefix(OFFSET)
        return float(sensor_bias(channel).smallest_that_matters(flight.aircraft) or np.inf)
    known, size = flight.criteria.prior, abs(model.nominal[name])
    if name in flight.aircraft.knots:
        return model.prior_std.get(name, known.spread * max(size, known.typical.of(flight.aircraft.knots[name])))
    coefficient, term = derivative_term(name)
    smallest = known.typical.of(coefficient)
    if name in model.prior_std:
        return max(model.prior_std[name], smallest_stated_std(coefficient, known))
    usual = known.usual.of(name)
    if size == 0.0 and usual is not None:
        return usual * _as_in_the_file(flight.aircraft, term)
    if size > 0.0 or not term.factors:
        return known.spread * max(size, smallest)
    moves = max(flight.regressors(model).variation(term), known.resting)
    return known.spread * smallest * max(1.0, known.regressor / moves)


def _as_in_the_file(aircraft: Aircraft, term: Term) -> float:
    """Factor of a derivative by a rate where the file does not make rates dimensionless with half of a length."""
    lengths = {
        "p": (aircraft.moment_length_lateral, aircraft.rate_length_lateral),
        "q": (aircraft.moment_length_pitch, aircraft.rate_length_pitch),
        "r": (aircraft.moment_length_lateral, aircraft.rate_length_lateral),
    }
    length, made_with = lengths.get(term.name, (2.0, 1.0))
    return 0.5 * length / made_with
