"""A first guess of states that no channel measures: what the model, at its start values, makes of what is measured.

A smoother: outputs weigh as if their noise were a twentieth of their range. Every state may wander by ten times its
size over a record, so that a wrong start value does not keep the motion from the data. The size of a state that nobody
measures is that of the model, or as many thousand times more as the readings need to be followed. Where its explicit
steps run off, a stiff system, it is the simulation at the start values by CVODES.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from casid.estimation.cost import OutputError
from casid.estimation.initial_state import InitialState
from casid.estimation.problem import Problem
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.objective import Objective
from casid.estimation.transcriptions.transcription import MultipleShooting, finest_interval
from casid.model.built import cached, share_cache
from casid.model.simulate import cvodes_step, flown, steps_of
from casid.model.system import unguessed_states
from casid.records.record import Record

_NOISE = 0.05  # of a channel's range
_WANDER = 10.0  # sizes of a state over a record
_ITERATIONS = 30
_SECONDS = 600.0
# tolerances of CVODES
_RELATIVE = 1e-6
_ABSOLUTE = 1e-9
_MOTION = 1e-3  # sizes of a state that may be missing between two samples, noise and all
# factors of the size of states, up to fifteen orders of magnitude
_LARGER = 1e3
_TIMES = 5
_FOLLOWED = 1.0  # mean square of residuals in units of the assumed noise: a twentieth of the range


def with_guess(problem: Problem, inner: Problem, deadline: float = math.inf) -> Problem:
    """`inner` with states that neither the records of `problem` nor its model guess where a smoother sees them, which
    begins with what is known of their initial value."""
    if not problem.simulated or problem.feedback is not None or not unguessed_states(problem.model, problem.records):
        return inner
    states = problem.model.states
    known = inner.initial_knowledge[0]
    missing = {}
    table = {}
    for r, (posed, record) in enumerate(zip(problem.records, inner.records, strict=True)):
        own = [i for i, s in enumerate(states) if s not in posed or not np.isfinite(posed[s]).any()]
        missing[record.name], table[record.name] = own, inner.model.guess(record).copy()
        table[record.name][:, own] = np.where(np.isnan(known[r, own]), table[record.name][:, own], known[r, own])
    inner = _guessing(inner, table)
    found = _smoothed(inner, deadline)
    if found is None and time.perf_counter() < deadline:
        found = _simulated(inner)
    if found is None:
        return inner
    for record, own in missing.items():
        table[record][:, own] = found[record][:, own]
    return _guessing(inner, table)


def _guessing(problem: Problem, table: Mapping[str, np.ndarray]) -> Problem:
    """The problem with a guess (N, states) by record."""
    model = replace(problem.model, guess=partial(looked_up, table))
    return replace(problem, model=share_cache(model, problem.model))


def _smoothed(problem: Problem, deadline: float) -> Mapping[str, np.ndarray] | None:
    """Record -> (N, states) at the start values of a problem; None where the model has no motion there. With the
    smallest sizes of the states with which the readings are followed, or else those that come nearest."""
    best = None
    nearest = np.inf
    for k in range(_TIMES + 1):
        if time.perf_counter() > deadline:
            break
        found, square = _smoothed_at(problem, _LARGER**k, deadline)
        if square < nearest:
            best = found
            nearest = square
        if nearest < _FOLLOWED or (best is not None and square > 0.99 * nearest and k > 1 and found is not best):
            break
    return best


def _smoothed_at(problem: Problem, larger: float, deadline: float) -> tuple[Mapping[str, np.ndarray] | None, float]:
    """Smooth as `_smoothed`, with states so many times larger than the model states, and give the mean square of the
    residuals."""
    model = problem.model
    # in continuous time noise gathers over a record's duration, in discrete time over its samples
    duration = max(len(r) if model.period is not None else r.duration for r in problem.records)
    smoothing = Problem(
        model,
        problem.records,
        fixed=_values(problem),
        cost=OutputError(),
        noise={name: _twentieth(problem.records, name) for name in model.outputs},
        initial_state=_with_sizes(problem, larger),
    )
    wander = {s: larger * _WANDER * model.state_scale[s] / np.sqrt(duration) for s in model.states}
    method = MultipleShooting(interval=finest_interval(problem), process_noise=wander, substeps=1)
    seconds = min(max(deadline - time.perf_counter(), 1e-3), _SECONDS)
    try:
        objective = Objective(smoothing, method.dynamics(smoothing))
        outcome = GaussNewton(iterations=_ITERATIONS, seconds=seconds).minimise(objective)
    except np.linalg.LinAlgError:
        return None, np.inf
    trajectory = outcome.value.trajectory
    levels = outcome.value.noise.levels
    if trajectory is None or not (np.isfinite(trajectory.states).all() and outcome.value.worst() < _MOTION * larger):
        return None, np.inf
    flat = trajectory.states.reshape(-1, len(model.states))
    square = 2.0 * levels.cost(outcome.value.squares) / levels.count
    return {r.name: flat[own] for r, own in zip(problem.records, objective.layout.sample, strict=True)}, square


def _with_sizes(problem: Problem, larger: float) -> InitialState:
    """Return the given knowledge of initial states, with a deviation of so many sizes for the others."""
    given = problem.initial_state
    model = problem.model
    known = {name.split("[")[0] for name in given.std}
    sizes = {s: larger * model.state_scale[s] for s in model.states if s not in known}
    return replace(given, std={**given.std, **sizes})


def _simulated(problem: Problem) -> Mapping[str, np.ndarray] | None:
    """Record -> (N, states) from the first row of the model's guess, by an implicit method of variable order."""
    model = problem.model
    if model.period is not None:
        return None
    step = cached(model, ("implicit step",), lambda: cvodes_step(model, _RELATIVE, _ABSOLUTE))
    known = problem.initial_knowledge[0]
    run = steps_of(step)
    found = {}
    for r, (record, p) in enumerate(zip(problem.records, problem.start_parameters, strict=True)):
        start = np.where(np.isnan(known[r]), model.guess(record)[0], known[r])
        found[record.name] = flown(model, record, start, p, np.zeros((len(record), len(model.disturbances))), run)
    return found if all(np.isfinite(x).all() for x in found.values()) else None


def looked_up(table: Mapping[str, np.ndarray], record: Record) -> np.ndarray:
    """A `Model.guess` that was made before, record name -> (N, states)."""
    return table[record.name]


def _values(problem: Problem) -> dict[str, float]:
    """Every parameter at its start, by record."""
    values = problem.start_parameters
    return {
        f"{name}[{record.name}]": float(values[r, i])
        for r, record in enumerate(problem.records)
        for i, name in enumerate(problem.model.parameters)
    }


def _twentieth(records: Sequence[Record], name: str) -> float:
    """Return a twentieth of the range of a channel over all records; a nominal size if it is constant or missing."""
    read = np.concatenate([record[name] for record in records if name in record] or [np.zeros(0)])
    read = read[np.isfinite(read)]
    if not len(read):
        return _NOISE
    spread = float(read.max() - read.min())
    return _NOISE * (spread if spread > 0.0 else max(abs(float(read[0])), 1e-6))
