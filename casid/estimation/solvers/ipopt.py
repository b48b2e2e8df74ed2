"""IPOPT on the problem as a general nonlinear programme, with the exact or the Gauss-Newton Hessian.

Noise that is estimated with the parameters, and the covariance of soft defects, are brought to their fixed point by
repeated, warm-started solutions; the fixed point is the one that Gauss-Newton finds. Where parameters and noise trade
off, each solution comes only some two times nearer to it; so the noise is extrapolated to where it will settle, and has
settled when that is where it is.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.arguments import one_of
from casid.errors import EstimationError
from casid.estimation.solvers.fixed_point import FixedPoint
from casid.estimation.solvers.identified import lost
from casid.estimation.solvers.nlp import Packing, Programme, build, data, is_programmable, point_from, variables
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import AnyObjective, OwnObjective
from casid.estimation.solvers.point import NoiseState, ObjectiveValue, Point, SolverStep, negligible, step_length
from casid.estimation.solvers.separable import separable_functions
from casid.estimation.solvers.solver import Outcome, check_limits, linear_at
from casid.estimation.solvers.status import CONVERGED, DIVERGES, INFEASIBLE, Results, Status
from casid.model.built import cached
from casid.native.programme import CompilableProgramme


@dataclass(frozen=True, kw_only=True)
class Ipopt:
    """IPOPT (interior point, MUMPS).

    Attributes
    ----------
    hessian
        "exact", and where that ends on a plateau, which the data do not determine, once more from the start with that
        of Gauss-Newton; or "gauss-newton" alone. tolerance Of IPOPT's optimality conditions on the scaled problem.
        iterations After how many steps of one solution to give up. seconds After how much time to give up.

    Examples
    --------
    After the example of `solve`:

    >>> fit = cs.solve(problem, cs.SingleShooting(), cs.Ipopt())
    >>> fit.solver, round(fit.values["T"], 3)
    ('Ipopt', 0.4)
    """

    hessian: str = "exact"
    tolerance: float = 1e-9
    iterations: int = 3000
    seconds: float = 600.0

    def __post_init__(self) -> None:
        one_of(self.hessian, ("exact", "gauss-newton"), "Ipopt: hessian")
        check_limits(self)

    def minimise(self, objective: AnyObjective) -> Outcome:
        """Minimise the objective; a bad course of the iteration is stated in the status.

        Raises
        ------
        EstimationError
            For a transcription or a cost that has no form as a nonlinear programme.
        """
        if isinstance(objective, OwnObjective) or not is_programmable(objective):
            cost = type(objective.problem.cost).__name__
            raise EstimationError(
                f"solve: {cost} has no form as a nonlinear programme, which Ipopt needs; use Automatic()"
            )
        begin = time.perf_counter()
        outcome = _minimise(objective, self)
        took = time.perf_counter() - begin
        left = self.seconds - took
        if self.hessian == "exact" and left > took and _on_plateau(objective, outcome):  # the other takes as long
            other = _minimise(objective, replace(self, hessian="gauss-newton", seconds=left))
            if other.converged and not _on_plateau(objective, other):
                return other
        return outcome


_ROUNDS = 60  # of noise and covariance
_SETTLED = 1e-8  # expected change of the noise in its standard deviations, relative change of the covariance
_SOLVED = 1e-5  # standard deviations
_TIME_LIMIT = Status(result=Results.STOPPED, reason="at the time limit, not converged")
_ENDS = {  # status of IPOPT
    "Solve_Succeeded": CONVERGED,
    "Maximum_Iterations_Exceeded": Status(result=Results.STOPPED, reason="at the iteration limit, not converged"),
    "User_Requested_Stop": _TIME_LIMIT,
    "Infeasible_Problem_Detected": INFEASIBLE,
    "Restoration_Failed": Status(
        result=Results.FAILED, reason="IPOPT found no point that satisfies the constraints better"
    ),
    "Invalid_Number_Detected": Status(result=Results.DEPARTED, reason="the simulation diverges on the way"),
    "Solved_To_Acceptable_Level": Status(
        result=Results.STOPPED, reason="at an acceptable point, not converged to the tolerance"
    ),
}


def _minimise(objective: Objective, solver: Ipopt) -> Outcome:
    point = objective.start()
    value = objective.value(point)
    unsolved: dict = {"stationarity": np.inf, "limit_multipliers": np.zeros(len(objective.limits)), "solver": "Ipopt"}
    if not np.isfinite(value.cost):
        return Outcome(point=point, value=value, status=DIVERGES, iterations=0, **unsolved)
    deadline = time.perf_counter() + solver.seconds
    scale = _parameter_scale(objective, point, value)
    x = Packing(variables(objective, point, scale))
    count = value.noise.levels.count
    gain = 1.0 / count
    d = Packing(data(objective, value.noise, scale, gain))
    built = _built(objective, x, d, solver, deadline)
    if built is None:
        return Outcome(point=point, value=value, status=_TIME_LIMIT, iterations=0, **unsolved)
    function, programme = built
    iterations = 0
    status = _TIME_LIMIT
    multipliers = np.zeros(programme.g.numel())
    settling = FixedPoint()
    for _ in range(_ROUNDS):
        result, stats = function(
            until=deadline,
            x0=x.pack(variables(objective, point, scale)),
            p=d.pack(data(objective, value.noise, scale, gain)),
            lbg=programme.lower,
            ubg=programme.upper,
            lam_g0=multipliers,
        )
        iterations += int(stats["iter_count"])
        multipliers = np.asarray(result["lam_g"]).ravel()
        point = point_from(objective, x.unpack(np.asarray(result["x"]).ravel()), scale, point)
        value = objective.value(point, value.noise)
        reason = str(stats["return_status"])
        status = _ENDS.get(reason, Status(result=Results.FAILED, reason=f"IPOPT says {reason}"))
        if not status.converged and _is_solution(objective, point, value):
            status = CONVERGED
        if not status.converged or not np.isfinite(value.cost):
            break
        relaxed, change = _relaxed(objective, point, value, settling)
        value = objective.reweighed(point, value, relaxed)
        # a cost of about one makes the tolerance relative to the residuals, whatever their weights are
        fitting = 0.5 / max(value.cost, 1e-6 * count)
        if change < _SETTLED and fitting < 30 * gain:
            break
        multipliers *= fitting / gain
        gain = fitting
        status = Status(result=Results.STOPPED, reason="the noise did not settle")
        if time.perf_counter() > deadline:
            break
    limit_multipliers = multipliers[programme.linear]
    active = np.abs(limit_multipliers) * np.abs(objective.limits.at(point.theta)[1] @ scale) > 1e-5
    limit_multipliers = np.where(active, limit_multipliers / gain, 0.0)
    step = _gauss_newton_step(objective, point, value)
    return Outcome(
        point=point,
        value=value,
        status=status,
        iterations=iterations,
        stationarity=np.nan if step is None else step_length(step, value),
        limit_multipliers=limit_multipliers,
        solver="Ipopt",
    )


def _built(
    objective: Objective, x: Packing, d: Packing, solver: Ipopt, deadline: float
) -> tuple[CompilableProgramme, Programme] | None:
    """The programme, made now or before; None where making it takes longer than until the deadline, as those of fewer
    steps took, which were made before: the time is proportional to the steps of a segment."""
    model = objective.problem.model
    simulated = objective.dynamics is not None
    segments, steps = (objective.layout.segments, objective.layout.length) if simulated else (0, 1)
    kind = (solver.hessian, solver.tolerance, solver.iterations)  # the time is no part of it
    took = cached(model, ("seconds per step to build", kind, segments), list)
    programmes = cached(model, ("programmes", kind), dict)
    key = _signature(objective, x, d)
    begin = time.perf_counter()
    if key not in programmes and begin + max(took, default=0.0) * steps < deadline:
        programmes[key] = _solver(objective, x, d, solver)
        took.append((time.perf_counter() - begin) / steps)
    return programmes.get(key)


def _solver(objective: Objective, x: Packing, d: Packing, solver: Ipopt) -> tuple[CompilableProgramme, Programme]:
    programme = build(objective, x, d)
    options: dict = {
        "print_time": False,
        "show_eval_warnings": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": solver.tolerance,
            "constr_viol_tol": 1e-9,
            "bound_relax_factor": 0.0,
            "max_iter": solver.iterations,
            "nlp_scaling_method": "none",
            "acceptable_iter": 10,
            "acceptable_tol": 1e3 * solver.tolerance,
            "mu_strategy": "adaptive",
        },
    }
    exact = solver.hessian == "exact"
    given: dict[str, ca.Function] = {}
    if programme.separable is not None:
        given = separable_functions(objective, programme.separable, programme.x, programme.p, programme.gain, exact)
    elif not exact:
        given = {"hess_lag": _gauss_newton_hessian(programme)}
    nlp = {"x": programme.x, "p": programme.p, "f": programme.f, "g": programme.g}
    return CompilableProgramme(nlp, options, given), programme


def _gauss_newton_hessian(programme: Programme) -> ca.Function:
    factor = ca.MX.sym("lam_f")
    multipliers = ca.MX.sym("lam_g", programme.g.numel())
    jacobian = ca.jacobian(programme.residual, programme.x)
    hessian = ca.triu(factor * programme.gain * (jacobian.T @ jacobian))
    given = [programme.x, programme.p, factor, multipliers]
    return ca.Function("nlp_hess_l", given, [hessian], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])


def _signature(objective: Objective, x: Packing, d: Packing) -> tuple:
    """Return what two problems on one model must share to share a programme."""
    problem = objective.problem
    shapes = tuple((name, s.shape) for pack in (x, d) for name, s in pack.symbols.items())
    layout = (
        (
            tuple(objective.layout.record),
            objective.layout.length,
            objective.layout.substeps,
            objective.exact.tobytes(),
            objective.scale.tobytes(),
        )
        if objective.dynamics is not None
        else ()
    )
    lengths = tuple(len(record) for record in problem.records)
    limits = (objective.limits.key, problem.path_constraints)
    return shapes, layout, lengths, problem.parameters, limits, type(problem.cost)


def _parameter_scale(objective: Objective, point: Point, value: ObjectiveValue) -> np.ndarray:
    """A hundred conditional standard deviations of each parameter: its curvature is then that of the whole cost."""
    try:
        curvature = np.diagonal(objective.linearise(point, value).hessian)
    except np.linalg.LinAlgError:
        curvature = np.zeros(len(point.theta))
    usual = np.maximum(np.abs(point.theta), 0.1)
    with np.errstate(divide="ignore"):
        return np.where(curvature > 0, np.minimum(100.0 / np.sqrt(np.abs(curvature)), 10 * usual), usual)


def _relaxed(
    objective: Objective, point: Point, value: ObjectiveValue, settling: FixedPoint
) -> tuple[NoiseState, float]:
    """Noise where it is expected to settle, soft-defect covariance by the present point; the largest change, of
    the noise in units of its standard deviations, of the covariance relative to it."""
    noise = value.noise
    change = 0.0
    levels = noise.levels
    if not levels.fixed:
        before = levels.coordinates
        expected = settling.following(before, levels.relaxed(value.squares)[0].coordinates)
        change = float(np.abs(expected - before).max(initial=0.0))
        noise = replace(noise, levels=levels.at(expected))
    if noise.factor is not None:
        before = noise.factor
        noise = objective.linearise(point, objective.reweighed(point, value, noise)).noise
        if noise.factor is not None:
            size = float(np.abs(noise.factor).max(initial=1e-300))
            change = max(change, float(np.abs(noise.factor - before).max(initial=0.0)) / size)
    return noise, change


def _on_plateau(objective: Objective, outcome: Outcome) -> bool:
    """Return True if IPOPT stops where the data do not determine some parameter."""
    if not outcome.converged:
        return False
    linear = linear_at(objective, outcome)
    return linear is None or bool(lost(objective, linear, outcome.limit_multipliers))


def _is_solution(objective: Objective, point: Point, value: ObjectiveValue) -> bool:
    """Return True if a point at which IPOPT could not go on is a solution all the same: rounding, not failure."""
    if objective.problem.path_constraints or value.worst() > 1e-8:
        return False
    step = _gauss_newton_step(objective, point, value)
    return step is not None and negligible(step, value, _SOLVED)


def _gauss_newton_step(objective: Objective, point: Point, value: ObjectiveValue) -> SolverStep | None:
    if not np.isfinite(value.cost):
        return None
    try:
        return objective.step(point, value, objective.linearise(point, value), 0.0)
    except np.linalg.LinAlgError:
        return None
