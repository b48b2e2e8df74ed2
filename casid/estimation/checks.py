"""Checks of what a caller gives to `Problem` and `solve`: an InputError with what to write instead."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import given, number, numbers_by_name, require, table_of
from casid.errors import EstimationError, InputError, unknown
from casid.estimation.constraints import Constraint, LinearConstraint, NonlinearConstraint, PathConstraint
from casid.estimation.cost import RangeWeights
from casid.estimation.initial_state import InitialState
from casid.estimation.noise import Huber, Noise, StudentT
from casid.model.aircraft import Aircraft
from casid.model.expressions import Symbols, expressions
from casid.model.feedback import SampledFeedback
from casid.model.path import INPUTS, STATES
from casid.model.system import Model, check_continuous, check_period
from casid.model.timeline import check_events
from casid.records.record import Record


def check_model(model: Any) -> None:
    """Raise InputError unless it is a model."""
    if isinstance(model, Aircraft):
        raise InputError(
            "Problem: model is an Aircraft; write cs.aircraft_model(aircraft), with records that are "
            "cs.flight_inputs(aircraft, record)"
        )
    require(model, Model, "Problem: model", "cs.aircraft_model(aircraft) or cs.define_model(...)")
    of_effects = {name for one in model.effects for name in one.parameters}
    for name in (*model.parameters, *model.states):
        if "[" in name and name not in of_effects:
            raise InputError(
                f"Problem: '{name}' of model '{model.name}' has a bracket, which in an estimation says of which record "
                f"a value is; rename it in the model, like '{name.replace('[', '_').replace(']', '')}'"
            )


def check_records(model: Model, records: tuple[Record, ...], simulated: bool) -> None:
    """Raise InputError for records that cannot feed the model, EstimationError where nothing is measured."""
    if not records:
        raise InputError("Problem: no record given")
    own = [record.name for record in records]
    if len(set(own)) != len(own):
        raise InputError(f"Problem: names of records are not unique: {own}")
    check_events(model, records, "Problem")
    for record in records:
        if len(record) < 2:
            raise InputError(f"record '{record.name}': {len(record)} time stamps; expected at least two")
        check_period(model, record)
        _check_finite(model, record)
        for name in model.inputs if simulated else ():
            if name not in record and name != "t":
                raise _missing_input(model, record, name)
            bad = np.flatnonzero(~np.isfinite(record[name]))
            if len(bad):
                raise InputError(
                    f"record '{record.name}': input '{name}' has no value at t = {record.t[bad[0]]:g} s "
                    f"({len(bad)} samples); cut the record there or fill the gap knowingly"
                )
    if simulated and not any(np.isfinite(r[n]).any() for r in records for n in model.outputs if n in r):
        raise EstimationError(f"Problem: no record has a sample of any output of the model {model.outputs}")


def with_measured_states(model: Model, records: tuple[Record, ...], measured: Mapping[str, str]) -> tuple[Record, ...]:
    """The records with each state's measurement under the state's own name too; InputError for a name that is none."""
    where = "Problem: measured"
    for state, channel in table_of(measured, where, "{'al': 'alpha_vane'}").items():
        if state not in model.states:
            raise unknown("state", str(state), model.states, where)
        for record in records:
            if channel not in record:
                raise unknown("channel", str(channel), record.channels, f"{where}: record '{record.name}'")
    if not measured:
        return records
    return tuple(r.with_channels(**{state: r[channel] for state, channel in measured.items()}) for r in records)


def _check_finite(model: Model, record: Record) -> None:
    """Raise InputError for an infinite reading; NaN is a missing one."""
    further = model.equation.channels if model.equation is not None else ()
    for name in dict.fromkeys((*model.outputs, *model.states, *model.inputs, *further)):
        if name in record:
            infinite = np.flatnonzero(np.isinf(record[name]))
            if len(infinite):
                raise InputError(
                    f"record '{record.name}': '{name}' is {record[name][infinite[0]]:g} at t = "
                    f"{record.t[infinite[0]]:g} s ({len(infinite)} samples); expected numbers, or NaN where missing"
                )


def _missing_input(model: Model, record: Record, name: str) -> InputError:
    if name in STATES and set(model.inputs) >= set(INPUTS):
        axes = "longitudinal" if "q" in model.states else "lateral"
        return InputError(
            f"record '{record.name}': input '{name}' is missing, a state that the {axes} model does not move; write "
            f"cs.flight_inputs(aircraft, record, '{axes}')"
        )
    if set(model.inputs) >= set(INPUTS) and name in INPUTS:
        return InputError(
            f"record '{record.name}': input '{name}' of the aircraft's model is missing; write "
            "cs.flight_inputs(aircraft, record), which fills it in where that is possible"
        )
    return unknown("channel", name, record.channels, f"record '{record.name}': input of '{model.name}'")


def check_start(start: Any, valid: Sequence[str]) -> None:
    """Raise InputError for a start value that is no number, or is one of nothing that is free."""
    for name in numbers_by_name(start, "Problem: start"):
        if name not in valid:
            raise unknown("parameter", name, valid, "Problem: start")


def with_prior(model: Model, prior: Any, free: Sequence[str]) -> Model:
    """Return the model with given means and 1-sigmas as what is known before, and nothing else. Raises InputError for
    what is no table of free parameters and such pairs."""
    where = "Problem: prior"
    nominal = dict(model.nominal)
    std = {}
    for name, pair in table_of(prior, f"{where} (True, False or a table)", "{'Cm_q': (-12.0, 2.0)}").items():
        if name not in free:
            raise unknown("free parameter", name, free, where)
        if isinstance(pair, str) or np.shape(pair) != (2,):
            raise InputError(f"{where}: '{name}' is {given(pair)}; expected its mean and 1-sigma, (-12.0, 2.0)")
        nominal[name] = number(pair[0], f"{where}: mean of '{name}'")
        std[name] = number(pair[1], f"{where}: 1-sigma of '{name}'", positive=True)
    return replace(model, nominal=nominal, prior_std=std)


def check_of_records(
    what: str, table: Mapping[str, Any], kind: str, valid: Sequence[str], records: Sequence[str]
) -> None:
    """Raise InputError for a name that is none, or has what is no record behind it."""
    for name in table:
        bare, _, rest = (name, "", "") if name in valid else name.rpartition("[") if "[" in name else (name, "", "")
        if bare not in valid:
            raise unknown(kind, bare, valid, f"Problem: {what}")
        if rest and rest.removesuffix("]") not in records:
            raise unknown("record", rest.removesuffix("]"), records, f"Problem: {what} '{name}'")
        everywhere = bare in table or all(f"{bare}[{record}]" in table for record in records)
        if what == "fixed" and not everywhere:
            missing = next(record for record in records if f"{bare}[{record}]" not in table)
            raise InputError(
                f"Problem: fixed has '{name}' and not '{bare}[{missing}]'; give all records a value, or hold this one "
                f"by cs.limit_combination({{'{name}': 1.0}}, lower={table[name]:g}, upper={table[name]:g})"
            )


def check_initial_state(model: Model, initial: InitialState, records: Sequence[str]) -> None:
    """Raise InputError for what is no state or no number, and for a value that the model gives already."""
    values = numbers_by_name(initial.value, "Problem: initial_state value")
    for what, table in (("value", values), ("std", initial.std)):
        check_of_records(f"initial_state {what}", table, "state", model.states, records)
    for name in values:
        if name.partition("[")[0] in model.initial:
            raise InputError(
                f"Problem: initial_state gives '{name}' a value, and the model's `initial` another; leave one out"
            )
    for name, std in numbers_by_name(initial.std, "Problem: initial_state std").items():
        if std < 0.0:
            raise InputError(f"Problem: initial_state std of '{name}' is {std:g}; expected 0 (exact) or a 1-sigma")


def check_spread(spread: Any, local: Sequence[str], records: Sequence[str]) -> None:
    """Raise InputError for a spread of what does not differ between records, or that is no size."""
    where = "Problem: spread"
    for name, size in table_of(spread, where, "{'Cm_q': 2.0}").items():
        if name not in local:
            raise unknown("per-record parameter", str(name), local, where)
        if len(records) < 2:
            raise InputError(f"{where}: '{name}' has one record; a spread is one between records, give two or more")
        if size != np.inf:
            number(size, f"{where}: '{name}'", positive=True)


def check_noise(noise: Any, model: Model) -> None:
    """Raise InputError for what is no noise."""
    if noise is None or isinstance(noise, RangeWeights | StudentT | Huber):
        return
    if isinstance(noise, str):
        if noise != "full":
            raise unknown("noise", noise, ("full",), "Problem")
    elif isinstance(noise, np.ndarray):
        count = len(model.outputs)
        if noise.shape != (count, count):
            raise InputError(f"Problem: noise has the shape {noise.shape}; expected the covariance ({count}, {count})")
        sigma = np.sqrt(np.maximum(np.diagonal(noise), 0.0))
        sound = np.isfinite(noise).all() and (sigma > 0.0).all() and np.allclose(noise, noise.T, rtol=1e-9, atol=0.0)
        if not sound or np.linalg.eigvalsh(noise / np.outer(sigma, sigma))[0] < 1e-12:
            raise InputError("Problem: noise is no covariance; expected a symmetric positive definite matrix")
    elif isinstance(noise, Mapping):
        for name, sigma in noise.items():
            if not isinstance(sigma, str | Noise):
                number(sigma, f"Problem: noise of '{name}'", positive=True)
    else:
        like = ", ".join(f"'{name}': 0.01" for name in model.outputs[:2])
        raise InputError(
            f"Problem: noise is {given(noise)}; expected None, a table {{{like}}}, 'full', RangeWeights(), StudentT() "
            "or Huber()"
        )


_CONSTRAINTS = (LinearConstraint, NonlinearConstraint, PathConstraint)


def check_constraints(constraints: Any) -> tuple[Constraint, ...]:
    """Constraints as a tuple; one alone is a list of one."""
    if isinstance(constraints, _CONSTRAINTS):
        return (constraints,)
    several = getattr(constraints, "ndim", hasattr(constraints, "__iter__"))
    if isinstance(constraints, (str, Mapping)) or not several:
        raise InputError(f"Problem: constraints is {given(constraints)}; write [cs.limit_parameter('Cm_q', upper=0.0)]")
    for one in constraints:
        require(
            one,
            _CONSTRAINTS,
            "Problem: a constraint",
            "cs.limit_parameter(...), cs.limit_combination(...), cs.limit_function(...) or cs.limit_trajectory(...)",
        )
    return tuple(constraints)


def check_function(constraint: NonlinearConstraint, model: Model, free: Sequence[str]) -> None:
    """Raise InputError for a function of unknown names or of no free parameter."""
    expression = parameter_function(constraint.function, model)
    used = ca.which_depends(expression, model.p, 1, False)
    if not any(name in free for name, uses in zip(model.parameters, used, strict=True) if uses):
        raise InputError(
            f"Problem: a nonlinear constraint contains no free parameter; expected a function of {', '.join(free)}"
        )


def parameter_function(function: Callable[[Any], Any], model: Model) -> ca.SX:
    """The expression of a user's function of the model's parameters. Raises InputError for what is none."""
    where = "nonlinear constraint"
    space = Symbols(f"{where}: parameters", {name: model.p[i] for i, name in enumerate(model.parameters)})
    return expressions(lambda s: {"value": function(s)}, space, ("value",), "function", where)


def check_feedback(feedback: Any, model: Model) -> None:
    """Raise InputError for what is no feedback, EstimationError for that of another model."""
    if feedback is None:
        return
    check_continuous(model, "Problem: a control law in the loop")
    require(feedback, SampledFeedback, "Problem: feedback", "cs.SampledFeedback(model=model, received=...)")
    if feedback.model.x is not model.x or feedback.model.u is not model.u:
        raise EstimationError("Problem: the feedback was made for another model; make it with this one's x and u")
