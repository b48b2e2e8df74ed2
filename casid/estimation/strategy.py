"""The strategy of `solve` from a start to a solution that nothing cheap contradicts.

1. The usual solver in the transcription that was asked for: Gauss-Newton for Automatic().
2. Where it found nothing, or short stretches of the records contradict what it found: multiple shooting with a state at
   every sample, from the parameters that suit the stretches, from those where it ended and from the start; collocation
   after that. Under constraints that bind also from the solution without them. The most likely solution is taken.
3. Where none was found, Automatic() goes on in the transcription that was asked for, with all its methods.

With any other solver than Automatic() the second step only judges: a better solution is stated in the status.

Where short stretches contradict a solution, it is a local minimum or the model is wrong (`stretches.py`). Multiple
shooting with a state at every sample decides between the two: from the measured states and the parameters that suit the
stretches it either returns to the solution or finds a better one.

Each attempt may take a number of evaluations, a simulation or a linearisation each, so that what is tried does not
depend on the load of the machine. A start that leads anywhere needs few: of some sixty that the tests of this module
try, those that were found took 10 to 50. Newton's method differences the gradient along every parameter.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from casid.estimation.attempt import as_motion, attempted, build_objective, likely
from casid.estimation.cost import OwnLikelihood
from casid.estimation.integration import MOST_STEPS, Attempt, doubt_of_steps, is_judged
from casid.estimation.problem import Problem
from casid.estimation.results import idle_parameters, ran_away
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.solver import Outcome, Solver
from casid.estimation.solvers.status import Results, Stage, Status, out_of_time
from casid.estimation.solvers.timed import Timed
from casid.estimation.transcriptions.transcription import (
    Collocation,
    MultipleShooting,
    Stepping,
    Transcription,
    as_stepping,
    finest_interval,
    is_implicit,
)

# evaluations for each iteration that Automatic() may take: of damped steps, and of Newton's by parameter, of which as
# many as steps of Gauss-Newton are never needed
_DAMPED = 10
_NEWTON = 10
_TRIED = 60  # evaluations of an attempt from another start
_EQUAL = 0.01  # of ln(likelihood), as good as the integration is
_NOWHERE = 1.0  # of the readings: a simulation further from them than zero follows nothing
_NEAR = 0.1  # standard deviations between two ends of one minimum
_LITTLE = 0.1  # of the seconds of a solver


def ending(problem: Problem, method: Transcription, solver: Solver, clock: Timed) -> Attempt:
    """The solution of a problem, see above, with its integration checked, in the time of a `clock`. Raises as the
    solver does."""
    end = _ending(problem, method, solver, clock)
    status = end.outcome.status
    if time.perf_counter() > clock.deadline and (status.result is Results.STOPPED or status.stage is Stage.AT_START):
        end = _with_status(end, out_of_time(float(getattr(solver, "seconds", math.inf))))
    doubt = "" if end.fine or (_is_over(clock) and not end.outcome.converged) else doubt_of_steps(end)
    said = "" if end.outcome.status.stage is Stage.COARSE else doubt  # by the status already
    return replace(end, remark="; ".join(filter(None, (end.remark, said))), coarse=bool(doubt))


def _ending(problem: Problem, method: Transcription, solver: Solver, clock: Timed) -> Attempt:
    if isinstance(problem.cost, OwnLikelihood):
        return likely(problem, method, clock)
    asked = as_stepping(method)
    usual = usual_of(solver)
    if asked is None or not problem.simulated or asked.process_noise:
        return attempted(problem, method, clock)
    # what judges and looks elsewhere is Gauss-Newton that gives up where it creeps
    quick = clock.with_solver(usual or GaussNewton(patient=False))
    automatic = usual is not None
    most = math.inf
    if usual is not None:
        most = usual.iterations * (_DAMPED + _NEWTON * len(problem.parameters))
    first = attempted(problem, method, quick.allowed(most) if automatic else clock)
    if first.found and not first.doubtful and not _held(first):
        return first
    if first.outcome.converged and idle_parameters(problem):  # no other start changes that
        return first
    if _is_over(clock) and not first.found:  # nothing that judges it has time either
        return _no_worse_than_start(problem, method, first, clock)
    best, agreed = _searched(problem, asked, first, quick) if first.found or automatic else (first, False)
    if automatic and not best.found and clock.left > 0.0:
        # where the motion of the start has no end, it is collocation that goes on
        stays = np.isfinite(first.outcome.value.cost) or problem.model.period is not None
        last = attempted(problem, method if stays else Collocation(), clock.allowed(most))
        best, agreed = _searched(problem, asked, last, quick) if last.found else (_better(best, last), False)
    if best.found and best is not first and not agreed and best.doubtful:  # judged by its own point, not by the way
        best, agreed = _searched(problem, asked, best, quick)
    if not automatic and best is not first:
        return _with_status(first, _another(_found_elsewhere(best, first)))
    if best.found and not agreed and best.is_slow and best.stretches.contradict:
        best = _with_status(best, _another(_CONTRADICTED))
    if best is not first and best.found:
        best = replace(best, remark=f"found on a second way: {_found_elsewhere(best, first)}")
    return _no_worse_than_start(problem, method, best, clock)


def _is_over(clock: Timed) -> bool:
    """Return True if so little time is left that one more attempt would exceed it."""
    seconds = float(getattr(clock.solver, "seconds", math.inf))
    return math.isfinite(seconds) and clock.left <= _LITTLE * seconds


_CONTRADICTED = "short stretches of the records are explained far better than the whole"
_REMEDY = "use solve(..., starts=20), or MultipleShooting(interval=1) from another start"


def usual_of(solver: Solver) -> GaussNewton | None:
    """The Gauss-Newton that a solver with several methods begins with; None of one that does as it says."""
    return getattr(solver, "usual", None)


def _held(attempt: Attempt) -> bool:
    """Return True if a constraint binds, so that it may have misled the iteration."""
    problem = attempt.objective.problem
    return bool(problem.path_constraints) or bool(np.abs(attempt.outcome.limit_multipliers).max(initial=0.0) > 0.0)


def _searched(problem: Problem, method: Stepping, first: Attempt, quick: Timed) -> tuple[Attempt, bool]:
    """The most likely of a first end and those from other starts, and whether another start came to the same."""
    best = first
    agreed = False
    for other, apart in _others(problem, method, first, quick):
        if first.found and _same(first, other):
            agreed |= apart
        elif other.found and (not best.found or other.misfit < best.misfit - _EQUAL):
            best = other
            agreed = False
        elif not best.found and other.misfit < best.misfit:
            best = other
        if best.found and (agreed or not best.doubtful) and not (_held(best) and best is first):
            break
    return best, agreed


def _others(problem: Problem, method: Stepping, first: Attempt, quick: Timed) -> Iterator[tuple[Attempt, bool]]:
    """Attempts from other starts, each made when it is asked for, as long as there is time, and whether their start
    does not depend on where the first ended."""
    fine = _fine(problem, method, is_implicit(first.method))
    if problem.constraints and quick.left > 0.0:
        free = replace(problem, constraints=())
        unbound = quick.with_solver(GaussNewton(patient=False)).allowed(_TRIED)
        found = attempted(free, method, unbound)
        if not found.found and quick.left > 0.0:
            found = attempted(free, fine, unbound.allowed(_TRIED))
        if found.found and quick.left > 0.0:
            yield attempted(replace(problem, start=found.values), method, quick.allowed(_TRIED)), False
    if first.found and not first.doubtful:
        return
    stretched = first.stretches.theta
    ended = None if first.found else first.outcome.point.theta
    for theta in (stretched, ended, problem.start_vector):
        if theta is not None and np.isfinite(theta).all() and quick.left > 0.0:
            again = replace(problem, start=problem.named(theta))
            yield attempted(again, fine, quick.allowed(_TRIED)), theta is stretched or stretched is None
    between_samples = problem.feedback is None and problem.model.period is None
    if fine is not method and between_samples and quick.left > 0.0:
        yield attempted(problem, Collocation(), quick.allowed(_TRIED)), True


def _fine(problem: Problem, method: Stepping, implicit: bool) -> Stepping:
    """Return the method with a state at every sample; the same integration as was asked for, by `implicit` steps
    where it took them."""
    if isinstance(method, Collocation):
        return method
    return MultipleShooting(
        interval=finest_interval(problem), substeps=method.substeps, implicit=method.implicit or implicit
    )


def _same(first: Attempt, other: Attempt) -> bool:
    """Return True if another iteration ended, or gave up on its way, at the same minimum."""
    if other.found and abs(other.misfit - first.misfit) <= _EQUAL:
        return True
    linear = first.outcome.linear
    if linear is None or other.misfit < first.misfit - _EQUAL:
        return False
    apart = other.outcome.point.theta - first.outcome.point.theta
    return bool(apart @ linear.hessian @ apart < _NEAR**2)


def _better(first: Attempt, second: Attempt) -> Attempt:
    """Return, of two ends that are no solution, the one that is stationary, else the more likely; where both are
    equally likely the second, which all methods have judged."""
    stationary = [a.outcome.converged for a in (first, second)]
    if stationary[0] != stationary[1]:
        return second if stationary[1] else first
    return first if first.misfit < second.misfit - _EQUAL else second


def _another(reason: str) -> Status:
    return Status(result=Results.ANOTHER_MINIMUM, reason=reason, remedy=_REMEDY)


def _with_status(attempt: Attempt, status: Status) -> Attempt:
    return replace(attempt, outcome=replace(attempt.outcome, status=status))


def _found_elsewhere(best: Attempt, first: Attempt) -> str:
    where = f"with {type(best.method).__name__}"
    if interval := getattr(best.method, "interval", None):
        where += f"(interval={interval})"
    gain = first.misfit - best.misfit
    if not first.found or not np.isfinite(gain):
        return f"{where}, after {type(first.method).__name__} had found nothing"
    return f"{where}, where ln(likelihood) is {gain:.4g} higher than where {type(first.method).__name__} ended"


def _alike(begin: Attempt, end: Attempt, clock: Timed) -> tuple[Attempt, Attempt]:
    """A start and an end as they compare: in steps that are halved as long as that changes the likelihood of either. A
    search that was cut short may have ended where long steps are wrong by as much as its data allow. An end that is
    another motion in one piece than in many, as of an unstable model, compares as it is."""
    whole = as_motion(end)
    steps = max(begin.objective.layout.substeps, end.objective.layout.substeps)
    start = as_motion(begin, steps)
    reached = end if np.isfinite(end.misfit) else whole
    chosen = getattr(end.method, "substeps", None) is None and is_judged(end.objective)
    if not (chosen and abs(whole.misfit - reached.misfit) <= _EQUAL):  # true of NaN
        return start, reached
    reached = as_motion(end, steps)
    while 2 * steps <= MOST_STEPS and not _is_over(clock):
        finer = as_motion(begin, 2 * steps), as_motion(end, 2 * steps)
        changed = [abs(a.misfit - b.misfit) for a, b in zip(finer, (start, reached), strict=True)]
        if not np.isfinite(changed).all() or max(changed) <= _EQUAL:
            break
        steps, (start, reached) = 2 * steps, finer
    return start, reached


def _no_worse_than_start(problem: Problem, method: Transcription, end: Attempt, clock: Timed) -> Attempt:
    """The start where its simulation is more likely than what was found."""
    if is_implicit(end.method):
        method = end.method  # the same integration of both
    objective = build_objective(problem, method)
    point = objective.start()
    nothing = Outcome(
        point=point,
        value=objective.value(point),
        status=end.outcome.status,
        iterations=end.outcome.iterations,
        stationarity=np.nan,
        limit_multipliers=np.zeros(len(objective.limits)),
    )
    start, reached = _alike(Attempt(objective=objective, outcome=nothing, method=method), end, clock)
    if not start.misfit < reached.misfit - _EQUAL:
        return end
    if not np.isfinite(end.misfit) and ran_away(problem, start.outcome.value, _NOWHERE):
        return end  # neither is a motion along the records, so that their likelihoods compare nothing
    status = end.outcome.status
    if status.converged:
        status = _another("the start is more likely than the minimum that was found")
    remark = "no solver improved on the start, which is returned"
    return replace(_with_status(start, status), remark=remark)
