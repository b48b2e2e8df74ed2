"""Do intervals contain the truth as often as they say? A short period flown many times, under three kinds of error.

A linear short period with five unknown derivatives and a free initial state, 10 s at 25 Hz of a 3-2-1-1 on the
elevator. Simulated by matrix exponentials, not by the step of the estimator. One task is one flight, its estimation
and every kind of interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.stats import binom

from casid.estimation import Problem, bootstrap, input_noise_errors, profile, solve, with_noisy_inputs
from casid.estimation.filter_error import filter_error
from casid.model.system import Model, define_model
from casid.records.record import Record

TRUTH = MappingProxyType({"Za": -1.2, "Zde": -0.15, "Ma": -4.0, "Mq": -1.8, "Mde": -6.0})
NOISE = MappingProxyType({"alpha": 0.002, "q": 0.004})  # rad, rad/s
SURFACE_NOISE = 0.003  # rad, 6 % of the largest deflection
LAG_ONE = 0.9  # correlation of the coloured noise from one sample to the next
CONDITIONS: Mapping[str, str] = MappingProxyType({
    "clean": "white measurement noise, exact inputs",
    "surfaces": f"white measurement noise, elevator measured with noise of {SURFACE_NOISE} rad",
    "coloured": f"measurement noise of the same size with correlation {LAG_ONE} from sample to sample",
})  # fmt: skip
LEVEL, NORMAL = 0.95, 1.959963984540054
KINDS: Mapping[str, str] = MappingProxyType({
    "cramer_rao": "Cramer-Rao", "corrected": "corrected for coloured residuals",
    "input_noise": "Cramer-Rao with the noise of the inputs", "profile": "profile likelihood",
    "bootstrap": "parametric bootstrap, white noise", "bootstrap_inputs": "parametric bootstrap with noisy inputs",
    "filter": "filter error, noise of the inputs estimated",
})  # fmt: skip
# with exact inputs the kinds that know their noise are the plain ones
KINDS_OF: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "clean": ("cramer_rao", "corrected", "profile", "bootstrap"),
    "surfaces": tuple(KINDS), "coloured": ("cramer_rao", "corrected", "profile", "bootstrap"),
})  # fmt: skip


@cache
def short_period() -> Model:
    """States alpha, q; input delta_e; both states measured."""
    return define_model(
        "short period", states=("alpha", "q"), inputs=("delta_e",), parameters=TRUTH, outputs=("alpha", "q"),
        dynamics=lambda s: {
            "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
            "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e,
        },
        output=lambda s: {"alpha": s.alpha, "q": s.q},
    )  # fmt: skip


@cache
def _with_noise() -> Model:
    return with_noisy_inputs(short_period(), "delta_e")


@cache
def flight() -> Record:
    """The flight as it was, without any noise."""
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
    return Record(name="m1", t=t, channels={"delta_e": u, "alpha": x[:, 0], "q": x[:, 1]}, hold="held")


def measured(condition: str, seed: int) -> Record:
    """The flight with the errors of a condition; the same seed gives the same numbers."""
    rng, truth = np.random.default_rng([seed, list(CONDITIONS).index(condition)]), flight()
    drawn = {}
    for name, sigma in NOISE.items():
        noise = rng.standard_normal(len(truth))
        if condition == "coloured":
            for k in range(1, len(noise)):
                noise[k] = LAG_ONE * noise[k - 1] + np.sqrt(1.0 - LAG_ONE**2) * noise[k]
        drawn[name] = truth[name] + sigma * noise
    if condition == "surfaces":
        drawn["delta_e"] = truth["delta_e"] + SURFACE_NOISE * rng.standard_normal(len(truth))
    return truth.with_channels(**drawn)


def tasks(conditions: Iterable[str], runs: int, kinds: Sequence[str], draws: int) -> dict[str, dict[str, Any]]:
    """Key -> task for `run`; `draws` of each bootstrap."""
    return {
        f"{condition}/{seed:04d}": {"condition": condition, "seed": seed, "kinds": list(kinds), "draws": draws}
        for condition in conditions
        for seed in range(runs)
    }


def run(task: Mapping[str, Any]) -> dict[str, Any]:
    """kind -> {parameter: [estimate, lower, upper]} of one flight; a kind that failed is None."""
    condition = task["condition"]
    fit = solve(Problem(short_period(), [measured(condition, task["seed"])], free=["*"]))
    sigma = {"delta_e": SURFACE_NOISE}
    found: dict[str, Any] = {}
    for kind in (k for k in task["kinds"] if k in KINDS_OF[condition]):
        if not fit.converged:
            found[kind] = None
        elif kind in ("cramer_rao", "corrected"):
            std = {n: e.std if kind == "cramer_rao" else e.std_corrected for n, e in fit.parameters.items()}
            found[kind] = _normal(fit.values, std)
        elif kind == "input_noise":
            found[kind] = _normal(fit.values, input_noise_errors(fit, sigma).std)
        elif kind == "profile":
            ends = profile(fit, TRUTH, level=LEVEL)
            found[kind] = {n: [p.value, p.lower, p.upper] for n, p in ends.items()}
            if not all(p.status == "found" for p in ends.values()):
                found[kind] = None
        elif kind == "filter":
            filtered = filter_error(Problem(_with_noise(), fit.problem.records, free=["*"]), {"noise_delta_e": 0.0})
            found[kind] = _normal(filtered.values, filtered.std) if filtered.converged else None
        else:
            noise = sigma if kind == "bootstrap_inputs" else {}
            drawn = bootstrap(fit, task["draws"], task["seed"], input_noise=noise)
            found[kind] = {n: [fit.values[n], *drawn.interval(n, LEVEL)] for n in TRUTH}
    return found


def _normal(values: Mapping[str, float], std: Mapping[str, float]) -> dict[str, list[float]]:
    return {n: [values[n], values[n] - NORMAL * std[n], values[n] + NORMAL * std[n]] for n in TRUTH}


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
        for kind in (k for k in KINDS if any(k in result for result in own)):
            tried = [result[kind] for result in own if kind in result]
            kept = [result for result in tried if result is not None]
            if len(kept) < 2:
                continue
            ends = np.array([[result[name] for name in TRUTH] for result in kept])
            truth = np.array(list(TRUTH.values()))
            inside = ((ends[..., 1] <= truth) & (truth <= ends[..., 2])).mean(axis=0)
            width = (ends[..., 2] - ends[..., 1]).mean(axis=0) / 2 / (NORMAL * ends[..., 0].std(axis=0, ddof=1))
            low, high = (float(binom.ppf(q, len(kept), LEVEL)) / len(kept) for q in (0.025, 0.975))
            rows.append(Coverage(
                condition=condition, kind=kind, runs=len(kept), failed=len(tried) - len(kept),
                share=float(inside.mean()), parameters=dict(zip(TRUTH, inside.tolist(), strict=True)),
                width=dict(zip(TRUTH, width.tolist(), strict=True)), low=low, high=high,
            ))  # fmt: skip
    return rows
