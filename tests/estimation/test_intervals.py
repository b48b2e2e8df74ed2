"""Intervals of few readings: the share of drawn records whose 95 % interval holds the truth."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs

RUNS = 300


@pytest.mark.parametrize("given", [True, False], ids=["noise given", "noise estimated"])
@pytest.mark.parametrize("count", [6, 12])
def test_intervals_of_a_regression_hold_the_truth(count, given):
    """Rooney and Biegler's saturating curve (AIChE J. 47, 2001); 95 % +- 1.26 % at one deviation, three are allowed."""
    h, truth = np.linspace(1.0, 7.0, count), {"theta": 19.0, "rate": 0.5}
    model = cs.define_regression(
        "saturating",
        inputs=["h"],
        parameters=truth,
        outputs=["y"],
        output=lambda s: {"y": s.theta * (1 - np.exp(-s.rate * s.h))},
    )
    held = dict.fromkeys(truth, 0)
    for seed in range(RUNS):
        y = 19.0 * (1 - np.exp(-0.5 * h)) + np.random.default_rng([count, seed]).standard_normal(count)
        record = cs.Record(name="r", t=np.arange(float(count)), channels={"h": h, "y": y})
        problem = cs.Problem(model, record, free=["*"], noise={"y": 1.0} if given else None)
        fit = cs.solve(problem, starts=1)
        for name, value in truth.items():
            low, high = fit[name].interval
            held[name] += low <= value <= high
    chance = 3.0 * np.sqrt(0.95 * 0.05 / RUNS)
    for name, count_held in held.items():
        assert abs(count_held / RUNS - 0.95) < chance, (name, count_held / RUNS)
