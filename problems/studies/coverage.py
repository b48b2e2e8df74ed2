"""Do intervals contain the truth as often as they say? Two flights estimated many times, under several kinds of error.

A linear short period with five unknown derivatives and a free initial state, 10 s at 25 Hz of a 3-2-1-1 on the
elevator, simulated by matrix exponentials and not by the step of the estimator; and the Do 328 of the paper with its
16 moment derivatives, 20 s at 50 Hz of all axes, noise of the sizes of the paper's Table 4. One task is one flight,
its estimation and every kind of interval.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import binom

from casid.analysis import bootstrap, profile
from casid.estimation import Fit, OutputError, Problem, solve
from casid.filtering.cost import FilterError
from casid.model.system import Model, define_model
from casid.records.record import Record
from problems.do328 import MOMENT_DERIVATIVES
from problems.paper.cases import Condition as PaperCondition
from problems.paper.estimation import paper_problem
from problems.paper.truth import OUTPUTS, SURFACES, fly, noise_sigma
from problems.studies.input_noise import input_noise_errors, with_noisy_inputs

TRUTH = MappingProxyType({"Za": -1.2, "Zde": -0.15, "Ma": -4.0, "Mq": -1.8, "Mde": -6.0})
NOISE = MappingProxyType({"alpha": 0.002, "q": 0.004})  # rad, rad/s
SURFACE_NOISE = 0.003  # rad, 6 % of the largest deflection
LAG_ONE = 0.9  # correlation of the coloured noise from one sample to the next
LEVEL, NORMAL = 0.95, 1.959963984540054
KINDS: Mapping[str, str] = MappingProxyType(
    {
        "cramer_rao": "Cramer-Rao",
        "corrected": "corrected for coloured residuals",
        "input_noise": "noise of the inputs, colour of the residuals",
        "profile": "profile likelihood",
        "bootstrap": "parametric bootstrap, white noise",
        "bootstrap_inputs": "parametric bootstrap with noisy inputs",
        "filter": "filter error, noise of the inputs estimated",
    }
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """A flight without noise: record, truth of the parameters, 1-sigma of outputs and of inputs, and the estimation
    problem of a measured record."""

    record: Record
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    input_noise: Mapping[str, float]
    problem: Callable[[Record], Problem]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A flight and the errors of its measurement; `kinds` of interval that are looked at (with exact inputs those that
    know of noisy inputs are the plain ones)."""

    words: str
    flight: Callable[[], Flown]
    surfaces: bool
    coloured: bool
    kinds: tuple[str, ...]


@cache
def short_period() -> Model:
    """States alpha, q; input delta_e; both states measured."""
    return define_model(
        "short period",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters=TRUTH,
        outputs=("alpha", "q"),
        dynamics=lambda s: {
            "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
            "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e,
        },
        output=lambda s: {"alpha": s.alpha, "q": s.q},
    )


@cache
def _with_noise() -> Model:
    return with_noisy_inputs(short_period(), "delta_e")


@cache
def flight() -> Flown:
    """The short period."""
    t = np.arange(250) / 25.0
    u = np.zeros(len(t))
    for start, stop, sign in ((1.0, 2.2, 1.0), (2.2, 3.0, -1.0), (3.0, 3.4, 1.0), (3.4, 3.8, -1.0)):
        u[(t >= start - 1e-9) & (t < stop - 1e-9)] = 0.05 * sign
    big = np.zeros((3, 3))
    big[:2] = [[TRUTH["Za"], 1.0, TRUTH["Zde"]], [TRUTH["Ma"], TRUTH["Mq"], TRUTH["Mde"]]]
    over = expm(big / 25.0)
    x = np.zeros((len(t), 2))
    for k in range(len(t) - 1):
        x[k + 1] = (over @ np.append(x[k], u[k]))[:2]
    return Flown(
        record=Record(name="m1", t=t, channels={"delta_e": u, "alpha": x[:, 0], "q": x[:, 1]}, hold="held"),
        truth=TRUTH,
        noise=NOISE,
        input_noise={"delta_e": SURFACE_NOISE},
        problem=lambda record: Problem(short_period(), [record], free=["*"]),
    )


