"""Dry friction by sign(v). Truth: the values that flew, simulated by Radau's method with a friction of its own."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casid.estimation import Problem, solve
from casid.estimation.switching import without_switching
from casid.model.system import define_model
from casid.records.record import Record

TRUTH = {"k": 4.0, "mu": 1.0, "g": 2.0}
_NOISE = 0.01


def sliding(mu: float, seen: list[str], unit: float = 1.0) -> Problem:
    """A mass on a spring that is pushed to and fro; with mu = 1 it sticks at every turn."""
    t = np.linspace(0.0, 10.0, 501)
    u = np.sin(1.7 * t) + 0.5 * np.sin(0.6 * t)

    def rates(at: float, x: np.ndarray) -> list[float]:
        return [x[1], 2.0 * np.interp(at, t, u) - 4.0 * x[0] - mu * np.tanh(x[1] / 1e-4)]

    X = solve_ivp(rates, (0.0, 10.0), [0.5, 0.0], "Radau", t, rtol=1e-8, atol=1e-10, max_step=0.02).y.T
    Z = unit * (X + _NOISE * np.random.default_rng(0).standard_normal(X.shape))
    truth = {"k": 4.0, "mu": unit * mu, "g": unit * 2.0}
    model = define_model(
        "sliding",
        states=("x", "v"),
        inputs=("u",),
        parameters=truth,
        outputs=seen,
        dynamics=lambda s: {"x": s.v, "v": s.g * s.u - s.k * s.x - s.mu * np.sign(s.v)},
        output=lambda s: {name: getattr(s, name) for name in seen},
    )
    channels = {"u": u} | {name: Z[:, "xv".index(name)] for name in seen}
    start = {name: value * 1.3 ** (-1) ** i for i, (name, value) in enumerate(truth.items())}
    return Problem(model, [Record(name="r", t=t, channels=channels)], free=["*"], start=start)


@pytest.mark.parametrize("mu", [0.3, 1.0])
@pytest.mark.parametrize("seen", [["x", "v"], ["x"]])
def test_dry_friction_is_found_also_where_it_sticks(mu, seen):
    fit = solve(sliding(mu, seen))
    assert fit.converged and "sign(" in fit.remarks[0]
    for name, true in {**TRUTH, "mu": mu}.items():
        assert abs(fit[name].value - true) < 4.0 * fit[name].std
        assert abs(fit[name].value - true) < 0.02 * true


def test_a_sign_is_continuous_in_any_unit_and_the_rest_stays():
    one, other = (list(without_switching(sliding(1.0, ["x", "v"], unit))) for unit in (1.0, 1e4))
    for (small, _), (large, _) in zip(one, other, strict=True):
        values = []
        for problem, unit in ((small, 1.0), (large, 1e4)):
            model, p = problem.model, np.array([4.0, unit, 2.0 * unit])
            f = ca.Function("f", [model.x, model.u, model.p], [model.f])
            values.append([f([0.1 * unit, v * unit], [0.3], p).full()[:, 0] / unit for v in (-1.0, -1e-4, 0.0, 2.0)])
        assert np.allclose(*values, rtol=1e-12)
        fast = 2.0 * 0.3 - 4.0 * 0.1
        assert np.allclose([values[0][0][1], values[0][2][1], values[0][3][1]], [fast + 1.0, fast, fast - 1.0])


def test_what_does_not_switch_is_taken_as_it_is():
    problem = sliding(0.3, ["x"])
    signs_of_inputs = define_model(
        "by input",
        states=("x",),
        inputs=("u",),
        parameters={"k": 1.0},
        outputs=("x",),
        dynamics=lambda s: {"x": np.sign(s.u) - s.k * s.x},
        output=lambda s: {"x": s.x},
    )
    ((same, remark),) = without_switching(Problem(signs_of_inputs, problem.records, free=["*"]))
    assert same.model is signs_of_inputs and remark == ""
