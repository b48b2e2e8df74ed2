"""scipy on the same problems: what people use who have the equations and no estimation package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares, minimize

from casid.estimation import Problem
from casid.estimation.working import initial_offsets
from casid.records.record import Record
from problems.references.nist import FORMULAS, Reference

_TOLERANCE = 1e-8  # of the integrator; of the minimiser 1e-12
_LOST = 1e6  # residual of a motion that cannot be integrated


@dataclass(frozen=True, eq=False, kw_only=True)
class ScipyEnd:
    """Where scipy ended: parameters (those of the problem, then free initial states), and the sum of squares of the
    residuals (outputs,) of each output."""

    parameters: np.ndarray
    squares: np.ndarray
    samples: np.ndarray


def regression_by_scipy(reference: Reference, start: int) -> np.ndarray:
    """`least_squares` by MINPACK's method of Levenberg and Marquardt, with exact derivatives: of the settings that were
    tried the one with most successes, 54 of 54; with differences it has 46 to 50."""
    count, samples = len(reference.certified), len(reference.y)
    b, x = ca.SX.sym("b", count), ca.SX.sym("x", len(reference.x))
    response = FORMULAS[reference.name](ca, ca.vertsplit(x), ca.vertsplit(b))
    slope = ca.Function("slope", [x, b], [ca.densify(ca.jacobian(response, b))]).map(samples)

    def numbers(values: np.ndarray) -> np.ndarray:
        return np.nan_to_num(values, nan=1e10, posinf=1e10, neginf=-1e10)

    with np.errstate(all="ignore"):
        return least_squares(
            lambda v: numbers(reference.response(v, np) - reference.y),
            reference.starts[start],
            jac=lambda v: numbers(slope(reference.x, np.tile(v[:, None], samples)).full().T.reshape(samples, count)),  # pyright: ignore[reportArgumentType]
            method="lm",
            x_scale="jac",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=20000,
        ).x


def motion_by_scipy(problem: Problem) -> ScipyEnd:
    """Residuals of LSODA's motion from the problem's start, by `least_squares`; where the noise is estimated too, its
    concentrated likelihood by L-BFGS-B. Logarithms and limits as the problem has them."""
    logarithmic = np.array([name.split("[")[0] in problem.logarithmic for name in problem.parameters])
    known, std = problem.initial_knowledge
    free = np.isnan(known) & (std > 0.0) & ~np.isin(problem.model.states, list(problem.model.initial))
    first = np.array([problem.model.guess(record)[0] for record in problem.records])[free]
    start = problem.start_vector.copy()
    start[logarithmic] = np.log(start[logarithmic])
    lower, upper = _limits(problem, logarithmic, len(first))
    simulate = _simulator(problem)

    def residuals(v: np.ndarray) -> list[np.ndarray]:
        theta = np.where(logarithmic, np.exp(np.where(logarithmic, v[: len(start)], 0.0)), v[: len(start)])
        x0 = np.where(np.isnan(known), 0.0, known) + initial_offsets(problem, theta)
        x0[free] = v[len(start) :]
        return simulate(theta, x0)

    def stacked(v: np.ndarray) -> np.ndarray:
        found = np.concatenate(residuals(v))
        return found[np.isfinite(found)]

    begin = np.clip(np.concatenate([start, first]), lower, upper)
    if problem.noise is not None:
        end = least_squares(stacked, begin, bounds=(lower, upper), x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    else:
        options = {"maxiter": 2000, "maxfun": 20000, "ftol": 1e-13, "gtol": 1e-8}
        limits = list(zip(lower, upper, strict=True))
        cost = _concentrated(residuals, len(problem.model.outputs))
        end = minimize(cost, begin, method="L-BFGS-B", bounds=limits, options=options).x
    last = np.concatenate([r.reshape(-1, len(problem.model.outputs)) for r in residuals(end)])
    return ScipyEnd(parameters=end, squares=np.nansum(last**2, axis=0), samples=np.isfinite(last).sum(axis=0))


def _concentrated(residuals: Callable[[np.ndarray], list[np.ndarray]], outputs: int) -> Callable[[np.ndarray], float]:
    def cost(v: np.ndarray) -> float:
        rows = np.concatenate([r.reshape(-1, outputs) for r in residuals(v)])
        count = np.isfinite(rows).sum(axis=0)
        return float(0.5 * (count * np.log(np.nansum(rows**2, axis=0) / count)).sum())

    return cost


def _limits(problem: Problem, logarithmic: np.ndarray, further: int) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.full(len(logarithmic), -np.inf), np.full(len(logarithmic), np.inf)
    for row, lower, upper in zip(*problem.linear_rows, strict=True):
        i = int(np.flatnonzero(row)[0])
        low[i], high[i] = (np.log([lower, upper]) if logarithmic[i] else (lower, upper)) / row[i]
    return np.concatenate([low, [-np.inf] * further]), np.concatenate([high, [np.inf] * further])


def _simulator(problem: Problem) -> Callable[[np.ndarray, np.ndarray], list[np.ndarray]]:
    """(theta, initial states) -> per record the residuals, samples by outputs in a row, weighed by what is given."""
    model = problem.model
    f = ca.Function("f", [model.x, model.u, model.p], [model.f])
    h = ca.Function("h", [model.x, model.u, model.p], [model.h])
    timed = "t" in model.inputs

    def simulate(theta: np.ndarray, x0: np.ndarray) -> list[np.ndarray]:
        found = []
        for record, p, begin in zip(problem.records, problem.model_parameters(theta), x0, strict=True):

            def slope(t: float, x: np.ndarray, p: np.ndarray = p) -> np.ndarray:
                return f(x, [t] if timed else [], p).full()[:, 0]

            z = problem.outputs_of(record)
            motion = solve_ivp(
                slope, (record.t[0], record.t[-1]), begin, "LSODA", record.t, rtol=_TOLERANCE, atol=_TOLERANCE
            )
            y = np.full(z.shape, _LOST)
            if motion.success:
                u = [[t] if timed else [] for t in record.t]
                y = np.array([h(x, v, p).full()[:, 0] for x, v in zip(motion.y.T, u, strict=True)])
            sigma = [1.0 if problem.noise is None else _sigma(problem, record, o) for o in model.outputs]
            found.append(((y - z) / np.stack(np.broadcast_arrays(*sigma, record.t)[:-1], axis=1)).ravel())
        return found

    return simulate


def _sigma(problem: Problem, record: Record, output: str) -> np.ndarray | float:
    given = problem.noise[output] if isinstance(problem.noise, Mapping) else 1.0
    return record[given] if isinstance(given, str) else float(given)  # pyright: ignore[reportArgumentType]
