"""One unit of work of Table 5: simulate one record, estimate it by all three estimators in one method, compare."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

from problems.do328 import MOMENT_DERIVATIVES
from problems.paper.cases import CASES, Condition, conditions
from problems.paper.estimation import ESTIMATORS, estimate
from problems.paper.statistics import STATISTICS, departed, simulated, statistics
from problems.paper.truth import CM_ALPHA_DESTABILISED, OUTPUTS, Flight, fly


def tasks(
    cases: Iterable[str],
    manoeuvres: Iterable[int],
    methods: Iterable[str],
    Cm_alpha: float = CM_ALPHA_DESTABILISED,
) -> dict[str, dict[str, Any]]:
    """Key -> task for `run`; Cm_alpha is that of the destabilised aircraft, misprinted in Table 3.

    Without a control law both kinds of single shooting are the same, so only one is run.
    """
    chosen = tuple(methods)
    found = {}
    for condition in conditions(cases, manoeuvres):
        for method in dict.fromkeys(run_as(condition.case, method) for method in chosen):
            found[f"{condition.name}/{method}"] = {**vars(condition), "method": method, "Cm_alpha": Cm_alpha}
    return found


def run_as(case: str, method: str) -> str:
    """The method whose runs stand for `method` in a case."""
    return "single-open" if method == "single-closed" and not CASES[case].destabilised else method


@lru_cache(maxsize=2)
def _flight(condition: Condition, Cm_alpha: float) -> Flight:
    return fly(condition, Cm_alpha)


def run(task: Mapping[str, Any]) -> dict[str, Any]:
    """Estimator -> status, departed, iterations, seconds, statistics and values; plain numbers and text.

    Statistics that are no numbers (a motion that overflowed) are None.
    """
    condition = Condition(**{name: task[name] for name in ("case", "manoeuvre", "variant", "seed")})
    flight = _flight(condition, task["Cm_alpha"])
    results = {}
    for estimator in ESTIMATORS:
        fit = estimate(flight, estimator, task["method"])
        motion = simulated(flight, fit.values)
        numbers = statistics(flight, fit.values, motion)
        own = () if estimator == "equation" else (fit.predictions[condition.name][:, : len(OUTPUTS)],)
        results[estimator] = {
            "status": fit.status,
            "converged": fit.converged,
            "departed": any(map(departed, (motion, *own))),
            "iterations": fit.iterations,
            "seconds": fit.seconds,
            "statistics": {name: v if math.isfinite(v) else None for name, v in numbers.items()},
            "values": {name: fit.values[name] for name in MOMENT_DERIVATIVES},
        }
    return results


def table_rows(
    results: Mapping[str, Mapping[str, Any]], cases: Iterable[str], manoeuvres: Iterable[int], methods: Iterable[str]
) -> list[dict[str, Any]]:
    """Rows case, estimator, method, statistic, value: means over the records of a case that have not departed,
    departures and runs that did not converge counted. A case of which every run departed has no means."""
    rows = []
    manoeuvres, methods = tuple(manoeuvres), tuple(methods)
    for case in cases:
        names = [condition.name for condition in conditions([case], manoeuvres)]
        for method in methods:
            runs = [results[f"{name}/{run_as(case, method)}"] for name in names]
            for estimator in ESTIMATORS:
                own = [run[estimator] for run in runs]
                kept = [run["statistics"] for run in own if not run["departed"]]
                values = {s: math.fsum(k[s] for k in kept) / len(kept) for s in STATISTICS} if kept else {}
                values[f"departures_of_{len(own)}"] = sum(run["departed"] for run in own)
                values[f"not_converged_of_{len(own)}"] = sum(not run["converged"] for run in own)
                head = {"case": case, "estimator": estimator, "method": method}
                rows += [{**head, "statistic": name, "value": value} for name, value in values.items()]
    return rows
