"""What is known of the parameters before the records: as the aircraft file states it, and nothing that it does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.flight.flight import Flight
from casid.model.causes import sensor_bias
from casid.model.system import Model
from casid.model.terms import derivative_term

OFFSET = "bias_"  # and the channel: parameter of a model
_LOOSE = 3.0  # 1-sigma of a derivative without a stated one, relative to its size
# and least size of one that is anywhere near zero, per unit of its regressor
_SMALLEST = {"CL": 0.3, "CD": 0.05, "CX": 0.05, "CZ": 0.3, "CY": 0.1, "Cl": 0.02, "Cm": 0.1, "Cn": 0.02}
_TYPICAL, _RESTS = 0.1, 1e-3  # variation of a regressor for which that is meant, and one that is noise
_LEAST_STATED = 0.1  # of `_SMALLEST`: a relative uncertainty says nothing of a derivative near zero


def prior(flight: Flight, model: Model, names: Sequence[str | None]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and inverse variance of what is fitted; effects, and what has no name among the parameters, have none."""
    mean, weight = np.zeros(len(names)), np.zeros(len(names))
    of_the_file = flight.model().parameters
    for i, name in enumerate(names):
        if name in of_the_file:
            mean[i] = model.nominal[name]
            weight[i] = _std(flight, model, name, abs(mean[i])) ** -2.0
    return mean, weight


def least_stated(coefficient: str) -> float:
    """Least uncertainty of a derivative: what is stated relative to one near zero says nothing."""
    return _LEAST_STATED * _SMALLEST[coefficient]


def _std(flight: Flight, model: Model, name: str, size: float) -> float:
    """1-sigma as the file states it, or so loose that it says nothing: of a derivative that the file has at zero, by
    what its regressor does in these records. An offset of an instrument is small beside what matters as a cause."""
    if name.startswith(OFFSET):
        channel = name.removeprefix(OFFSET)
        return float(sensor_bias(channel).smallest_that_matters(flight.aircraft) or np.inf)
    if name in flight.aircraft.knots:
        return model.prior_std.get(name, _LOOSE * max(size, _SMALLEST[flight.aircraft.knots[name]]))
    coefficient, term = derivative_term(name)
    smallest = _SMALLEST[coefficient]
    if name in model.prior_std:
        return max(model.prior_std[name], least_stated(coefficient))
    if size > 0.0 or not term.factors:
        return _LOOSE * max(size, smallest)
    moves = max(flight.regressors(model).variation(term), _RESTS)
    return _LOOSE * smallest * max(1.0, _TYPICAL / moves)
