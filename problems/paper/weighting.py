"""The combined estimator over its whole range, the swept weight that the paper names as future work, and the
statistically right weights.

curve        weight of the equation part from 0 (output error) to 1 (equation error), multiple shooting
schedule     weight swept during the iteration of single shooting with the control law in the loop, from far starts,
             against fixed weights, against a start from the equation-error estimate, and against multiple shooting
statistical  weights by range (eq. 13), by the noise of Table 4, by the noise that the residuals show; 50/50 each
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.estimation import (
    CombinedError,
    EquationError,
    Fit,
    GaussNewton,
    MultipleShooting,
    OutputError,
    SingleShooting,
    solve,
)
from casid.estimation.cost import Cost
from problems.do328 import MOMENT_DERIVATIVES
from problems.manoeuvres import MANOEUVRES
from problems.paper.cases import CASES, Condition
from problems.paper.estimation import INTERVAL, paper_problem
from problems.paper.shooting import AIRCRAFT, RIGHT, random_start
from problems.paper.statistics import departed, simulated, statistics
from problems.paper.truth import COEFFICIENTS, OUTPUTS, Flight, fly, noise_sigma

WEIGHTS = (0.0, 0.01, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.99, 1.0)
CURVE_CASES = ("B", "D", "F", "H")
CURVE_VARIANT = 2  # of the nonlinear cases
NOISES = ("range", "table 4", "residuals")
_MULTIPLE = MultipleShooting(interval=INTERVAL)
_SOLVER = GaussNewton(iterations=100)


@dataclass(frozen=True, kw_only=True)
class Strategy:
    """weights: of the equation part, one iteration each, before the last, which is iterated to convergence."""

    words: str
    weights: tuple[float, ...]
    multiple: bool = False
    from_equation: bool = False


STRATEGIES: Mapping[str, Strategy] = MappingProxyType(
    {
        "output": Strategy(words="fixed: output error", weights=(0.0,)),
        "combined": Strategy(words="fixed: 50/50", weights=(0.5,)),
        "swept to 50/50": Strategy(
            words="weight 0.99 to 0.5 in five iterations", weights=(0.99, 0.95, 0.9, 0.8, 0.65, 0.5)
        ),
        "swept to output": Strategy(
            words="weight 0.99 to 0 in eight iterations", weights=(0.99, 0.95, 0.9, 0.8, 0.5, 0.2, 0.1, 0.05, 0.0)
        ),
        "equation first": Strategy(
            words="output error from the equation-error estimate", weights=(0.0,), from_equation=True
        ),
        "multiple shooting": Strategy(
            words="output error, open loop, 25 samples per interval", weights=(0.0,), multiple=True
        ),
    }
)


def cost_of(weight: float) -> Cost:
    """Output error at 0, equation error at 1, combined error between."""
    if weight == 0.0:
        return OutputError()
    return EquationError() if weight == 1.0 else CombinedError(equation_weight=weight)


def tasks(starts: int, manoeuvres: Iterable[int] = tuple(MANOEUVRES)) -> dict[str, dict[str, Any]]:
    """Key -> task for `run`; `starts` random starts for every strategy."""
    found: dict[str, dict[str, Any]] = {}
    for case in CURVE_CASES:
        for manoeuvre in manoeuvres:
            variant = CURVE_VARIANT if CASES[case].nonlinear else 0
            head = {"case": case, "manoeuvre": manoeuvre, "variant": variant, "seed": 1}
            for weight in WEIGHTS:
                found[f"curve/{case}/{weight:g}/m{manoeuvre}"] = {**head, "kind": "curve", "weight": weight}
            for noise in NOISES if not CASES[case].nonlinear else ():
                found[f"statistical/{case}/{noise}/m{manoeuvre}"] = {**head, "kind": "statistical", "noise": noise}
    for aircraft in AIRCRAFT:
        for strategy in STRATEGIES:
            for seed in range(starts):
                task = {"kind": "schedule", "aircraft": aircraft, "strategy": strategy, "start": seed}
                found[f"schedule/{aircraft}/{strategy}/{seed:03d}"] = task
    return found


@lru_cache(maxsize=4)
def _flight(condition: Condition) -> Flight:
    return fly(condition)


def run(task: Mapping[str, Any]) -> dict[str, Any]:
    """Statistics of eq. 17 (curve, statistical), or whether the right optimum was found (schedule)."""
    if task["kind"] == "schedule":
        return _run_schedule(task)
    flight = _flight(Condition(**{name: task[name] for name in ("case", "manoeuvre", "variant", "seed")}))
    sigma = noise_sigma(flight.exact)
    if task["kind"] == "curve":
        problem = paper_problem(flight, cost_of(task["weight"]))
    elif task["noise"] == "table 4":
        problem = paper_problem(flight, cost_of(0.5), noise={n: sigma[n] for n in (*OUTPUTS, *COEFFICIENTS)})
    else:
        problem = paper_problem(flight, cost_of(0.5), noise=task["noise"])
    fit = solve(problem, _MULTIPLE, _SOLVER)
    motion = simulated(flight, fit.values)
    numbers = statistics(flight, fit.values, motion)
    return {
        "converged": fit.converged,
        "departed": departed(motion),
        "statistics": {name: v if math.isfinite(v) else None for name, v in numbers.items()},
    }


def follow(flight: Flight, strategy: Strategy, start: Mapping[str, float]) -> tuple[Fit, int]:
    """(last fit, iterations in all) of a strategy. A sweep that leaves the numbers ends there."""
    values, spent = dict(start), 0
    if strategy.from_equation:
        fit = solve(paper_problem(flight, EquationError(), start=values), _MULTIPLE, _SOLVER)
        values, spent = fit.values, fit.iterations
    method = _MULTIPLE if strategy.multiple else SingleShooting()
    for weight in strategy.weights[:-1]:
        problem = paper_problem(flight, cost_of(weight), closed=True, start=values)
        fit = solve(problem, method, GaussNewton(iterations=1))
        values, spent = fit.values, spent + fit.iterations
    problem = paper_problem(flight, cost_of(strategy.weights[-1]), closed=not strategy.multiple, start=values)
    fit = solve(problem, method, _SOLVER)
    return fit, spent + fit.iterations


@cache
def _optimum(aircraft: str, strategy: str) -> Fit:
    flight, chosen = _flight(AIRCRAFT[aircraft]), STRATEGIES[strategy]
    last = Strategy(words="", weights=chosen.weights[-1:], multiple=chosen.multiple)
    return follow(flight, last, {name: flight.derivatives[name] for name in MOMENT_DERIVATIVES})[0]


def _run_schedule(task: Mapping[str, Any]) -> dict[str, Any]:
    aircraft, strategy = task["aircraft"], task["strategy"]
    flight, right = _flight(AIRCRAFT[aircraft]), _optimum(aircraft, strategy)
    fit, iterations = follow(flight, STRATEGIES[strategy], random_start(aircraft, task["start"]))
    away = max(abs(fit[n].value - right[n].value) / right[n].std for n in MOMENT_DERIVATIVES)
    truth = flight.derivatives
    names = [n for n in MOMENT_DERIVATIVES if not n.endswith("_0")]
    error = float(np.sqrt(np.mean([(fit[n].value / truth[n] - 1.0) ** 2 for n in names])))
    return {
        "right": bool(away < RIGHT),
        "claimed": fit.converged,
        "iterations": iterations,
        "error": error if math.isfinite(error) else None,
    }