@cache
def _do328(case: str) -> Flown:
    """Manoeuvre 5 of the paper's case A (stable) or C (destabilised, its control law flies it), open loop."""
    flown = fly(PaperCondition(case=case, manoeuvre=5))
    sigma = noise_sigma(flown.exact)
    return Flown(
        record=flown.surfaces,
        truth={n: flown.derivatives[n] for n in MOMENT_DERIVATIVES},
        noise={n: sigma[n] for n in OUTPUTS},
        input_noise={n: sigma[n] for n in SURFACES},
        problem=lambda record: paper_problem(replace(flown, surfaces=record), OutputError(), noise="residuals"),
    )


def stable() -> Flown:
    """The stable Do 328."""
    return _do328("A")


def destabilised() -> Flown:
    """The destabilised Do 328."""
    return _do328("C")


_PLAIN = ("cramer_rao", "corrected", "profile", "bootstrap")
_QUICK = ("cramer_rao", "corrected")
CONDITIONS: Mapping[str, Condition] = MappingProxyType(
    {
        "clean": Condition(
            words="short period, white measurement noise, exact inputs",
            flight=flight,
            surfaces=False,
            coloured=False,
            kinds=_PLAIN,
        ),
        "surfaces": Condition(
            words=f"short period, white measurement noise, elevator measured with noise of {SURFACE_NOISE} rad",
            flight=flight,
            surfaces=True,
            coloured=False,
            kinds=tuple(KINDS),
        ),
        "coloured": Condition(
            words=f"short period, measurement noise of the same size with correlation {LAG_ONE} from sample to sample",
            flight=flight,
            surfaces=False,
            coloured=True,
            kinds=_PLAIN,
        ),
        "both": Condition(
            words="short period, noisy elevator and coloured measurement noise",
            flight=flight,
            surfaces=True,
            coloured=True,
            kinds=tuple(KINDS),
        ),
        "do328": Condition(
            words="stable Do 328, white measurement noise, exact inputs",
            flight=stable,
            surfaces=False,
            coloured=False,
            kinds=_QUICK,
        ),
        "do328_surfaces": Condition(
            words="stable Do 328, noisy surfaces",
            flight=stable,
            surfaces=True,
            coloured=False,
            kinds=(*_QUICK, "input_noise"),
        ),
        "do328_both": Condition(
            words=f"stable Do 328, noisy surfaces and measurement noise with correlation {LAG_ONE}",
            flight=stable,
            surfaces=True,
            coloured=True,
            kinds=(*_QUICK, "input_noise"),
        ),
        "destabilised": Condition(
            words="destabilised Do 328, white measurement noise, exact inputs",
            flight=destabilised,
            surfaces=False,
            coloured=False,
            kinds=_QUICK,
        ),
        "destabilised_surfaces": Condition(
            words="destabilised Do 328, noisy surfaces",
            flight=destabilised,
            surfaces=True,
            coloured=False,
            kinds=(*_QUICK, "input_noise"),
        ),
    }
)


def measured(condition: str, seed: int) -> Record:
    """The flight with the errors of a condition; the same seed gives the same numbers."""
    how = CONDITIONS[condition]
    flown, rng = how.flight(), np.random.default_rng([seed, list(CONDITIONS).index(condition)])
    drawn = {}
    for name, sigma in flown.noise.items():
        noise = rng.standard_normal(len(flown.record))
        if how.coloured:
            noise[1:] *= np.sqrt(1.0 - LAG_ONE**2)
            noise = np.asarray(lfilter([1.0], [1.0, -LAG_ONE], noise))
        drawn[name] = flown.record[name] + sigma * noise
    if how.surfaces:
        for name, sigma in flown.input_noise.items():
            drawn[name] = flown.record[name] + sigma * rng.standard_normal(len(flown.record))
    return flown.record.with_channels(**drawn)


def tasks(conditions: Iterable[str], runs: int, kinds: Sequence[str], draws: int) -> dict[str, dict[str, Any]]:
    """Key -> task for `run`; `draws` of each bootstrap."""
    return {
        f"{condition}/{seed:04d}": {"condition": condition, "seed": seed, "kinds": list(kinds), "draws": draws}
        for condition in conditions
        for seed in range(runs)
    }


