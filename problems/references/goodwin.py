"""Goodwin's oscillator (Adv. Enzyme Regul. 3, 1965) as a test of starts: three substances of which two are seen."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from casid.estimation import Problem
from casid.model.system import define_model
from casid.records.record import Record

TRUTH = {"k1": 1.0, "k2": 0.1, "k3": 1.0, "k4": 0.1, "k5": 1.0, "k6": 0.1}
_STATES = ("X", "Y", "Z")
_NOISE = 0.02  # of a channel's range


def goodwin(off: float, seed: int = 0) -> Problem:
    """X and Y read 120 times in 120 s from rest, Z not; the noise is estimated. Parameters start times and over `off`
    in turns."""
    k1, k2, k3, k4, k5, k6 = TRUTH.values()

    def rates(_: float, x: np.ndarray) -> list[float]:
        return [k1 / (1.0 + x[2] ** 10) - k2 * x[0], k3 * x[0] - k4 * x[1], k5 * x[1] - k6 * x[2]]

    t, rng = np.arange(1.0, 121.0), np.random.default_rng(seed)
    x = solve_ivp(rates, (0.0, 120.0), [0.0, 0.0, 0.0], "LSODA", t, rtol=1e-10, atol=1e-12).y
    read = {s: x[i] + _NOISE * np.ptp(x[i]) * rng.standard_normal(120) for i, s in enumerate(_STATES[:2])}
    channels = {s: np.concatenate([[np.nan], y]) for s, y in read.items()}
    record = Record(name="goodwin", t=np.concatenate([[0.0], t]), channels=channels)
    model = define_model(
        "Goodwin",
        states=_STATES,
        inputs=(),
        parameters=TRUTH,
        outputs=["X", "Y"],
        dynamics=lambda s: {
            "X": s.k1 / (1.0 + s.Z**10) - s.k2 * s.X,
            "Y": s.k3 * s.X - s.k4 * s.Y,
            "Z": s.k5 * s.Y - s.k6 * s.Z,
        },
        output=lambda s: {"X": s.X, "Y": s.Y},
        initial=lambda _: dict.fromkeys(_STATES, 0.0),
    )
    start = {name: value * off ** (-1) ** i for i, (name, value) in enumerate(TRUTH.items())}
    return Problem(model, [record], free=["*"], start=start)
