"""What is known of the parameters before the records: as the aircraft file states it, and nothing that it does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.criteria import PriorCriteria
from casid.diagnosis.flight.flight import Flight
from casid.model.causes import sensor_bias
from casid.model.system import Model
from casid.model.terms import derivative_term

OFFSET = "bias_"  # and the channel: parameter of a model


def prior(flight: Flight, model: Model, names: Sequence[str | None]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and inverse variance of what is fitted; effects, and what has no name among the parameters, have none."""
    mean, weight = np.zeros(len(names)), np.zeros(len(names))
    of_the_file = flight.model().parameters
    for i, name in enumerate(names):
        if name in of_the_file:
            mean[i] = model.nominal[name]
            weight[i] = _std(flight, model, name, abs(mean[i])) ** -2.0
    return mean, weight


def smallest_stated_std(coefficient: str, criteria: PriorCriteria | None = None) -> float:
    """Least uncertainty of a derivative: what is stated relative to one near zero says nothing."""
    known = criteria or PriorCriteria()
    return known.stated * known.typical.of(coefficient)


def _std(flight: Flight, model: Model, name: str, size: float) -> float:
    """1-sigma as the file states it, or so loose that it says nothing: of a derivative that the file has at zero, by
    what its regressor does in these records. An offset of an instrument is small beside what matters as a cause."""
    if name.startswith(OFFSET):
        channel = name.removeprefix(OFFSET)
        return float(sensor_bias(channel).smallest_that_matters(flight.aircraft) or np.inf)
    known = flight.criteria.prior
    if name in flight.aircraft.knots:
        return model.prior_std.get(name, known.spread * max(size, known.typical.of(flight.aircraft.knots[name])))
    coefficient, term = derivative_term(name)
    smallest = known.typical.of(coefficient)
    if name in model.prior_std:
        return max(model.prior_std[name], smallest_stated_std(coefficient, known))
    if size > 0.0 or not term.factors:
        return known.spread * max(size, smallest)
    moves = max(flight.regressors(model).variation(term), known.resting)
    return known.spread * smallest * max(1.0, known.regressor / moves)
