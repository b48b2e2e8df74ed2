"""Truth: the minima of sums of squares that are known by formula."""

from __future__ import annotations

import time

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.estimation.starts import drawn


def wave(noise: float = 0.1) -> tuple[cs.Model, cs.Record]:
    """y = a sin(w x): beside the best frequency every side lobe is a minimum of its own."""
    model = cs.define_regression(
        "wave",
        inputs=["x"],
        parameters={"w": 1.0, "a": 1.0},
        outputs=["y"],
        output=lambda s: {"y": s.a * np.sin(s.w * s.x)},
    )
    x = np.linspace(0.0, 10.0, 200)
    y = 2.0 * np.sin(3.3 * x) + noise * np.random.default_rng(0).standard_normal(200)
    return model, cs.Record(name="m1", t=np.arange(200.0), channels={"x": x, "y": y})


def test_the_best_of_many_minima_is_returned_and_all_are_counted():
    model, record = wave()
    problem = cs.Problem(
        model, [record], free=["*"], noise={"y": 0.1}, constraints=[cs.limit_parameter("w", lower=0.5, upper=6.0)]
    )
    alone, fit = cs.solve(problem), cs.solve(problem, starts=12, seed=3)
    assert alone.converged and alone.starts is None and abs(alone["w"].value - 3.3) > 1.0
    assert "another minimum is lower" in alone.remarks[0] and not fit.remarks
    assert fit.converged and fit["w"].value == pytest.approx(3.3, abs=0.01) and fit.starts is not None
    # starts that are lost give way to others, five times as many at most
    assert 12 <= fit.starts.count <= 1 + 5 * 11 and sum(m.count for m in fit.starts.minima) == 12
    assert len(fit.starts.minima) > 1
    behind = [minimum.behind for minimum in fit.starts.minima]
    assert behind[0] == 0.0 and behind == sorted(behind)
    # with a given noise a minimum lies behind by its cost
    assert behind[1] == pytest.approx(fit.starts.minima[1].cost - fit.cost, rel=1e-9)
    assert "the best minimum" in str(fit) and f"of {fit.starts.count} ended" in repr(fit.starts)
    assert fit.problem is problem


def test_a_straight_line_has_one_minimum():
    model = cs.define_regression(
        "line", inputs=["x"], parameters={"a": 1.0}, outputs=["y"], output=lambda s: {"y": s.a * s.x}
    )
    x = np.linspace(1.0, 2.0, 30)
    y = 3.0 * x + 0.1 * np.random.default_rng(1).standard_normal(30)
    fit = cs.solve(cs.Problem(model, [cs.Record(name="m1", t=x, channels={"x": x, "y": y})], free=["a"]), starts=8)
    assert fit.starts is not None and [m.count for m in fit.starts.minima] == [8] and not fit.starts.lost
    assert fit["a"].value == pytest.approx(float(x @ y / (x @ x)), rel=1e-9)


def test_a_more_likely_end_is_taken_though_only_a_worse_one_converged():
    """The own start is a side lobe's minimum, and three steps do not suffice from elsewhere."""
    model, record = wave()
    limits = [cs.limit_parameter("w", lower=0.5, upper=6.0), cs.limit_parameter("a", lower=1.0, upper=3.0)]
    problem = cs.Problem(model, [record], free=["*"], noise={"y": 0.1}, constraints=limits)
    lobe = cs.solve(problem)
    again = cs.Problem(model, [record], free=["*"], noise={"y": 0.1}, constraints=limits, start=lobe.values)
    fit = cs.solve(again, solver=cs.GaussNewton(iterations=3), starts=16, seed=3)
    assert lobe.converged and abs(lobe["w"].value - 3.3) > 1.0
    assert fit.starts is not None and fit.starts.minima
    assert fit["w"].value == pytest.approx(3.3, abs=0.1) and fit.log_likelihood > lobe.log_likelihood + 100.0
    assert not fit.converged
    assert fit.starts.minima[0].behind == pytest.approx(fit.log_likelihood - lobe.log_likelihood, rel=1e-6)


