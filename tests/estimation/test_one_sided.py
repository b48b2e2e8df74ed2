"""Truth: the free estimate as a limit ceases to hold; a line whose profile of the likelihood is a parabola."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from estimation_cases import NOISE, START, TRUTH, flight, short_period
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.signal import lfilter

import casid as cs

RECORD = flight(noise=NOISE, rng=np.random.default_rng(9))


def fitted(*limits) -> cs.Fit:
    return cs.solve(cs.Problem(short_period(), [RECORD], free=["*"], start=START, noise=NOISE, constraints=limits))


def test_a_limit_that_only_just_holds_leaves_the_free_errors():
    free = fitted()
    held = fitted(cs.limit_parameter("Mq", upper=free["Mq"].value - 1e-7))
    for name in TRUTH:
        assert held[name].std == pytest.approx(free[name].std, rel=0.02)
    np.testing.assert_allclose(held.covariance, free.covariance, rtol=1e-3, atol=1e-9)
    assert held["Mq"].interval[1] == held["Mq"].value
    assert held["Mq"].interval[0] == pytest.approx(free["Mq"].interval[0], abs=0.05 * free["Mq"].std)


@pytest.mark.parametrize("beyond", [0.5, 2.0])
def test_the_interval_ends_where_the_likelihood_has_fallen(beyond):
    """Where the profile, all other parameters estimated anew, has risen by 1.96^2/2."""
    free = fitted()
    limit = free["Mq"].value - beyond * free["Mq"].std_cramer_rao
    held = fitted(cs.limit_parameter("Mq", upper=limit))

    def risen(value: float) -> float:
        return fitted(cs.limit_parameter("Mq", lower=value, upper=value)).cost - held.cost - 0.5 * 1.959964**2

    end = brentq(risen, limit - 4.0 * free["Mq"].std_cramer_rao, limit - 1e-6, xtol=1e-6)
    if held.uncertainty.is_coloured:
        below = held["Mq"].std_corrected / held["Mq"].std_cramer_rao
        assert held["Mq"].interval[0] == pytest.approx(limit + (end - limit) * below, rel=0.05)
    else:
        assert held["Mq"].interval[0] == pytest.approx(end, rel=1e-3)
    one = held["Mq"].std_cramer_rao
    assert 0.0 < one < free["Mq"].std_cramer_rao


def test_a_start_beyond_a_limit_is_said():
    fit = fitted(cs.limit_parameter("Mq", upper=-1.5))
    assert any(remark.startswith("start: Mq is -1.26, beyond its limit -1.5") for remark in fit.remarks)


@pytest.mark.parametrize("runs", [60, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_intervals_hold_the_truth(correlation, runs):
    """White and first-order noise: the binomial bounds of 95 % in five correlated parameters of `runs` records."""
    t = np.arange(0.0, 12.0, 0.04)
    clean, model, inside, plain = flight(t=t), short_period(), [], []
    for run in range(runs):
        rng = np.random.default_rng([11, run])
        noisy = {}
        for name, sigma in NOISE.items():
            white = rng.standard_normal(len(t) + 400)
            noise = lfilter([np.sqrt(1.0 - correlation**2)], [1.0, -correlation], white)
            noisy[name] = clean[name] + sigma * np.asarray(noise)[400:]
        fit = cs.solve(cs.Problem(model, [clean.with_channels(**noisy)], free=["*"]))
        inside.append([fit[n].interval[0] <= v <= fit[n].interval[1] for n, v in TRUTH.items()])
        plain.append([abs(fit[n].value - v) < 1.96 * fit[n].std_cramer_rao for n, v in TRUTH.items()])
        if correlation == 0.95:
            assert any("coloured" in remark for remark in fit.remarks)
    assert abs(np.mean(inside) - 0.95) < (0.02 if runs == 300 else 0.05)
    if correlation == 0.95:
        assert np.mean(plain) < 0.6


def ramp(by_parameter: bool) -> cs.Model:
    """x = x0 + a t + b t^2/2, which begins where a parameter says or anywhere."""
    start = {"x0": 0.0} if by_parameter else {}
    return cs.define_model(
        "ramp",
        states=("x",),
        inputs=("t",),
        parameters={"a": 1.0, "b": 0.5, **start},
        outputs=("y",),
        dynamics=lambda s: {"x": s.a + s.b * s.t},
        output=lambda s: {"y": s.x},
        initial=(lambda s: {"x": s.x0}) if by_parameter else None,
    )


def ramp_record(seed: int, top: float = 0.0, correlation: float = 0.0) -> cs.Record:
    """Of x = 1 + (1 + top) t - t^2/2 with noise of 0.1."""
    t = 0.05 * np.arange(61)
    white = np.random.default_rng(seed).normal(scale=0.1 * np.sqrt(1.0 - correlation**2), size=len(t) + 200)
    noise = np.asarray(lfilter([1.0], [1.0, -correlation], white))[200:]
    return cs.Record(name="m", t=t, channels={"t": t, "y": 1.0 + top * t + t - t**2 / 2 + noise})


@pytest.mark.parametrize("noise", [{"y": 0.1}, None])
@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting(interval=10), cs.Collocation()])
@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_a_path_limit_at_one_sample_is_one_on_the_parameters(method, noise, correlation):
    """x at the last sample is x0 + 3 a + 4.5 b: limited as a path, with x0 an initial state, and as a combination."""
    record = ramp_record(3, top=3.0, correlation=correlation)
    free = cs.solve(cs.Problem(ramp(False), [record], free=["a", "b"], noise=noise), method)
    upper = float(free.states["m"].trajectory[-1, 0]) - 0.05
    path = cs.limit_trajectory("x", upper=upper)
    plain = cs.limit_combination({"x0": 1.0, "a": 3.0, "b": 4.5}, upper=upper)
    limited = cs.solve(cs.Problem(ramp(False), [record], free=["a", "b"], noise=noise, constraints=[path]), method)
    truth = cs.solve(cs.Problem(ramp(True), [record], free=["a", "b", "x0"], noise=noise, constraints=[plain]), method)
    assert limited.converged and truth.converged
    assert limited.states["m"].trajectory[-1, 0] == pytest.approx(upper, abs=1e-9)
    for name in ("a", "b"):
        assert limited[name].value == pytest.approx(truth[name].value, abs=1e-3 * truth[name].std)
        assert limited[name].std_cramer_rao == pytest.approx(truth[name].std_cramer_rao, rel=1e-5)
        assert limited[name].std == pytest.approx(truth[name].std, rel=1e-4)
        np.testing.assert_allclose(limited[name].interval, truth[name].interval, atol=1e-3 * truth[name].std)
        assert limited[name].std_cramer_rao < 0.95 * free[name].std_cramer_rao


@pytest.mark.parametrize("runs", [60, pytest.param(300, marks=pytest.mark.slow)])
def test_intervals_within_a_path_limit_hold_the_truth(runs):
    """The limit is the maximum of the true motion, which lies between two samples, so that it holds in about half of
    the runs: the binomial bounds of 95 % in the two parameters."""
    limit, inside, held = cs.limit_trajectory("x", upper=1.5), [], 0
    truth, model = {"a": 1.0, "b": -1.0}, ramp(False)
    for run in range(runs):
        record = ramp_record(run)
        fit = cs.solve(cs.Problem(model, [record], free=list(truth), constraints=[limit]))
        assert fit.converged
        inside.append([fit[n].interval[0] <= v <= fit[n].interval[1] for n, v in truth.items()])
        held += any(remark.startswith("x: its limit holds") for remark in fit.remarks)
    assert 0.3 * runs < held < 0.7 * runs
    assert abs(np.mean(inside) - 0.95) < (0.025 if runs == 300 else 0.05)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**16), st.floats(-3.0, 3.0), st.floats(-8.0, 8.0), st.sampled_from([None, 1.0]))
def test_bounds_are_kept_exactly_and_end_the_intervals(seed, loudness, decade, given_noise):
    """Truth: scipy's bounded least squares, and which bounds it finds active."""
    rng = np.random.default_rng(seed)
    unit = 10.0**decade
    h = rng.standard_normal((25, 3))
    y = unit * (h @ rng.uniform(-2.0, 2.0, 3) + 10.0**loudness * rng.standard_normal(25))
    bounds = unit * np.sort(rng.choice([-1.0, -0.3, 0.0, 0.3, 1.0, 2.0], (3, 2)) + [0.0, 0.1], axis=1)
    names = ("a", "b", "c")
    model = cs.define_regression(
        "line",
        inputs=["h0", "h1", "h2"],
        parameters=dict(zip(names, bounds.mean(axis=1).tolist(), strict=True)),
        outputs=["y"],
        output=lambda s: {"y": s.a * s.h0 + s.b * s.h1 + s.c * s.h2},
    )
    record = cs.Record(name="r", t=np.arange(25.0), channels={f"h{i}": h[:, i] for i in range(3)} | {"y": y})
    limits = [cs.limit_parameter(n, lower=low, upper=up) for n, (low, up) in zip(names, bounds.tolist(), strict=True)]
    noise = None if given_noise is None else {"y": given_noise * unit * 10.0**loudness}
    fit = cs.solve(cs.Problem(model, record, free=["*"], constraints=limits, noise=noise))
    best = scipy.optimize.lsq_linear(h, y / unit, bounds.T / unit, method="bvls", tol=1e-14)
    assert fit.converged, fit.status
    for name, value, side, (low, up) in zip(names, best.x, best.active_mask, bounds, strict=True):
        one = fit[name]
        assert one.value == pytest.approx(unit * value, abs=1e-5 * unit)
        assert low <= one.interval[0] <= one.value <= one.interval[1] <= up
        assert (one.value == (low if side < 0 else up)) == (side != 0)
        assert any(r.startswith(f"{name}: held by a limit") for r in fit.remarks) == (side != 0)