def run(task: Mapping[str, Any]) -> dict[str, Any]:
    """kind -> {parameter: [estimate, lower, upper]} of one flight; a kind that failed is None."""
    condition = CONDITIONS[task["condition"]]
    flown = condition.flight()
    fit = solve(flown.problem(measured(task["condition"], task["seed"])))
    kinds = [kind for kind in task["kinds"] if kind in condition.kinds]
    if not fit.converged:
        return dict.fromkeys(kinds)
    return {kind: _ends(kind, fit, flown, task) for kind in kinds}


def _ends(kind: str, fit: Fit, flown: Flown, task: Mapping[str, Any]) -> dict[str, list[float]] | None:
    """parameter -> [estimate, lower, upper] of one kind; None when it failed."""
    if kind == "cramer_rao":
        return _normal(fit.values, {n: e.std_cramer_rao for n, e in fit.parameters.items()})
    if kind == "corrected":
        return {n: [e.value, *e.interval] for n, e in fit.parameters.items()}
    if kind == "input_noise":
        return _normal(fit.values, input_noise_errors(fit, flown.input_noise).std)
    if kind == "profile":
        ends = profile(fit, list(flown.truth), level=LEVEL)
        found = all(p.status == "found" for p in ends.values())
        return {n: [p.value, p.lower, p.upper] for n, p in ends.items()} if found else None
    if kind == "filter":
        cost = FilterError(process_noise={"noise_delta_e": 0.0})
        filtered = solve(Problem(_with_noise(), fit.problem.records, free=["*"], cost=cost))
        return {n: [e.value, *e.interval] for n, e in filtered.parameters.items()} if filtered.converged else None
    noise = flown.input_noise if kind == "bootstrap_inputs" else {}
    drawn = bootstrap(fit, task["draws"], task["seed"], input_noise=noise)
    return {n: [fit.values[n], *drawn.interval(n, LEVEL)] for n in flown.truth}


def _normal(values: Mapping[str, float], std: Mapping[str, float]) -> dict[str, list[float]]:
    return {n: [values[n], values[n] - NORMAL * s, values[n] + NORMAL * s] for n, s in std.items() if n in values}


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """How often one kind of interval contained the truth.

    share       over all parameters and runs; `parameters` the same of each
    width       parameter -> mean half width over 1.96 times the scatter of the estimates
    low, high   what 95 % coverage gives in 19 of 20 studies for one parameter with as many runs (binomial)
    """

    condition: str
    kind: str
    runs: int
    failed: int
    share: float
    parameters: Mapping[str, float]
    width: Mapping[str, float]
    low: float
    high: float


def table(results: Mapping[str, Mapping[str, Any]]) -> list[Coverage]:
    """Coverage of every condition and kind in the results of `run`, by key."""
    rows = []
    for condition in CONDITIONS:
        own = [result for key, result in results.items() if key.startswith(f"{condition}/")]
        truth = CONDITIONS[condition].flight().truth
        for kind in (k for k in KINDS if any(k in result for result in own)):
            tried = [result[kind] for result in own if kind in result]
            kept = [result for result in tried if result is not None]
            if len(kept) < 2:
                continue
            ends = np.array([[result[name] for name in truth] for result in kept])
            at = np.array(list(truth.values()))
            inside = ((ends[..., 1] <= at) & (at <= ends[..., 2])).mean(axis=0)
            width = (ends[..., 2] - ends[..., 1]).mean(axis=0) / 2 / (NORMAL * ends[..., 0].std(axis=0, ddof=1))
            low, high = (float(binom.ppf(q, len(kept), LEVEL)) / len(kept) for q in (0.025, 0.975))
            rows.append(
                Coverage(
                    condition=condition,
                    kind=kind,
                    runs=len(kept),
                    failed=len(tried) - len(kept),
                    share=float(inside.mean()),
                    parameters=dict(zip(truth, inside.tolist(), strict=True)),
                    width=dict(zip(truth, width.tolist(), strict=True)),
                    low=low,
                    high=high,
                )
            )
    return rows
