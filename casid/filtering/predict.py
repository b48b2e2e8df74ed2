"""A fitted model on a record that the fit may never have seen."""

from __future__ import annotations

from pathlib import Path

from casid.arguments import number
from casid.errors import EstimationError
from casid.estimation.fit import Fit
from casid.filtering.initial_state import fit_initial_state
from casid.model.simulate import Simulation, simulate
from casid.native.singular import singular_is
from casid.native.threads import single_threaded
from casid.records.given import given_record
from casid.records.record import Record


@single_threaded()
@singular_is("predict", "the initial state is not determined by what this record measures")
def predict(fit: Fit, record: Record | str | Path, window_s: float) -> Simulation:
    """The open-loop simulation with the estimates; see `Fit.predict`."""
    record = given_record(record, "predict")
    problem = fit.problem
    number(window_s, "predict: window_s", positive=True)
    if problem.feedback is not None:
        raise EstimationError("predict: a control law in the loop cannot be simulated open-loop")
    values = {**problem.fixed_in(record.name), **{name: fit.values[name] for name in problem.shared}}
    for name in problem.local:
        values[name] = fit.values.get(f"{name}[{record.name}]", problem.model.nominal[name])
    start = fit_initial_state(problem.model, problem.model.ready(record, values), window_s, values)
    return simulate(problem.model, record, start, values)
