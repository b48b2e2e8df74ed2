"""Fly a model: states and outputs along given inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from casid.arguments import given, listed, number, numbers_by_name, one_of, require, table_of, whole
from casid.errors import InputError, check_known
from casid.model.built import compiled
from casid.model.expressions import origin
from casid.model.splines import cubic_inputs, splined, with_splines
from casid.model.system import Model, check_continuous, check_period, runge_kutta
from casid.model.timeline import between_samples, check_events, timeline
from casid.model.with_effects import as_written, at_own_times
from casid.native.compiler import Compilable
from casid.records.given import given_record
from casid.records.record import Record

# (state, inputs and disturbances before and after each step, durations, parameters) -> states after each step
Run = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
INTEGRATORS = ("runge-kutta", "cvodes")
_CLOSE = 1e-11  # relative tolerance of CVODES in a step, and absolute in sizes of the smallest state
_MOST_STEPS = 100_000  # of CVODES between two samples
_SLAB_SAMPLES = 4096  # that CasADi holds at once


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Simulation:
    """A simulated motion.

    Attributes
    ----------
    model
        What was simulated.
    record
        Its time stamps t (N,) and inputs.
    states, outputs
        (N, states) and (N, outputs) at the time stamps.

    Examples
    --------
    After the example of `simulate`:

    >>> simulation.state("x").shape, simulation.as_record("flown").name
    ((200,), 'flown')
    """

    model: Model
    record: Record
    states: np.ndarray
    outputs: np.ndarray

    def state(self, name: str) -> np.ndarray:
        """(N,) one state; raises InputError for a name that the model does not have."""
        check_known("state", (name,), self.model.states, f"simulation of '{self.model.name}'")
        return self.states[:, self.model.states.index(name)]

    def output(self, name: str) -> np.ndarray:
        """(N,) one output; raises InputError for a name that the model does not have."""
        check_known("output", (name,), self.model.outputs, f"simulation of '{self.model.name}'")
        return self.outputs[:, self.model.outputs.index(name)]

    def __repr__(self) -> str:
        model = self.model
        t = self.record.t
        return (
            f"<Simulation of '{model.name}' on record '{self.record.name}': {len(t)} samples, {t[0]:g} to {t[-1]:g} s; "
            f"states {listed(model.states)}; outputs {listed(model.outputs)}>"
        )

    def as_record(self, name: str | None = None) -> Record:
        """The record with its measured outputs replaced by the simulated ones, under its own name or another."""
        flown = self.record.with_channels(**{o: self.outputs[:, i] for i, o in enumerate(self.model.outputs)})
        return flown.renamed(name or self.record.name)


def simulate(
    model: Model,
    record: Record | str | Path,
    start: np.ndarray | Sequence[float] | Mapping[str, float],
    values: Mapping[str, float] | None = None,
    disturbances: Mapping[str, np.ndarray] | None = None,
    substeps: int = 1,
    integrator: str = "runge-kutta",
) -> Simulation:
    """Integrate by Runge-Kutta of fourth order, `substeps` per sample; inputs run between samples as the record states.

    A model in discrete time goes from sample to sample by its own equations.

    Or by CVODES of SUNDIALS: implicit, of variable order and step, to 1e-11 of a state. It is slower, and owes nothing
    to the steps that an estimation takes: what a fit's own parameters and initial state give by it checks the fit.

    Parameters
    ----------
    model
        Of the aircraft or any other system.
    record
        With the model's inputs, or the file of one.
    start
        (states,) state at the first sample, in the order of `model.states`; or a table, state -> value.
    values
        Parameters by name, put over the model's nominal values.
    disturbances
        Known time histories (N,) of disturbances by name; the others are zero.
    substeps
        Steps of integration per sample, by Runge-Kutta.
    integrator
        "runge-kutta" or "cvodes".

    Returns
    -------
    Simulation
        States (N, states) and outputs (N, outputs) at the record's time stamps; `as_record()` makes a record of it.

    Raises
    ------
    InputError
        For an argument that does not fit, and when the motion leaves the range of numbers: it names the state, the time
        and the expression.

    Examples
    --------
    After the example of `define_model`:

    >>> t = 0.02 * np.arange(200)
    >>> step = cs.Record(name="step", t=t, channels={"u": np.where(t > 0.5, 1.0, 0.0)})
    >>> simulation = cs.simulate(lag, step, [0.0], {"T": 0.25})
    >>> simulation.outputs.shape, round(float(simulation.output("y")[-1]), 3)
    ((200, 1), 1.0)
    """
    require(model, Model, "simulate: model", "cs.aircraft_model(aircraft) or cs.define_model(...)")
    flown_as = given_record(record, "simulate")
    record = model.ready(flown_as, numbers_by_name(values or {}, "simulate: values"))
    start = _start(model, start)
    whole(substeps, "simulate: substeps")
    by_cvodes = one_of(integrator, INTEGRATORS, "simulate: integrator") == "cvodes"
    if by_cvodes or substeps > 1:
        check_continuous(model, "simulate: steps of integration")
    n = len(record)
    check_period(model, record)
    _check_inputs(model, record)
    curved = cubic_inputs(model, [record])
    if curved:
        check_continuous(model, "simulate: inputs that are cubic between samples")
        inner = with_splines(model, curved)
        along = splined(record, curved)
        found = simulate(inner, along, start, values, disturbances, substeps, integrator)
        return Simulation(model=model, record=flown_as, states=found.states, outputs=found.outputs)
    W = np.zeros((n, len(model.disturbances)))
    for name, series in table_of(disturbances or {}, "simulate: disturbances", "{'gust_z': series}").items():
        check_known("disturbance", (name,), model.disturbances, f"simulate: model '{model.name}'")
        W[:, model.disturbances.index(name)] = _series(series, f"simulate: disturbance '{name}'", n)
    p = model.nominal_vector(numbers_by_name(values or {}, "simulate: values"))
    check_events(model, [record], "simulate")
    states = flown(model, record, start, p, W, _by_cvodes(model) if by_cvodes else _by_runge_kutta(model, substeps))
    U = record.matrix(model.inputs)
    UW = np.hstack([U, W])
    if not np.isfinite(states).all():
        raise InputError(_why_it_diverged(model, record, states, UW, p))
    output = compiled(model, _output)
    outputs = np.empty((n, len(model.outputs)))
    for own in _slabs(n):
        count = own.stop - own.start
        with output.lock:
            outputs[own] = output.mapped(count)(states[own], U[own], np.tile(p, (count, 1)), W[own])[0]
    if not np.isfinite(outputs).all():
        k, i = np.argwhere(~np.isfinite(outputs))[0]
        at = {"x": states[k], "u": U[k], "p": p, "w": W[k]}
        raise InputError(
            f"simulation of '{model.name}' on record '{record.name}': output '{model.outputs[i]}' is no number at "
            f"t = {record.t[k]:.2f} s: {origin(model.h[int(i)], model.vectors, at)}"
        )
    flown_as, outputs = as_written(model, flown_as, at_own_times(model, record, outputs, values))
    return Simulation(model=model, record=flown_as, states=states, outputs=outputs)


def _start(model: Model, start: object) -> np.ndarray:
    order = ", ".join(model.states)
    if isinstance(start, Mapping):
        check_known("state", start, model.states, "simulate: start")
        missing = [name for name in model.states if name not in start]
        if missing:
            raise InputError(f"simulate: start has no {', '.join(missing)}; give a value of each state: {order}")
        start = [start[name] for name in model.states]
    state = _floats(start, "simulate: start", f"{len(model.states)} numbers: {order}")
    if state.shape != (len(model.states),):
        raise InputError(f"simulate: start has the shape {state.shape}; expected {len(model.states)} numbers: {order}")
    for name, value in zip(model.states, state.tolist(), strict=True):
        number(value, f"simulate: start of '{name}'")
    return state


def _floats(value: object, what: str, expected: str) -> np.ndarray:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what} is {given(value)}; expected {expected}") from None


def _check_inputs(model: Model, record: Record) -> None:
    for name in model.inputs:
        bad = np.flatnonzero(~np.isfinite(record[name]))
        if len(bad):
            raise InputError(
                f"record '{record.name}': input '{name}' has no value at t = {record.t[bad[0]]:g} s ({len(bad)} "
                "samples); fill the gaps"
            )


def _series(series: object, what: str, n: int) -> np.ndarray:
    values = _floats(series, what, f"{n} numbers, one for each sample")
    if values.shape not in ((n,), ()):
        raise InputError(f"{what} has the shape {values.shape}; expected ({n},), one number for each sample")
    if not np.isfinite(values).all():
        raise InputError(f"{what} has values that are no numbers; expected finite ones")
    return values


def _why_it_diverged(model: Model, record: Record, states: np.ndarray, UW: np.ndarray, p: np.ndarray) -> str:
    """The error of a motion that left the range of numbers: the derivative that did, or the state that grew."""
    k = int(np.argmin(np.isfinite(states).all(axis=1))) - 1  # the last sample that is all numbers
    moved = "derivative" if model.period is None else "next value"
    head = f"simulation of '{model.name}' on record '{record.name}' diverged at t = {record.t[k + 1]:.2f} s"
    f = Compilable(ca.Function("f", [model.x, ca.vertcat(model.u, model.w), model.p], [ca.densify(model.f)]))
    x = states[k]
    dt = record.t[k + 1] - record.t[k]
    nu = len(model.inputs)

    def slope_at(x: np.ndarray) -> np.ndarray:
        return f.mapped(1)(x[None], UW[k][None], p[None])[0][0].copy()

    slope = slope_at(x)
    for part in (0.0, 0.5, 1.0) if model.period is None else (0.0,):  # about where the step asks for derivatives
        at = {"x": x + part * dt * np.where(np.isfinite(slope), slope, 0.0), "u": UW[k, :nu], "p": p, "w": UW[k, nu:]}
        if not np.isfinite(at["x"]).all() or np.isfinite(slope_at(at["x"])).all():
            continue
        for i, name in enumerate(model.states):
            if found := origin(model.f[i], model.vectors, at):
                return f"{head}: the {moved} of '{name}' is no number: {found}"
    largest = int(np.argmax(np.abs(x) / model.scale_vector()))
    return f"{head}: '{model.states[largest]}' had grown to {x[largest]:.3g}; check start, parameters and their units"


def flown(model: Model, record: Record, start: np.ndarray, p: np.ndarray, W: np.ndarray, run: Run) -> np.ndarray:
    """(N, states) at the samples, from a start (states,) with parameters p and disturbances W (N, disturbances); not
    finite from where the motion ends."""
    line = timeline(model, record)
    names = (*model.inputs, *model.disturbances)
    held = np.array([record.hold_of(name) == "held" for name in names], dtype=bool)
    before = between_samples(record, line, np.hstack([record.matrix(model.inputs), W]), held)
    after = np.where(held, before[:-1], before[1:])
    dt = np.diff(line.t)
    states = np.full((len(line.t), len(start)), np.nan)
    state = start
    at = 0
    states[0] = state
    for row, event in (*line.jumps, (len(line.t) - 1, None)):
        if row > at:
            steps = slice(at, row)
            states[at + 1 : row + 1] = run(state, before[steps], after[steps], dt[steps], p)
            state = states[row]
            at = row
        if event is not None:
            jump = ca.Function("jump", [model.x, model.u, model.p], [model.events[event]])
            state = states[row] = jump(state, before[row, : len(model.inputs)], p).full()[:, 0]
    return states[line.sample]


def _by_runge_kutta(model: Model, substeps: int) -> Run:
    step = compiled(model, _step, substeps)

    def run(state: np.ndarray, before: np.ndarray, after: np.ndarray, dt: np.ndarray, p: np.ndarray) -> np.ndarray:
        states = np.empty((len(dt), len(state)))
        for own in _slabs(len(dt)):
            count = own.stop - own.start
            with step.lock:  # two threads may fly one model
                fly = step.accumulated(count, 1)
                states[own] = fly(state[None], before[own], after[own], dt[own], np.tile(p, (count, 1)))[0]
            state = states[own.stop - 1]
        return states

    return run


def _slabs(count: int) -> Iterator[slice]:
    """Spans of samples that CasADi takes in one call: its memory grows with them by about 1.5 kB each."""
    for first in range(0, count, _SLAB_SAMPLES):
        yield slice(first, min(first + _SLAB_SAMPLES, count))


def _by_cvodes(model: Model) -> Run:
    return steps_of(cvodes_step(model, _CLOSE, _CLOSE * float(model.scale_vector().min(initial=1.0))))


def steps_of(advance: ca.Function) -> Run:
    """The steps of a `cvodes_step`, not finite from where it gives up."""

    def run(state: np.ndarray, before: np.ndarray, after: np.ndarray, dt: np.ndarray, p: np.ndarray) -> np.ndarray:
        states = np.full((len(dt), len(state)), np.nan)
        for k in range(len(dt)):
            try:
                state = advance(x0=state, p=np.concatenate([before[k], after[k], [dt[k]], p]))["xf"].full()[:, 0]
            except RuntimeError:
                break
            states[k] = state
        return states

    return run


def cvodes_step(model: Model, relative: float, absolute: float) -> ca.Function:
    """Integrate from sample to sample by CVODES to these tolerances: x0, p = (u, w before, u, w after, dt, parameters)
    -> xf."""
    both = len(model.inputs) + len(model.disturbances)
    before, after = (ca.SX.sym(name, both) for name in ("before", "after"))
    dt = ca.SX.sym("dt")
    share = ca.SX.sym("share")
    f = ca.Function("f", [model.x, ca.vertcat(model.u, model.w), model.p], [model.f])
    slope = dt * f(model.x, before + share * (after - before), model.p)
    dae = {"x": model.x, "p": ca.vertcat(before, after, dt, model.p), "t": share, "ode": slope}
    quietly = {"show_eval_warnings": False, "disable_internal_warnings": True}
    options = {"reltol": relative, "abstol": absolute, "max_num_steps": _MOST_STEPS, **quietly}
    return ca.integrator("implicit", "cvodes", dae, 0.0, 1.0, options)


def _output(model: Model) -> ca.Function:
    """(x, u, p, w) -> outputs."""
    return ca.Function("output", [model.x, model.u, model.p, model.w], [ca.densify(model.h)])


def _step(model: Model, substeps: int) -> ca.Function:
    """(x, [u; w] at a sample, at the next, dt, p) -> state at the next."""
    nu = len(model.inputs)
    f = ca.Function("f", [model.x, ca.vertcat(model.u, model.w), model.p], [model.f])
    x = ca.SX.sym("x", len(model.states))
    dt = ca.SX.sym("dt")
    first, last = (ca.SX.sym(name, nu + len(model.disturbances)) for name in ("first", "last"))
    state = x
    h = dt / substeps
    if model.period is not None:
        state = f(x, first, model.p)
    for k in range(substeps if model.period is None else 0):
        inputs = [first + (last - first) * (k + part) / substeps for part in (0.0, 0.5, 1.0)]
        state = runge_kutta(f, state, inputs, h, model.p)
    return ca.Function("step", [x, first, last, dt, model.p], [ca.densify(state)])
