"""What do estimates in a band of frequencies cost and lose beside those in time?

Question     Are they as near to the truth as equation and output error in time, at which price?
Set-up       20 s of a short period at 50 Hz, driven by 12 sines from 1 to 6 rad/s, solved by matrix exponentials.
             Output error: white noise of 0.002 rad and 0.004 rad/s on what is measured, from 70 % of the true values.
             Equation error: white noise of 0.01 and 0.02 rad/s2 on the state derivatives. The band is 0.3 to 14 rad/s.
             Tracking is without forgetting, at 46 frequencies, with an estimate every second. Error: r.m.s. over the
             draws and parameters, each over its size. Covered: intervals of 95 % that hold the truth. Seconds: the
             least of the repetitions, processor time.
Expectation  Errors within 5 %, intervals that hold as often, and times of the same order.

    python benchmarks/bench_fourier.py [--repeats 60] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.linalg import expm

import casid as cs
from problems.bench.table import parser, processor_seconds_of, publish

TRUTH = {"Za": -1.2, "Zde": -0.15, "Ma": -4.0, "Mq": -1.8, "Mde": -6.0}
T, BAND = 0.02 * np.arange(1000), (0.3, 14.0)
OUTPUTS, EQUATIONS = {"alpha": 0.002, "q": 0.004}, {"alphadot": 0.01, "qdot": 0.02}

Estimate = tuple[np.ndarray, np.ndarray]  # values and standard deviations


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--repeats", type=int, default=60, help="draws, of which the fastest counts")
    given = options.parse_args()
    rng, clean = np.random.default_rng(0), _flown()
    outputs, equations = ([_noisy(clean, one, rng) for _ in range(given.repeats)] for one in (OUTPUTS, EQUATIONS))
    methods: dict[str, tuple[Callable[[cs.Record], Estimate], list[cs.Record]]] = {
        "OutputError": (_by(cs.OutputError()), outputs),
        "FourierOutputError": (_by(cs.FourierOutputError(band=BAND)), outputs),
        "EquationError": (_by(cs.EquationError()), equations),
        "FourierEquationError": (_by(cs.FourierEquationError(band=BAND)), equations),
        "track_derivatives": (_tracked, equations),
    }
    rows = []
    for name, (estimate, records) in methods.items():
        found = [estimate(record) for record in records]
        seconds = processor_seconds_of(lambda e=estimate, r=records[0]: e(r), min(given.repeats, 10))
        rows.append(_row(name, found, min(seconds)))
    publish(rows, given.json)


def _model() -> cs.Model:
    return cs.define_model(
        "short period",
        states=["alpha", "q"],
        inputs=["delta_e"],
        parameters={name: 0.7 * value for name, value in TRUTH.items()},
        outputs=["alpha", "q"],
        dynamics=lambda s: {
            "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
            "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e,
        },
        output=lambda s: {"alpha": s.alpha, "q": s.q},
    )


MODEL = _model()


def _flown() -> cs.Record:
    """From a start that is not at rest, with the input on straight lines between samples."""
    u = 0.01 * np.sin(np.outer(T, 2.0 * np.pi / 13.0 * np.arange(2, 14)) + np.arange(12) ** 2).sum(axis=1)
    a, b = np.array([[TRUTH["Za"], 1.0], [TRUTH["Ma"], TRUTH["Mq"]]]), np.array([TRUTH["Zde"], TRUTH["Mde"]])
    big = np.zeros((4, 4))
    big[:2, :2], big[:2, 2], big[2, 3] = a, b, 1.0
    step = expm(big * T[1])[:2]
    x = np.zeros((len(T), 2))
    x[0] = 0.01, -0.02
    for k in range(len(T) - 1):
        x[k + 1] = step @ [*x[k], u[k], (u[k + 1] - u[k]) / T[1]]
    slopes = x @ a.T + np.outer(u, b)
    columns = {"alpha": x[:, 0], "q": x[:, 1], "alphadot": slopes[:, 0], "qdot": slopes[:, 1]}
    return cs.Record(name="m1", t=T, channels={"delta_e": u, **columns})


def _noisy(record: cs.Record, noise: Mapping[str, float], rng: np.random.Generator) -> cs.Record:
    return record.with_channels(**{n: record[n] + s * rng.standard_normal(len(T)) for n, s in noise.items()})


def _by(cost: Any) -> Callable[[cs.Record], Estimate]:
    def estimate(record: cs.Record) -> Estimate:
        fit = cs.solve(cs.Problem(MODEL, [record], free=["*"], cost=cost))
        return np.array(list(fit.values.values())), np.sqrt(np.diagonal(fit.covariance))

    return estimate


def _tracked(record: cs.Record) -> Estimate:
    *_, end = cs.track_derivatives(MODEL, record, free=["*"], omega=np.arange(0.3, 14.0, 0.3))
    return np.array(list(end.values.values())), np.array(list(end.std.values()))


def _row(name: str, found: list[Estimate], seconds: float) -> dict[str, Any]:
    truth = np.array(list(TRUTH.values()))
    values, std = (np.array(part) for part in zip(*found, strict=True))
    return {
        "estimate": name,
        "error": float(np.sqrt(np.mean(((values - truth) / truth) ** 2))),
        "covered": float(np.mean(np.abs(values - truth) < 1.96 * std)),
        "seconds": seconds,
    }


if __name__ == "__main__":
    run_script(main)
