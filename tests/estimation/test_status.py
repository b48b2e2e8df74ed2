"""How a fit ends: the status belongs to the point, nothing raw reaches the user, likelihoods are of one motion."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.stats import norm

import casid as cs


def lag(name: str = "T") -> cs.Model:
    return cs.define_model(
        "lag",
        states=["x"],
        inputs=["u"],
        parameters={name: 0.5, "K": 1.0},
        outputs=["y"],
        dynamics=lambda s: {"x": (s.K * s.u - s.x) / getattr(s, name)},
        output=lambda s: {"y": s.x},
    )


def barnes(start: list[float]) -> cs.Fit:
    """Barnes' two species, 11 readings (Stortelder, 1998)."""
    a = [1, 1.1, 1.3, 1.1, 0.9, 0.7, 0.5, 0.6, 0.7, 0.8, 1]
    b = [0.3, 0.35, 0.4, 0.5, 0.5, 0.4, 0.3, 0.25, 0.25, 0.3, 0.35]
    model = cs.define_model(
        "Barnes",
        states=["a", "b"],
        inputs=[],
        parameters={"k1": 1.0, "k2": 1.0, "k3": 1.0},
        outputs=["a", "b"],
        dynamics=lambda s: {"a": s.k1 * s.a - s.k2 * s.a * s.b, "b": s.k2 * s.a * s.b - s.k3 * s.b},
        output=lambda s: {"a": s.a, "b": s.b},
    )
    record = cs.Record(name="r", t=np.arange(11) / 2, channels={"a": np.array(a), "b": np.array(b)})
    known = cs.InitialState(value={"a": 1.0, "b": 0.3}, std={"a": 0.0, "b": 0.0})
    given = dict(zip(("k1", "k2", "k3"), start, strict=True))
    noise = {"a": 0.1, "b": 0.1}
    return cs.solve(cs.Problem(model, record, free=["*"], start=given, noise=noise, initial_state=known))


def test_one_end_has_one_status_from_any_start():
    fits = [barnes(start) for start in ([0.86, 2.07, 1.81], [1.7, 4.2, 3.6], [0.1, 0.1, 0.1], [5.0, 5.0, 5.0])]
    for fit in fits[1:]:
        assert fit.log_likelihood == pytest.approx(fits[0].log_likelihood, abs=0.01)
        assert fit.result is fits[0].result, fit.status


def test_the_parts_of_a_status_are_values():
    model = cs.define_regression(
        "line",
        inputs=["h"],
        parameters={"a": 1.0, "b": 1.0, "unused": 1.0},
        outputs=["y"],
        output=lambda s: {"y": s.a + s.b * s.h + s.unused},
    )
    h, rng = np.arange(8.0), np.random.default_rng(0)
    y = 2.0 + 3.0 * h + 0.1 * rng.standard_normal(8)
    record = cs.Record(name="r", t=h, channels={"h": h, "y": y})
    fit = cs.solve(cs.Problem(model, record, free=["*"]))
    assert fit.result is cs.Results.NOT_IDENTIFIABLE and "unused" in fit.reason and fit.remedy
    assert fit.reason in fit.status and fit.remedy in fit.status
    # what is undetermined has no error; the slope has that of ordinary least squares
    assert np.isnan(fit["a"].std) and np.isnan(fit["unused"].std)
    plain = cs.solve(cs.Problem(model, record, free=["a", "b"]))
    assert fit["b"].std == pytest.approx(plain["b"].std, rel=1e-6)
    assert plain.remedy == plain.reason == "" and plain.status == "converged"


@pytest.mark.parametrize("level", [0.0, 2.0])
@pytest.mark.parametrize("noise", [None, {"y": 0.01}])
def test_a_dead_channel_is_told_and_nothing_is_raised(level, noise):
    t = 0.02 * np.arange(100)
    record = cs.Record(name="z", t=t, channels={"u": 0.0 * t, "y": 0.0 * t + level})
    fit = cs.solve(cs.Problem(lag(), record, free=["*"], noise=noise))
    assert any("measured as constant" in remark for remark in fit.remarks)


def test_a_bracket_in_a_name_is_refused_in_words():
    t = 0.02 * np.arange(100)
    record = cs.Record(name="m", t=t, channels={"u": np.sin(t), "y": np.sin(t)})
    with pytest.raises(cs.InputError, match="T_1"):
        cs.Problem(lag("T[1]"), record, free=["*"])


def test_copies_of_a_record_are_remarked_on():
    t = 0.02 * np.arange(100)
    rng = np.random.default_rng(0)
    one = cs.Record(name="m1", t=t, channels={"u": np.sin(t), "y": np.sin(t) + 0.1 * rng.standard_normal(100)})
    copy = cs.Record(name="m2", t=t, channels=dict(one.channels))
    other = cs.Record(name="m3", t=t, channels={"u": np.sin(t), "y": np.sin(t) + 0.1 * rng.standard_normal(100)})
    assert any("'m1'" in r and "'m2'" in r for r in cs.solve(cs.Problem(lag(), [one, copy], free=["*"])).remarks)
    assert not any("same numbers" in r for r in cs.solve(cs.Problem(lag(), [one, other], free=["*"])).remarks)


