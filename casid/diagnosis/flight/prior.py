"""Prior of the parameters: the uncertainty that the aircraft file states, or the usual size of a derivative."""

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

OFFSET = "bias_"  # prefix of the parameter of a channel's offset


class Believed(Protocol):
    """Interface of an object whose parameters have a prior."""

    def model(self) -> Model: ...
    def prior_std(self, model: Model, name: str) -> float: ...


class Stated(Protocol):
    """Interface of a flight whose aircraft file states uncertainties."""

    @property
    def aircraft(self) -> Aircraft: ...
    @property
    def criteria(self) -> Criteria: ...
    def regressors(self, model: Model) -> Regressors: ...


def prior(flight: Believed, model: Model, names: Sequence[str | None]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and inverse variance of the fitted parameters; effects and unnamed parameters have no prior."""
    mean, weight = np.zeros(len(names)), np.zeros(len(names))
    of_the_file = flight.model().parameters
    for i, name in enumerate(names):
        if name in of_the_file:
            mean[i] = model.nominal[name]
            weight[i] = flight.prior_std(model, name) ** -2.0
    return mean, weight


def smallest_stated_std(coefficient: str, criteria: PriorCriteria | None = None) -> float:
    """Smallest prior standard deviation of a derivative; a relative uncertainty means nothing near zero."""
    known = criteria or PriorCriteria()
    return known.stated * known.typical.of(coefficient)


def derivative_std(flight: Stated, model: Model, name: str) -> float:
    """Prior standard deviation of a derivative or offset.

    It is the one that the file states. A derivative that the file has at zero has the usual size of that derivative. If
    neither is known, the prior is wide, and wider still for a regressor that moves little in these records. The offset
    of an instrument is as large as a bias that matters.
    """
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
    """Factor of a derivative by a rate, if the file does not use half of a reference length to make rates
    dimensionless.
    """
    lengths = {
        "p": (aircraft.moment_length_lateral, aircraft.rate_length_lateral),
        "q": (aircraft.moment_length_pitch, aircraft.rate_length_pitch),
        "r": (aircraft.moment_length_lateral, aircraft.rate_length_lateral),
    }
    length, made_with = lengths.get(term.name, (2.0, 1.0))
    return 0.5 * length / made_with
