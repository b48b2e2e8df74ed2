"""`solve`: a problem, a transcription and a solver make a fit."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from casid.arguments import require, whole
from casid.estimation.attempt import check_part
from casid.estimation.fit import Fit
from casid.estimation.fitted import StateHistory, channel_fits
from casid.estimation.histories import solved_with_histories
from casid.estimation.integration import Attempt
from casid.estimation.likelihood import judged, log_prior
from casid.estimation.noise import Huber, StudentT
from casid.estimation.noise_formula import solved_with_formulas
from casid.estimation.population import solved_with_population
from casid.estimation.problem import Problem
from casid.estimation.results import final_status
from casid.estimation.robust import solved_robustly
from casid.estimation.solvers.newton import Automatic
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import AnyObjective, OwnObjective, Told
from casid.estimation.solvers.solver import Outcome, Solver, linear_at
from casid.estimation.solvers.timed import Timed, timed
from casid.estimation.starts import best_of, confirmed
from casid.estimation.strategy import ending, usual_of
from casid.estimation.switching import without_switching
from casid.estimation.transcriptions.transcription import MultipleShooting, Transcription, is_implicit
from casid.estimation.uncertainty import Uncertainty
from casid.estimation.working import working
from casid.native.compiler import compiling_until
from casid.native.singular import singular_is
from casid.native.threads import single_threaded

_DEFAULT_METHOD = MultipleShooting()
_DEFAULT_SOLVER = Automatic()
_QUICK = 40  # steps of Gauss-Newton, with which one of many starts is lost or won


@single_threaded()
@singular_is("solve", "parameters or states cannot be told apart; fix one, or give a prior")
def solve(
    problem: Problem,
    method: Transcription = _DEFAULT_METHOD,
    solver: Solver = _DEFAULT_SOLVER,
    *,
    starts: int | None = None,
    seed: int = 0,
) -> Fit:
    """Estimate the free parameters of a problem.

    The three choices are independent: cost (in the problem), transcription, solver; each may be a class of your own
    with the methods of `Cost`, `Transcription`, `Solver`. GaussNewton and Ipopt work alone; Automatic takes what the
    problem needs, and `Fit.solver` names the one that finished. EquationError simulates nothing, so every transcription
    gives the same result with it.

    A course of iteration that goes wrong is not an error: `Fit.status` states it, with `Fit.result`, `Fit.reason` and
    `Fit.remedy` as its parts.

    Parameters
    ----------
    problem
        What is estimated, from which records, by which cost.
    method
        Transcription: SingleShooting(), MultipleShooting(), Collocation() or one of your own.
    solver
        Automatic(), GaussNewton(), Ipopt() or one of your own.
    starts
        How many starts are tried: the problem's own, and others drawn between the limits of each parameter, else as its
        prior is distributed, else within a decade either way. "converged" means a minimum, not the lowest one: several
        starts show whether there are others. With Automatic() those that Gauss-Newton loses give way to further ones,
        up to five times as many, before more is tried from them. By default one, and with up to 30 readings per unknown
        six quick searches more beyond the interval of its end, of which a more likely end is taken; ``starts=1``
        leaves them out.
    seed
        Of these draws.

    Returns
    -------
    Fit
        Estimates, their uncertainties, residuals and the status; of several starts the most likely end, with an account
        of all in `Fit.starts`.

    Raises
    ------
    InputError
        For what is no transcription or solver, and for a parameter without a range of starts.
    EstimationError
        For a combination that cannot work: process noise without a given measurement noise or with EquationError.

    Examples
    --------
    After the example of `simulate`:

    >>> flown = cs.simulate(lag, step, [0.0], {"T": 0.4}).as_record("flown")
    >>> problem = cs.Problem(model=lag, records=[flown], free=["T"], noise={"y": 0.01})
    >>> fit = cs.solve(problem, cs.SingleShooting())
    >>> fit.status, round(fit.values["T"], 3)
    ('converged', 0.4)
    """
    require(problem, Problem, "solve: problem", "cs.Problem(model, records, free=[...])")
    check_part(method, "dynamics", "transcription", "cs.MultipleShooting()")
    check_part(solver, "minimise", "solver", "cs.GaussNewton()")
    clock = timed(solver, time.perf_counter())

    def first(one: Problem) -> Fit:
        return solve(one, method, clock.limited(), starts=starts, seed=seed)

    def again(one: Problem) -> Fit:
        return solve(one, method, clock.limited(), starts=1)

    if problem.model.histories:
        return solved_with_histories(problem, first, again)
    if problem.spread:
        return solved_with_population(problem, first, again)
    if problem.noise_formulas:
        return solved_with_formulas(problem, first, again)
    if isinstance(problem.noise, StudentT | Huber):
        return solved_robustly(problem, problem.noise, first, again)
    usual = None if problem.path_constraints else usual_of(solver)
    quick = usual and replace(usual, iterations=_QUICK, patient=True)
    if starts is None:
        fit = _solved(problem, method, solver)
        if quick is None:
            return fit
        return confirmed(problem, fit, lambda one: _solved(one, method, clock.limited()), clock)
    if whole(starts, "solve: starts") == 1:
        return _solved(problem, method, solver)
    tried = None if quick is None else lambda one: _solved(one, method, quick)
    return best_of(problem, starts, seed, lambda one: _solved(one, method, solver), tried)


def _solved(problem: Problem, method: Transcription, solver: Solver) -> Fit:
    """Solve from the problem's own start."""
    begin = time.perf_counter()
    clock = timed(solver, begin)
    # a trial that departs runs into infinities; what is not finite is refused, so this is no reason for alarm
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"), compiling_until(clock.deadline):
        taken = working(problem, clock.deadline)
        solved, end = _ended(taken.problem, method, solver, clock)
        return taken.returned(replace(_fit(solved, end, method, begin), problem=taken.problem))


