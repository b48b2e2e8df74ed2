"""Collect what is known of the parameters of an aircraft: their values and the covariance of their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.acceptance.steady import SteadyFlight
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.model.effects import effect_of


@dataclass(frozen=True, kw_only=True)
class Number:
    """A value, its 1-sigma (NaN where nothing is known of the parameters) and its unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """(parameters,) values of a model's parameters, and (parameters, parameters) covariance of their errors; None where
    they have none."""

    values: np.ndarray
    covariance: np.ndarray | None
    notes: tuple[str, ...] = ()

    def std(self, slope: np.ndarray) -> float:
        """1-sigma of a quantity with these derivatives by the parameters; NaN where nothing is known."""
        if self.covariance is None:
            return float("nan")
        return float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))

    def number(self, value: float, slope: np.ndarray, unit: str) -> Number:
        """Return a number with these derivatives by the parameters."""
        return Number(value=float(value), std=self.std(slope), unit=unit)


def known_by_file(flight: SteadyFlight) -> Known:
    """Return what the file states: the 1-sigmas of its estimates and effects, else `relative_uncertainty`; all
    independent."""
    model = flight.model
    aircraft = flight.aircraft
    of_effects = {effect_of(e).name: e.std for e in aircraft.effects if e.std > 0.0}
    std = {**model.prior_std, **aircraft.std, **of_effects}
    by_name = np.array([std.get(name, 0.0) for name in model.parameters])
    return Known(values=model.nominal_vector(), covariance=np.diag(by_name**2) if by_name.any() else None)


def known_by_diagnosis(flight: SteadyFlight, diagnosis: Diagnosis) -> Known:
    """Return what a diagnosis gives for its extended aircraft: the correlations of the extended model's fit, with
    the corrected standard deviations of the flight, or those of the prior where these are smaller."""
    fitted = diagnosis.extended.fit
    parameters = flight.model.parameters
    # a minor cause that is a term is a term of the file
    terms = {one.name: f"{one.effect.target}_{one.effect.term}" for one in fitted.attached if one.effect.term}
    named = [s.name if s.name in parameters else terms.get(s.name, s.name) for s in fitted.slots]
    ordered = {name: float(flight.model.nominal.get(name, 0.0)) for name in named}
    std = np.sqrt(np.diag(fitted.covariance))
    corrected = np.array([diagnosis.flight[s.name].std for s in fitted.slots])
    with np.errstate(divide="ignore"):
        prior = np.asarray(fitted.prior_weight, dtype=float) ** -0.5
    wider = np.maximum(np.minimum(corrected, prior) / std, 1.0)
    return known_by_estimate(flight, ordered, fitted.covariance * np.outer(wider, wider))


def known_by_estimate(flight: SteadyFlight, values: Mapping[str, float], covariance: np.ndarray) -> Known:
    """Estimated values by name, with the covariance in their order; what was not estimated is exact. Raises InputError
    when none of them is a parameter of this aircraft."""
    model = flight.model
    names: Sequence[str] = list(values)
    shared = [name for name in names if name in model.parameters]
    if not shared:
        raise InputError(
            f"modes: none of the estimates ({', '.join(names[:3])}, ...) is a parameter of '{flight.aircraft.name}'; "
            "give the aircraft that was estimated"
        )
    of = [names.index(n) for n in shared]
    at = [model.parameters.index(n) for n in shared]
    whole = np.zeros((len(model.parameters), len(model.parameters)))
    whole[np.ix_(at, at)] = np.asarray(covariance)[np.ix_(of, of)]
    known = model.nominal_vector({name: values[name] for name in shared})
    notes = () if np.isfinite(whole).all() else ("an estimate has no finite standard deviation: none is given",)
    return Known(values=known, covariance=whole if np.isfinite(whole).all() else None, notes=notes)


def known_by_document(flight: SteadyFlight, document: Mapping[str, Any], where: str) -> Known:
    """Return what an estimate.json gives, which `where` names in errors; InputError for any other file."""
    try:
        correlation = document["correlation"]
        estimates = {name: document["parameters"][name] for name in correlation["names"]}
        key = "std_corrected" if document.get("schema") == "casid.estimate/1" else "std"
        std = np.array([one[key] for one in estimates.values()], dtype=float)  # None: not a number
        matrix = np.array(correlation["matrix"], dtype=float).reshape(len(std), len(std))
        covariance = matrix * std[:, None] * std
        ordered = {name: float(one["value"]) for name, one in estimates.items()}
    except (KeyError, TypeError, ValueError, IndexError):
        raise InputError(
            f"{where}: is no estimate.json of `casid estimate`; expected parameters and correlation"
        ) from None
    return known_by_estimate(flight, ordered, covariance)
