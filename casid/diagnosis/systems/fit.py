"""Preparation of a model for its records: noise of the readings, initial states, and the first fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.criterion import in_time
from casid.diagnosis.flight.evaluation import FlightFit, Work, evaluate
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.systems import size
from casid.diagnosis.systems.criteria import SystemCriteria
from casid.diagnosis.systems.library import Library, effects_of
from casid.diagnosis.systems.plant import Plant, as_flight, motions
from casid.errors import EstimationError, InputError
from casid.estimation import Problem, solve
from casid.model.port import ModelPort as Port
from casid.model.system import Model
from casid.records.noise import pooled_sigma
from casid.records.record import Record


def plant_of(
    model: Model, records: Sequence[Record], ports: Sequence[Port], library: Library, criteria: Criteria
) -> Plant:
    """A model and the records to be fitted. Priors of 0 become fixed values, and a state is as large as it is measured.

    Raises InputError for an output that no record has, and for a model without a free parameter."""
    free = tuple(name for name in model.parameters if model.prior_std.get(name) != 0.0)
    if not free:
        raise InputError(f"model '{model.name}' has no free parameter; give at least one a prior above 0, or none")
    guess = np.concatenate([model.guess(record) for record in records])
    seen = dict(zip(model.states, np.sqrt(np.mean(guess**2, axis=0)).tolist(), strict=True))
    base = replace(
        model,
        prior_std={name: std for name, std in model.prior_std.items() if std > 0.0},
        state_scale={name: seen[name] or scale for name, scale in model.state_scale.items()},
    )
    by = criteria.systems
    sigma = noise_of(base, records, by)
    return Plant(
        base=base,
        freed=free,
        ports=tuple(ports),
        records=tuple(records),
        sigma=sigma,
        terms_of=library.terms(base),
        criteria=_for_systems(criteria, float(np.median([record.duration for record in records]))),
        paths=motions(base, records, sigma, by.smoothed),
        effects=effects_of(library, base, ports, records, free, by),
        sizes=size,
    )


def _for_systems(criteria: Criteria, duration: float) -> Criteria:
    """The criteria with times as long as the records of a system, which last a `duration` [s], are to those of an
    aircraft, and with as wide a search as its quick fits allow."""
    by = criteria.systems
    naming = {
        "trials": by.trials,
        "further_trials": by.further_trials,
        "terms": by.terms,
        "trial_iterations": by.iterations,
    }
    wider = in_time(criteria, duration / by.record)
    return wider.with_values({"numerics": {"naming": naming}, "naming": {"give_up": by.give_up}})


def noise_of(model: Model, records: Sequence[Record], criteria: SystemCriteria) -> dict[str, float]:
    """Output -> 1-sigma, from the band above the motion; for records that are too short for that, from a fit of the
    model.

    Raises InputError for an output that no record has.
    """
    found = {}
    for name in model.outputs:
        series = [r[name] for r in records if name in r]
        there = [s[np.isfinite(s)] for s in series if np.isfinite(s).any()]
        if not there:
            raise InputError(
                f"no record has the output '{name}' of '{model.name}'; add the channel, or drop the output"
            )
        least = max(criteria.smallest_noise * float(np.std(np.concatenate(there))), 1e-12)
        sigma = pooled_sigma(there)
        found[name] = max(sigma, least) if np.isfinite(sigma) else np.nan
    if not np.isfinite(list(found.values())).all():
        fitted = solve(Problem(model, records, free=["*"], prior=True))
        found = {name: sigma if np.isfinite(sigma) else fitted.noise[name] for name, sigma in found.items()}
    return found


def first_fit(plant: Plant) -> FlightFit:
    """The model with re-estimated parameters.

    The fit may diverge if the model lacks a large effect. It is then repeated with noise as large as the residual,
    which keeps the parameters near their priors, and once more from there. If that does not converge either, its last
    point is used.

    Raises EstimationError for a model that cannot follow its records at all.
    """
    flight = as_flight(plant)
    try:
        plain = fit(flight, (), plant.noise(), iterations=20)
    except InputError as error:
        raise EstimationError(
            f"model '{plant.title}' cannot be fitted to these records from its nominal values: {error}"
        ) from None
    if plain.converged:
        return plain
    left = float(np.sqrt(np.sum(plain.white**2) / plain.readings))
    noise = replace(plant.noise(), measurement={name: left * sigma for name, sigma in plant.sigma.items()})
    wide = fit(flight, (), noise, iterations=30)
    again = fit(flight, (), plant.noise(), wide, iterations=20)
    if again.converged:
        return again
    return evaluate(Work(flight, (), plant.noise(), "all"), (), wide.values, wide.motion)