def test_starts_are_drawn_between_limits_by_the_prior_or_over_decades():
    model = cs.define_regression(
        "three",
        inputs=["x"],
        parameters={"a": 1.0, "b": 2.0, "c": -5.0},
        outputs=["y"],
        output=lambda s: {"y": s.a + s.b * s.x + s.c * s.x**2},
        prior_std={"b": 0.1},
    )
    x = np.linspace(1.0, 2.0, 30)
    record = cs.Record(name="m1", t=x, channels={"x": x, "y": x})
    problem = cs.Problem(model, [record], free=["*"], constraints=[cs.limit_parameter("a", lower=-2.0, upper=4.0)])
    table = drawn(problem, 256, 5)
    a, b, c = (np.array([start[name] for start in table]) for name in "abc")
    assert a.mean() == pytest.approx(1.0, abs=0.05) and a.std() == pytest.approx(6.0 / np.sqrt(12.0), rel=0.02)
    assert b.mean() == pytest.approx(2.0, abs=0.005) and b.std() == pytest.approx(0.1, rel=0.03)
    decades = np.log10(-c / 5.0)
    assert (np.abs(decades) <= 1.0).all() and decades.std() == pytest.approx(2.0 / np.sqrt(12.0), rel=0.02)
    assert drawn(problem, 3, 5) == drawn(problem, 3, 5) != drawn(problem, 3, 6)


def test_a_start_at_zero_without_limits_has_no_range():
    model, record = wave()
    problem = cs.Problem(model, [record], free=["*"], start={"a": 0.0})
    with pytest.raises(InputError, match=r"no range for 'a'.*cs.limit_parameter\('a'"):
        cs.solve(problem, starts=3)
    with pytest.raises(InputError, match="starts"):
        cs.solve(problem, starts=0)


@pytest.mark.parametrize("solver", [cs.Automatic(), cs.GaussNewton(), cs.Ipopt(), cs.Ipopt(hessian="gauss-newton")])
def test_a_stationary_point_that_is_no_minimum_is_not_converged(solver):
    """(a^2 - 1)^2 has a maximum at 0."""
    model = cs.define_regression(
        "quartic",
        inputs=("x",),
        parameters={"a": 0.0, "b": 1.0},
        outputs=("y", "z"),
        output=lambda s: {"y": s.a**2 * s.x, "z": s.b * s.x + s.a},
    )
    x = np.linspace(1.0, 2.0, 20)
    record = cs.Record(name="m1", t=np.arange(20.0), channels={"x": x, "y": x, "z": x})
    problem = cs.Problem(model, [record], free=["*"], noise={"y": 0.1, "z": 1.0})
    fit = cs.solve(problem, solver=solver)
    assert not fit.converged or abs(fit["a"].value) > 0.9


def test_looking_for_lower_minima_costs_twice_the_solution_at_most():
    """Processor seconds of small fits by default beside those from one start, both warm."""
    rng = np.random.default_rng(0)
    h = np.array([1.0, 2, 3, 4, 5, 7, 9, 10, 12, 15])
    y = 19.0 * (1.0 - np.exp(-0.5 * h)) + rng.standard_normal(10)
    model = cs.define_regression(
        "rise",
        inputs=["h"],
        parameters={"a": 10.0, "b": 0.2},
        outputs=["y"],
        output=lambda s: {"y": s.a * (1.0 - np.exp(-s.b * s.h))},
    )
    t = np.linspace(0.0, 5.0, 40)
    decay = cs.define_model(
        "decay",
        states=["x"],
        inputs=[],
        parameters={"k": 0.3},
        outputs=["y"],
        dynamics=lambda s: {"x": -s.k * s.x},
        output=lambda s: {"y": s.x},
    )
    noisy = 3.0 * np.exp(-0.7 * t) + 0.1 * rng.standard_normal(40)
    problems = [
        cs.Problem(model, [cs.Record(name="r", t=h, channels={"h": h, "y": y})], free=["*"]),
        cs.Problem(decay, [cs.Record(name="r", t=t, channels={"y": noisy})], free=["k"]),
    ]

    def seconds(problem: cs.Problem, starts: int | None) -> float:
        least = np.inf
        for _ in range(8):
            begin = time.process_time()
            cs.solve(problem, starts=starts)
            least = min(least, time.process_time() - begin)
        return least

    for problem in problems:
        assert seconds(problem, None) < 3.5 * seconds(problem, 1)