def _ended(problem: Problem, method: Transcription, solver: Solver, clock: Timed) -> tuple[Problem, Attempt]:
    """Solve a problem whose motion does not switch; of one that does the one that differs least and has a solution."""
    solved = problem
    end = None
    start = {}
    for one, remark in without_switching(problem):
        further = ending(replace(one, start=start or one.start), method, solver, clock)
        if end is not None and end.found and not further.found:
            break
        solved = one
        end = replace(further, remark="; ".join(filter(None, (remark, further.remark))))
        start = further.values if further.found else {}
    assert end is not None
    return solved, end


def _fit(problem: Problem, end: Attempt, asked: Transcription, begin: float) -> Fit:
    objective: Any = end.objective
    outcome = end.outcome
    method = end.method
    value = outcome.value
    simulated = objective.dynamics is not None
    told = objective.told(value) if isinstance(objective, OwnObjective) else _told(objective, outcome)
    measured = told.measured
    predicted = told.predicted
    likelihood = judged(end)
    if likelihood.outputs is not None:
        predicted = dict(zip(predicted, likelihood.outputs, strict=True))
    names = objective.channel_names
    levels = value.noise.levels
    residuals = {record: measured[record] - predicted[record] for record in measured}
    sigma = levels.rms(value.squares) if levels.proportional else levels.sigma
    errors = _errors(objective, outcome)
    ended = final_status(problem, outcome.status, outcome.point, errors, asked)
    theta = objective.limits.kept(outcome.point.theta, outcome.limit_multipliers)
    return Fit(
        problem=problem,
        values=problem.named(theta),
        uncertainty=errors,
        ended=ended,
        iterations=outcome.iterations,
        seconds=time.perf_counter() - begin,
        cost=value.cost,
        prior_cost=value.rest,
        log_likelihood=likelihood.log_likelihood,
        log_prior=log_prior(objective, outcome, problem.is_initial_given),
        stationarity=outcome.stationarity,
        defect=float(np.abs(value.defects).max(initial=0.0)),
        noise={n: float(sigma[i]) for i, n in enumerate(names) if levels.present[i]},
        channels=channel_fits(names, measured, predicted) if measured else {},
        noise_covariance=levels.matrix if levels.full else np.diag(sigma[: len(names)] ** 2),
        predictions=predicted,
        residuals=residuals,
        states=told.states,
        process_noise=told.process_noise,
        innovations=told.innovations,
        multipliers=outcome.limit_multipliers,
        method=type(method).__name__,
        solver=outcome.solver,
        substeps=objective.layout.substeps if simulated else 1,  # pyright: ignore
        way="; ".join(filter(None, (end.remark, likelihood.without))),
        implicit=is_implicit(method) and simulated and outcome.point.points is None,
    )


def _errors(objective: AnyObjective, outcome: Outcome) -> Uncertainty:
    # None where the iteration ended where sensitivities overflow
    linear = linear_at(objective, outcome) if np.isfinite(outcome.value.cost) else None
    multipliers = outcome.limit_multipliers
    return Uncertainty(objective=objective, value=outcome.value, linear=linear, limit_multipliers=multipliers)


def _told(objective: Objective, outcome: Outcome) -> Told:
    """Signals and states of every record, outputs before equations."""
    problem = objective.problem
    value = outcome.value
    trajectory = value.trajectory
    measured: dict[str, np.ndarray] = {}
    predicted: dict[str, np.ndarray] = {}
    states: dict[str, StateHistory] = {}
    for r, record in enumerate(problem.records):
        read = []
        found = []
        if trajectory is not None:
            layout = objective.layout
            x, y = (v.reshape(-1, v.shape[2])[layout.sample[r]] for v in (trajectory.states, trajectory.y))
            nodes = outcome.point.nodes[layout.segments_of(r)]
            times = layout.times[r][:: layout.length]
            states[record.name] = StateHistory(trajectory=x, nodes=nodes, node_times=times)
            read.append(problem.outputs_of(record))
            found.append(y)
        if objective.equations is not None and value.equations is not None:
            target = objective.equations.targets[r]
            read.append(target)
            found.append(target + value.equations.residuals[r])
        measured[record.name] = np.concatenate(read, axis=1)
        predicted[record.name] = np.concatenate(found, axis=1)
    return Told(measured=measured, predicted=predicted, states=states)
