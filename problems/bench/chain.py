"""A chain of masses between two walls, with springs and dampers of its own each: a smooth model of any size.

Hardening springs, one force on the first mass, every position measured. The parameters repeat along the chain where
there are fewer of them than masses. Truth is `cs.simulate`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casid.estimation import Problem
from casid.model.simulate import simulate
from casid.model.system import Model, define_model
from casid.records.record import Record

_DT, _NOISE, _START = 0.1, 0.01, 1.15  # s, m, times the truth
_HARDENING = 0.1  # 1/m^2


def chain_truth(parameters: int) -> dict[str, float]:
    """Half of them springs [1/s^2], half dampers [1/s], of unit masses."""
    half = range(parameters // 2)
    return {f"k{i}": 1.0 + 0.3 * np.sin(i) for i in half} | {f"c{i}": 0.2 + 0.05 * np.cos(i) for i in half}


def _chain(states: int, parameters: int) -> Model:
    masses, kinds = range(states // 2), parameters // 2

    def force(s: Any, spring: int, stretch: Any) -> Any:
        return getattr(s, f"k{spring % kinds}") * (stretch + _HARDENING * stretch**3)

    def rates(s: Any) -> dict[str, Any]:
        x = [0.0, *(getattr(s, f"x{i}") for i in masses), 0.0]
        found = {f"x{i}": getattr(s, f"v{i}") for i in masses}
        for i in masses:
            pull = force(s, i + 1, x[i + 2] - x[i + 1]) - force(s, i, x[i + 1] - x[i])
            found[f"v{i}"] = pull - getattr(s, f"c{i % kinds}") * getattr(s, f"v{i}") + (s.u if i == 0 else 0.0)
        return found

    return define_model(
        "chain",
        states=[f"x{i}" for i in masses] + [f"v{i}" for i in masses],
        inputs=["u"],
        parameters=chain_truth(parameters),
        outputs=[f"y{i}" for i in masses],
        dynamics=rates,
        output=lambda s: {f"y{i}": getattr(s, f"x{i}") for i in masses},
    )


def chain_problem(states: int, parameters: int, samples: int = 1001) -> Problem:
    """All parameters from 1.15 times the truth; the force is noise of a bandwidth of 1 Hz."""
    model, rng = _chain(states, parameters), np.random.default_rng(0)
    force = np.repeat(2.0 * rng.standard_normal(samples // 10 + 1), 10)[:samples]
    record = Record(
        name="r", t=_DT * np.arange(samples), channels={"u": np.convolve(force, np.full(5, 0.2), mode="same")}
    )
    flown = simulate(model, record, np.zeros(states)).as_record()
    noisy = {name: flown[name] + _NOISE * rng.standard_normal(samples) for name in model.outputs}
    truth = chain_truth(parameters)
    start = {name: _START * value for name, value in truth.items()}
    return Problem(model, [flown.with_channels(**noisy)], free=list(truth), start=start)
