"""Truth: SciPy's minimum of the same negative log likelihood; the estimates without the wrong readings."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import NOISE, START, TRUTH, flight, short_period
from scipy.optimize import minimize
from scipy.stats import t as student

import casid as cs


def line(seed: int, count: int = 200) -> cs.Record:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    y = 2.0 * u - 0.5 + 0.3 * rng.standard_t(3.0, count)
    return cs.Record(name="m1", t=0.1 * np.arange(count), channels={"u": u, "y": y})


def model() -> cs.Model:
    return cs.define_regression(
        "line",
        inputs=("u",),
        parameters={"a": 1.0, "b": 0.0},
        outputs=("y",),
        output=lambda s: {"y": s.a * s.u + s.b},
    )


def with_outlier() -> cs.Record:
    record = flight(noise=NOISE, rng=np.random.default_rng(9))
    q = record["q"].copy()
    q[77] += 1e3 * NOISE["q"]
    return record.with_channels(q=q)


@pytest.mark.parametrize("degrees", [3.0, 8.0])
def test_student_is_the_maximum_of_its_likelihood(degrees):
    record = line(0)
    fit = cs.solve(cs.Problem(model(), [record], free=["*"], noise=cs.StudentT(degrees=degrees)))

    def misfit(x: np.ndarray) -> float:
        u = (record["y"] - x[0] * record["u"] - x[1]) / np.exp(x[2])
        return -float(student.logpdf(u, degrees).sum()) + len(u) * x[2]

    found = minimize(misfit, [2.0, 0.0, -1.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-11})
    assert fit.converged
    for name, value in zip("ab", found.x, strict=False):
        assert fit[name].value == pytest.approx(value, abs=0.01 * fit[name].std)
    assert fit.noise["y"] == pytest.approx(np.exp(found.x[2]), rel=3e-3)
    assert fit.log_likelihood == pytest.approx(-found.fun, abs=1e-3)


@pytest.mark.parametrize("noise", [cs.StudentT(), cs.Huber(), cs.StudentT(sigma=NOISE)])
def test_one_wrong_reading_hardly_counts(noise):
    clean = flight(noise=NOISE, rng=np.random.default_rng(9))
    wanted = cs.solve(cs.Problem(short_period(), [clean], free=["*"], start=START, noise=noise))
    found = cs.solve(cs.Problem(short_period(), [with_outlier()], free=["*"], start=START, noise=noise))
    assert found.converged
    for name, value in TRUTH.items():
        assert abs(found[name].value - wanted[name].value) < 0.7 * wanted[name].std_cramer_rao
        assert abs(found[name].value - value) < 4.0 * found[name].std < 0.3


def test_a_reading_that_dominates_is_named():
    fit = cs.solve(cs.Problem(short_period(), [with_outlier()], free=["*"], start=START))
    assert any(remark.startswith("q: one reading") and "t = 3.08 s" in remark for remark in fit.remarks)


@pytest.mark.parametrize("runs", [100, pytest.param(300, marks=pytest.mark.slow)])
def test_standard_errors_are_the_scatter(runs):
    """Lines with Student's noise: 1.96 promised deviations hold 95 % of the errors, within three deviations of that."""
    errors, straight = [], model()
    for seed in range(runs):
        fit = cs.solve(cs.Problem(straight, [line(seed, 60)], free=["*"], noise=cs.StudentT(degrees=3.0)))
        errors.append([(fit[n].value - v) / fit[n].std_cramer_rao for n, v in (("a", 2.0), ("b", -0.5))])
    inside = np.abs(errors) < 1.96
    assert abs(inside.mean() - 0.95) < (0.03 if runs == 300 else 0.05)


def test_robust_noise_is_that_of_simulated_outputs():
    with pytest.raises(cs.EstimationError, match="robust noise"):
        cs.Problem(short_period(), [with_outlier()], free=["*"], cost=cs.EquationError(), noise=cs.Huber())
