"""Single against multiple shooting and collocation: who finds the right optimum, from how far, in what time.

One noisy record of the stable and of the destabilised aircraft, open loop on measured surfaces, output error with the
true noise as weights. "Success" does not ask the solver: it means that the parameters are those of the optimum, to
RIGHT of its standard deviations; the optimum is found from the truth, by the method itself where defects are soft and
by one reference for all others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.estimation import Collocation, Fit, GaussNewton, MultipleShooting, OutputError, SingleShooting, solve
from casid.estimation.transcriptions.transcription import Transcription
from problems.do328 import MOMENT_DERIVATIVES
from problems.paper.cases import Condition
from problems.paper.estimation import START_FACTOR, paper_problem
from problems.paper.truth import OUTPUTS, SURFACES, Flight, fly, noise_sigma

AIRCRAFT: Mapping[str, Condition] = MappingProxyType(
    {"stable": Condition(case="B", manoeuvre=5, seed=1), "destabilised": Condition(case="D", manoeuvre=5, seed=1)}
)
INTERVALS = (1, 5, 10, 25, 50, 100)
HARD = ("single", *(f"multiple {n}" for n in INTERVALS), "collocation")
SOFT = tuple(f"soft {n}" for n in INTERVALS)
METHODS = (*HARD, *SOFT)
BASIN_METHODS = ("single", "multiple 25", "multiple 10")
BASIN_PARAMETERS = ("Cm_alpha", "Cn_beta")
BASIN_FACTORS = tuple(float(f) for f in np.linspace(-2.0, 4.0, 7))
RIGHT = 0.05  # standard deviations
ITERATIONS, FLIPPED = 60, 0.2
REFERENCE = "multiple 10"


@cache
def _flight(aircraft: str) -> Flight:
    return fly(AIRCRAFT[aircraft])


def transcription(method: str, flight: Flight) -> Transcription:
    """The method of that name. Soft defects: the noise of the measured surfaces drives the states, which is the truth
    here: white, held over a sample, of known size."""
    kind, _, length = method.partition(" ")
    if kind == "single":
        return SingleShooting()
    if kind == "collocation":
        return Collocation(degree=3)
    noise = None
    if kind == "soft":
        sigma = noise_sigma(flight.exact)
        noise = {f"d_{name}": sigma[name] * math.sqrt(flight.exact.dt) for name in SURFACES}
    return MultipleShooting(interval=int(length), process_noise=noise)


def _solve(aircraft: str, method: str, start: Mapping[str, float]) -> Fit:
    flight = _flight(aircraft)
    sigma = noise_sigma(flight.exact)
    problem = paper_problem(flight, OutputError(), start=start, noise={name: sigma[name] for name in OUTPUTS})
    return solve(problem, transcription(method, flight), GaussNewton(iterations=ITERATIONS, seconds=60.0))


@cache
def optimum(aircraft: str, method: str) -> Fit:
    """The right optimum: found from the truth. Hard defects of any length have the same one, so one stands for all."""
    truth = {name: _flight(aircraft).derivatives[name] for name in MOMENT_DERIVATIVES}
    return _solve(aircraft, method if method in SOFT else REFERENCE, truth)


def random_start(aircraft: str, seed: int) -> dict[str, float]:
    """U(0, 2) times the truth, a fifth of the signs flipped; the same for every method."""
    rng = np.random.default_rng((1, seed))
    factors = rng.uniform(0.0, 2.0, len(MOMENT_DERIVATIVES))
    factors *= np.where(rng.uniform(size=len(factors)) < FLIPPED, -1.0, 1.0)
    truth = _flight(aircraft).derivatives
    return {name: float(f * truth[name]) for name, f in zip(MOMENT_DERIVATIVES, factors, strict=True)}


def tasks(starts: int, methods: Iterable[str], basin: bool) -> dict[str, dict[str, Any]]:
    """Key -> task for `run`: the start of the paper (0.7 times the truth), random starts, and the grid of the basin."""
    chosen, found = tuple(methods), {}
    for aircraft in AIRCRAFT:
        for method in chosen:
            head = {"aircraft": aircraft, "method": method}
            found[f"{aircraft}/{method}/paper"] = {**head, "kind": "paper", "at": None}
            for seed in range(starts):
                found[f"{aircraft}/{method}/random {seed:03d}"] = {**head, "kind": "random", "at": seed}
            for pair in _grid() if basin and method in BASIN_METHODS else ():
                found[f"{aircraft}/{method}/basin {pair[0]:+.1f} {pair[1]:+.1f}"] = {
                    **head,
                    "kind": "basin",
                    "at": list(pair),
                }
    return found


def _grid() -> list[tuple[float, float]]:
    return [(first, second) for first in BASIN_FACTORS for second in BASIN_FACTORS]


def start_of(task: Mapping[str, Any]) -> dict[str, float]:
    """Start values of a task."""
    truth = _flight(task["aircraft"]).derivatives
    if task["kind"] == "random":
        return random_start(task["aircraft"], task["at"])
    start = {name: START_FACTOR * truth[name] for name in MOMENT_DERIVATIVES}
    if task["kind"] == "basin":
        start |= {name: factor * truth[name] for name, factor in zip(BASIN_PARAMETERS, task["at"], strict=True)}
    return start


def run(task: Mapping[str, Any]) -> dict[str, Any]:
    """What one estimation gave: right or wrong optimum, what the solver said, cost, error, iterations, seconds.

    away    distance from the right optimum in its standard deviations, the largest over the parameters
    error   largest relative error against the truth, offsets left out
    """
    aircraft, method = task["aircraft"], task["method"]
    right = optimum(aircraft, method)
    fit = _solve(aircraft, method, start_of(task))
    truth = _flight(aircraft).derivatives
    away = max(abs(fit[n].value - right[n].value) / right[n].std for n in MOMENT_DERIVATIVES)
    error = max(abs(fit[n].value / truth[n] - 1.0) for n in MOMENT_DERIVATIVES if not n.endswith("_0"))
    return {
        "right": bool(away < RIGHT),
        "claimed": fit.converged,
        "status": fit.status,
        "away": _plain(away),
        "error": _plain(error),
        "cost": _plain(fit.cost),
        "iterations": fit.iterations,
        "seconds": fit.seconds,
    }


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