def test_nothing_of_lapack_reaches_standard_output():
    code = """
import numpy as np, casid as cs
h = np.array([1.0, 2, 3, 4, 5, 7]); y = np.array([8.3, 10.3, 19, 16, 15.6, 19.8])
m = cs.define_regression("rb", inputs=("h",), parameters={"a": 0.0, "b": 0.0}, outputs=("y",),
                         output=lambda s: {"y": s.a * (1 - np.exp(-s.b * s.h))})
cs.solve(cs.Problem(m, cs.Record(name="r", t=np.arange(6.0), channels={"h": h, "y": y}), free=["*"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""


def test_likelihood_prior_and_posterior_are_those_of_statistics():
    """Truth: sums of normal log densities by scipy, at an end that is a solution and at one that is none."""
    t, rng = np.linspace(0.0, 5.0, 51), np.random.default_rng(2)
    y = 3.0 * np.exp(-0.7 * t) + 0.1 * rng.standard_normal(51)
    model = cs.define_model(
        "decay",
        states=["x"],
        inputs=[],
        parameters={"k": 3.0},
        outputs=["y"],
        dynamics=lambda s: {"x": -s.k * s.x},
        output=lambda s: {"y": s.x},
        prior_std={"k": 0.5},
    )
    given = cs.InitialState(value={"x": 2.0}, std={"x": 0.4})
    record = cs.Record(name="r", t=t, channels={"y": y})
    problem = cs.Problem(model, record, free=["k"], noise={"y": 0.1}, prior=True, initial_state=given)
    for solver in (cs.Automatic(), cs.GaussNewton(iterations=1)):
        fit = cs.solve(problem, cs.MultipleShooting(interval=5), solver)
        first = fit.initial_states["r"]["x"].value
        exact = solve_ivp(
            lambda _, x, k=fit.values["k"]: -k * x, (0.0, 5.0), [first], t_eval=t, rtol=1e-11, atol=1e-12
        ).y[0]
        assert fit.log_likelihood == pytest.approx(norm.logpdf(y, exact, 0.1).sum(), abs=0.01)
        prior = norm.logpdf(fit.values["k"], 3.0, 0.5) + norm.logpdf(first, 2.0, 0.4)
        assert fit.log_prior == pytest.approx(prior, abs=1e-6)
        assert fit.log_posterior == pytest.approx(fit.log_likelihood + prior, abs=1e-6)
    assert not fit.converged


@pytest.mark.parametrize("times", [1e6, 1.0, 1e-2])
def test_a_noise_that_begins_beyond_all_readings_is_told_and_found(times):
    """Truth: least squares by numpy, and the root mean square of its residuals."""
    h, rng = np.linspace(0.0, 1.0, 40), np.random.default_rng(0)
    y = 2.0 + 3.0 * h + 0.2 * rng.standard_normal(40)
    model = cs.define_regression(
        "line",
        inputs=["h"],
        parameters={"a": 1.0, "b": 1.0, "sd": 0.2},
        outputs=["y"],
        output=lambda s: {"y": s.a + s.b * s.h},
    )
    record = cs.Record(name="r", t=np.arange(40.0), channels={"h": h, "y": y})
    noise = {"y": cs.Noise(sigma=lambda s: s.sd)}
    fit = cs.solve(cs.Problem(model, record, free=["*"], log=["sd"], start={"sd": 0.2 * times}, noise=noise))
    slope, first = np.polyfit(h, y, 1)
    assert fit.converged, fit.status
    assert [fit.values["a"], fit.values["b"]] == pytest.approx([first, slope], rel=1e-5)
    assert fit.values["sd"] == pytest.approx(np.sqrt(np.mean((y - first - slope * h) ** 2)), rel=1e-4)
    assert any("range of its readings" in remark for remark in fit.remarks) == (times > 1e3)


def test_a_motion_that_grows_is_integrated_as_finely_as_any():
    """Lorenz' equations, x read: the likelihood of an end is within 0.01 of that with 16 steps per sample."""
    t = np.arange(0, 12 + 1e-9, 0.02)
    start = [-11.8, -5.1, 10.0]

    def rates(_, x):
        return [10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]]

    x = solve_ivp(rates, (0, t[-1]), start, t_eval=t, rtol=1e-12, atol=1e-12, method="LSODA").y[0]
    record = cs.Record(name="r", t=t, channels={"x": x + 0.1 * np.random.default_rng(1).standard_normal(len(t))})
    model = cs.define_model(
        "lorenz",
        states=["x", "y", "z"],
        inputs=[],
        parameters={"s": 10.0, "r": 28.0, "b": 8 / 3},
        outputs=["x"],
        dynamics=lambda s: {"x": s.s * (s.y - s.x), "y": s.x * (s.r - s.z) - s.y, "z": s.x * s.y - s.b * s.z},
        output=lambda s: {"x": s.x},
    )
    problem = cs.Problem(model, record, free=["*"], noise={"x": 0.1})
    found = cs.solve(problem, cs.MultipleShooting(interval=1))
    exact = cs.solve(problem, cs.MultipleShooting(interval=1, substeps=16))
    assert found.converged and exact.converged
    assert found.log_likelihood == pytest.approx(exact.log_likelihood, abs=0.01)


