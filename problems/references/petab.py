"""The likelihood of a problem by LSODA, independent of how casid integrates, and scipy's minimum of it.

For problems whose initial states are formulas, with any noise that `Problem` takes: PEtab's are such. The motion is
integrated from sample to sample and from event to event, so that no step crosses a jump.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from warnings import catch_warnings

import casadi as ca
import numpy as np
from scipy.integrate import ODEintWarning, odeint
from scipy.optimize import least_squares, minimize

from casid.estimation import Problem
from casid.estimation.noise import Noise
from casid.estimation.working import initial_offsets

PUBLISHED = {
    "Rahman_MBS2016": 21.1535,
    "Crauste_CellSystems2017": 190.964,
    "Elowitz_Nature2000": -63.203,
    "Fujita_SciSignal2010": -53.084,
}
# of LSODA, relative and in sizes of the states: Crauste's motion needs it, and Fujita's, with rates of 1e5/s over an
# hour, does not end with it
TOLERANCES = dict.fromkeys(PUBLISHED, 1e-10) | {"Fujita_SciSignal2010": 1e-8}
_LOST = 1e10  # of a motion that cannot be integrated
_COARSE = 1e-8  # of LSODA, for scipy's iteration
_DIFFERENCE = math.sqrt(_COARSE)  # of a parameter, where half the digits of such a motion are lost


class Likelihood:
    """-ln(likelihood) of parameters by name; `tolerance` of LSODA, relative and in sizes of the states."""

    def __init__(self, problem: Problem, tolerance: float = 1e-10) -> None:
        model = problem.model
        self.problem, self.tolerance = problem, tolerance
        given = [model.x, model.u, model.p]
        self._slope = ca.Function("f", given, [model.f])
        self._slopes = ca.Function("j", given, [ca.densify(ca.jacobian(model.f, model.x))])
        self._jump = {name: ca.Function("g", given, [after]) for name, after in model.events.items()}
        assert isinstance(problem.noise, Mapping)
        sigmas = [_sigma(problem, name) for name in model.outputs]
        channels = [symbol for _, symbol in sigmas if symbol is not None]
        self._channels = [str(symbol) for symbol in channels]
        seen = ca.vertcat(model.h, *(s for s, _ in sigmas))
        self._seen = ca.Function("h", [*given, ca.vertcat(*channels)], [seen])

    def __call__(self, values: Mapping[str, float], begins: np.ndarray | None = None) -> float:
        """At these values, and initial states (records, states) where they are no formulas; infinite where there is no
        motion."""
        total = 0.0
        for residual, sigma, scale in self.parts(values, begins):
            total += float((0.5 * residual**2 + np.log(sigma * math.sqrt(2.0 * math.pi)) + scale).sum())
        return total if np.isfinite(total) else math.inf

    def parts(
        self, values: Mapping[str, float], begins: np.ndarray | None = None
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Per record and output the whitened residuals, their 1-sigma, and ln of the reading where noise is
        log-normal."""
        problem = self.problem
        theta = np.array([values[name] for name in problem.parameters])
        found = []
        begins = initial_offsets(problem, theta) if begins is None else begins
        for record, p, begin in zip(problem.records, problem.model_parameters(theta), begins, strict=True):
            inputs = record.matrix(problem.model.inputs)
            following = np.where(self._held(record), inputs, np.vstack([inputs[1:], inputs[-1:]]))
            jumps = sorted((t, name) for name, times in record.events.items() for t in times)
            states = self._motion(record.t, begin, inputs, following, p, jumps)
            extra = (
                np.stack([record[c] for c in self._channels], axis=1) if self._channels else np.zeros((len(record), 0))
            )
            seen = self._seen(states.T, inputs.T, np.tile(p[:, None], len(record)), extra.T).full()
            measured = problem.outputs_of(record)
            for i, name in enumerate(problem.model.outputs):
                there = np.isfinite(measured[:, i])
                z, y, sigma = measured[there, i], seen[i, there], seen[len(problem.model.outputs) + i, there]
                noise = problem.noise_formulas.get(name)
                with np.errstate(all="ignore"):
                    if noise is not None and noise.logarithmic:
                        found.append((np.log(z / y) / sigma, sigma, np.log(z)))
                    else:
                        found.append(((z - y) / sigma, sigma, np.zeros(len(z))))
        return found

    def _held(self, record) -> np.ndarray:
        return np.array([record.hold_of(name) == "held" and name != "t" for name in self.problem.model.inputs])

    def _motion(
        self,
        t: np.ndarray,
        begin: np.ndarray,
        u0: np.ndarray,
        u1: np.ndarray,
        p: np.ndarray,
        jumps: list[tuple[float, str]],
    ) -> np.ndarray:
        states = np.full((len(t), len(begin)), np.nan)
        states[0] = begin
        close = self.tolerance * self.problem.state_size
        for k, dt in enumerate(np.diff(t)):

            def slope(x: np.ndarray, share: float, k: int = k, dt: float = dt) -> np.ndarray:
                return dt * self._slope(x, u0[k] + share * (u1[k] - u0[k]), p).full()[:, 0]

            def slopes(x: np.ndarray, share: float, k: int = k, dt: float = dt) -> np.ndarray:
                return dt * self._slopes(x, u0[k] + share * (u1[k] - u0[k]), p).full()

            state, share = states[k], 0.0
            for at, event in [*((a, e) for a, e in jumps if t[k] < a <= t[k + 1]), (t[k + 1], "")]:
                until = (at - t[k]) / dt
                if until > share:
                    with catch_warnings(action="ignore", category=ODEintWarning):  # `said` has it
                        after, said = odeint(
                            slope,
                            state,
                            [share, until],
                            Dfun=slopes,
                            rtol=self.tolerance,
                            atol=close,
                            mxstep=20000,
                            full_output=True,
                        )
                    if said["message"] != "Integration successful." or not np.isfinite(after[-1]).all():
                        return states
                    state, share = after[-1], until
                if event:
                    state = self._jump[event](state, u0[k + 1] if at == t[k + 1] else u0[k], p).full()[:, 0]
            states[k + 1] = state
        return states


def _sigma(problem: Problem, name: str) -> tuple[ca.SX, ca.SX | None]:
    """The 1-sigma of an output as an expression, and the symbol of the channel that has it, if one does."""
    given = problem.noise[name]  # pyright: ignore[reportOptionalSubscript, reportArgumentType, reportCallIssue, reportIndexIssue]
    if isinstance(given, str):
        given = Noise(sigma=given)
    if not isinstance(given, Noise):
        return ca.SX(float(given)), None
    expression = given.expression(problem.model, name)
    return expression, expression if isinstance(given.sigma, str) else None


def times(problem: Problem, factor: float) -> Problem:
    """With all parameters of the start times a factor, within their bounds."""
    start = {n: float(v) * factor for n, v in zip(problem.parameters, problem.start_vector, strict=True)}
    for row, lower, upper in zip(*problem.linear_rows, strict=True):
        name = problem.parameters[int(np.flatnonzero(row)[0])]
        start[name] = min(max(start[name], lower), upper)
    return replace(problem, start=start)


@dataclass(frozen=True, eq=False, kw_only=True)
class ScipyMinimum:
    """Values, -ln(likelihood) by LSODA at tight tolerances, seconds."""

    values: dict[str, float]
    cost: float
    seconds: float


class _TimeUpError(Exception):
    pass


def minimum_by_scipy(problem: Problem, start: Mapping[str, float], seconds: float) -> ScipyMinimum:
    """From a start, within a time: least squares by the trust region method, in the scale of the parameter table and
    its bounds, and where the noise is estimated too L-BFGS-B of the likelihood; differences for derivatives."""
    names, begin = problem.parameters, time.perf_counter()
    by_log = np.array([n in problem.logarithmic for n in names])
    coarse, fine = Likelihood(problem, _COARSE), Likelihood(problem)
    low, high = _bounds(problem, by_log)
    best = [math.inf, dict(start)]

    def named(v: np.ndarray) -> dict[str, float]:
        return {n: float(np.exp(x) if log else x) for n, x, log in zip(names, v, by_log, strict=True)}

    def watched(v: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        if time.perf_counter() - begin > seconds:
            raise _TimeUpError
        parts = coarse.parts(named(v))
        cost = sum(float((0.5 * r**2 + np.log(s * math.sqrt(2.0 * math.pi)) + j).sum()) for r, s, j in parts)
        if np.isfinite(cost) and cost < best[0]:
            best[:] = [cost, named(v)]
        return parts

    def residuals(v: np.ndarray) -> np.ndarray:
        return np.nan_to_num(np.concatenate([r for r, _, _ in watched(v)]), nan=_LOST, posinf=_LOST, neginf=-_LOST)

    def cost(v: np.ndarray) -> float:
        found = sum(float((0.5 * r**2 + np.log(s)).sum()) for r, s, _ in watched(v))
        return found if np.isfinite(found) else _LOST

    x0 = np.clip(
        np.array([math.log(start[n]) if log else start[n] for n, log in zip(names, by_log, strict=True)]), low, high
    )
    estimated = any(callable(noise.sigma) for noise in problem.noise_formulas.values())
    try:
        with np.errstate(all="ignore"):
            if estimated:
                options = {"maxiter": 5000, "maxfun": 100000, "ftol": 1e-13, "finite_diff_rel_step": _DIFFERENCE}
                minimize(cost, x0, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), options=options)
            else:
                least_squares(
                    residuals,
                    x0,
                    bounds=(low, high),
                    x_scale="jac",
                    diff_step=_DIFFERENCE,
                    xtol=1e-12,
                    ftol=1e-12,
                    gtol=1e-12,
                )
    except _TimeUpError:
        pass
    took = time.perf_counter() - begin
    return ScipyMinimum(values=best[1], cost=fine(best[1]), seconds=took)


def _bounds(problem: Problem, by_log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.full(len(by_log), -np.inf), np.full(len(by_log), np.inf)
    for row, lower, upper in zip(*problem.linear_rows, strict=True):
        i = int(np.flatnonzero(row)[0])
        with np.errstate(divide="ignore"):
            low[i], high[i] = np.log([max(lower, 0.0), max(upper, 0.0)]) if by_log[i] else (lower, upper)
    return low, high