def test_an_end_without_open_defects_is_the_motion_that_is_judged():
    """A state that grows 7e10 times along the record, stopped one step before the solution, less than a thousandth of a
    standard deviation from it. Truth: the motion without noise, that the outputs are those of the states, and scipy."""
    t, rate, sigma = np.linspace(0.0, 10.0, 201), 2.5, 0.01
    x, factor = np.sin(t), np.exp(rate * 0.05)
    u = np.append(
        rate * (x[1:] - factor * x[:-1]) / (factor - 1.0), 0.0
    )  # held, it leads from sample to sample exactly
    y = x + sigma * np.random.default_rng(3).standard_normal(len(t))
    model = cs.define_model(
        "growth",
        states=["x"],
        inputs=["u"],
        parameters={"a": 1.5},
        outputs=["y"],
        dynamics=lambda s: {"x": s.a * s.x + s.u},
        output=lambda s: {"y": s.x},
    )
    record = cs.Record(name="r", t=t, channels={"u": u, "y": y}, hold={"u": "held"})
    problem = cs.Problem(model, record, free=["a"], noise={"y": sigma})
    method = cs.MultipleShooting(interval=10)
    whole = cs.solve(problem, method, cs.GaussNewton())
    fit = cs.solve(problem, method, cs.GaussNewton(iterations=whole.iterations - 1))
    assert whole.converged and not fit.converged and fit.defect < 1e-6
    assert np.abs(fit.predictions["r"][:, 0] - x).max() < 2.0 * sigma
    assert fit.predictions["r"] == pytest.approx(fit.states["r"].trajectory, abs=1e-9)
    for one in (fit, whole):
        assert one.log_likelihood == pytest.approx(norm.logpdf(y, one.predictions["r"][:, 0], sigma).sum(), abs=1e-6)
    assert fit.log_likelihood == pytest.approx(whole.log_likelihood, abs=0.01)


def _switched(kind: str, smooth: bool) -> cs.Model:
    """Something that begins at the time ts: of an output, of a rate, of a delayed command."""

    def on(t: Any) -> Any:
        return 0.5 + 0.5 * np.tanh(t / 0.1) if smooth else np.where(t > 0.0, 1.0, 0.0)

    if kind == "output":
        return cs.define_regression(
            kind,
            inputs=["t"],
            parameters={"a": 1.0, "ts": 4.0},
            outputs=["y"],
            output=lambda s: {"y": s.a * on(s.t - s.ts)},
        )
    return cs.define_model(
        kind,
        states=["x"],
        inputs=["t"],
        parameters={"a": 1.0, "ts": 4.0},
        outputs=["y"],
        dynamics=lambda s: {"x": s.a * on(s.t - (1.0 + s.ts if kind == "delay" else s.ts)) - s.x},
        output=lambda s: {"y": s.x},
    )


@settings(max_examples=6, deadline=None)
@given(st.floats(3.0, 5.0), st.sampled_from(["output", "rate", "delay"]), st.booleans())
def test_a_time_in_a_condition_is_told_as_without_derivative(begin, kind, with_prior):
    t = np.linspace(0.0, 10.0, 101)
    later = np.maximum(t - begin - (kind == "delay"), 0.0)
    y = 2.0 * (later > 0.0) if kind == "output" else 2.0 * (1.0 - np.exp(-later))
    y = y + 0.05 * np.random.default_rng(0).standard_normal(len(t))
    record = cs.Record(name="r", t=t, channels={"t": t, "y": y})
    jumping = replace(_switched(kind, smooth=False), prior_std={"ts": 1.0})
    fit = cs.solve(cs.Problem(jumping, [record], free=["*"], noise={"y": 0.05}, prior=with_prior))
    assert fit.result is cs.Results.NO_DERIVATIVE and "ts" in fit.reason and "a," not in fit.reason
    smooth = cs.solve(cs.Problem(_switched(kind, smooth=True), [record], free=["*"], noise={"y": 0.05}))
    assert smooth.converged, smooth.status
    assert smooth["ts"].value == pytest.approx(begin, abs=0.15)


@pytest.mark.parametrize("command", [0.0, 1.0])
def test_no_effect_in_these_data_is_no_jump(command):
    """A command that rests, and a factor that is zero: the derivative is zero here, and elsewhere it is not."""
    t = np.linspace(0.0, 5.0, 60)
    model = cs.define_regression(
        "product",
        inputs=["t", "u"],
        parameters={"a": 1.0, "b": 0.0},
        outputs=["y"],
        output=lambda s: {"y": s.a * s.t + s.b**2 * s.u},
    )
    y = t + 0.1 * np.random.default_rng(0).standard_normal(60)
    record = cs.Record(name="r", t=t, channels={"t": t, "u": 0.0 * t + command, "y": y})
    fit = cs.solve(cs.Problem(model, [record], free=["*"], noise={"y": 0.1}))
    assert fit.result is not cs.Results.NO_DERIVATIVE and (command == 1.0 or not fit.converged)
