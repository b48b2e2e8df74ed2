"""Truth: scipy's implicit integrators at 1e-9, and formulae."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import casid as cs

T = np.arange(0.0, 10.01, 0.1)


def followed(rate: float) -> cs.Problem:
    """x follows c cos t at a rate: x = c (r cos t + sin t) r/(1 + r^2) + transient."""
    model = cs.define_model(
        "follower",
        states=["x"],
        inputs=["t"],
        parameters={"c": 1.0, "rate": rate},
        outputs=["y"],
        dynamics=lambda s: {"x": -s.rate * (s.x - s.c * np.cos(s.t))},
        output=lambda s: {"y": s.x},
        initial=lambda s: {"x": 0.0},
    )
    steady = (rate * np.cos(T) + np.sin(T)) * rate / (1.0 + rate**2)
    x = 2.5 * (steady - steady[0] * np.exp(-rate * T))
    record = cs.Record(name="m1", t=T, channels={"y": x + 0.01 * np.random.default_rng(1).standard_normal(len(T))})
    return cs.Problem(model, [record], free=["c"], noise={"y": 0.01})


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting(), cs.Collocation()])
def test_a_stiff_motion_is_integrated_by_implicit_steps_and_that_is_said(method):
    fit = cs.solve(followed(1e5), method)
    assert fit.converged and fit.method == "Collocation", fit.status
    assert abs(fit["c"].value - 2.5) < 3.0 * fit["c"].std
    assert "implicit" in fit.integrator and fit.integrator in str(fit)


def test_a_slow_motion_is_not():
    fit = cs.solve(followed(1.0))
    assert fit.converged and fit.integrator == "explicit (Runge-Kutta), 1 step per sample interval"
    assert abs(fit["c"].value - 2.5) < 3.0 * fit["c"].std


def test_collocation_chooses_its_steps():
    """An oscillation of 2.5 radians per sample: one cubic per interval cannot follow it."""
    model = cs.define_model(
        "oscillator",
        states=["x", "v"],
        inputs=[],
        parameters={"w": 2.4, "d": 0.02},
        outputs=["x", "v"],
        dynamics=lambda s: {"x": s.v, "v": -(s.w**2) * s.x - s.d * s.v},
        output=lambda s: {"x": s.x, "v": s.v},
        state_scale={"v": 2.5},
    )
    t = np.arange(0.0, 12.5, 1.0)
    root = np.sqrt(6.25 - 0.01**2)
    x = np.exp(-0.01 * t) * (np.cos(root * t) + 0.01 / root * np.sin(root * t))
    v = -6.25 / root * np.exp(-0.01 * t) * np.sin(root * t)
    rng = np.random.default_rng(2)
    noisy = {"x": x + 0.01 * rng.standard_normal(13), "v": v + 0.025 * rng.standard_normal(13)}
    problem = cs.Problem(model, [cs.Record(name="m1", t=t, channels=noisy)], free=["*"], noise={"x": 0.01, "v": 0.025})
    fit, fine = cs.solve(problem, cs.Collocation()), cs.solve(problem, cs.Collocation(substeps=30))
    once = cs.solve(problem, cs.Collocation(substeps=1))
    assert fit.converged and fine.converged and 1 < fit.substeps < 30
    for name in fit.values:
        assert abs(fit[name].value - fine[name].value) < 0.1 * fine[name].std
    assert not once.converged or abs(once["w"].value - fine["w"].value) > fine["w"].std


def pendulum() -> cs.Problem:
    model = cs.define_model(
        "pendulum",
        states=["angle", "rate"],
        inputs=[],
        parameters={"w2": 6.0, "d": 0.3},
        outputs=["y"],
        dynamics=lambda s: {"angle": s.rate, "rate": -s.w2 * np.sin(s.angle) - s.d * s.rate},
        output=lambda s: {"y": s.angle},
    )
    t = np.arange(0.0, 30.01, 0.1)
    x = solve_ivp(
        lambda _, x: [x[1], -9.81 * np.sin(x[0]) - 0.05 * x[1]], (0, 30), [2.5, 0], t_eval=t, rtol=1e-10, atol=1e-10
    )
    y = x.y[0] + 0.05 * np.random.default_rng(0).standard_normal(len(t))
    return cs.Problem(model, [cs.Record(name="m1", t=t, channels={"y": y})], free=["*"])


@pytest.mark.parametrize("method", [cs.MultipleShooting(), cs.Collocation()], ids=lambda m: type(m).__name__)
def test_thirty_seconds_of_a_pendulum_of_which_the_angle_is_seen(method):
    fit = cs.solve(pendulum(), method)
    assert fit.converged, fit.status
    assert abs(fit["w2"].value - 9.81) < 4.0 * fit["w2"].std and abs(fit["d"].value - 0.05) < 4.0 * fit["d"].std


def rates(V, exp):
    return (
        0.1 * (V + 40) / (1 - exp(-(V + 40) / 10)),
        4 * exp(-(V + 65) / 18),
        0.07 * exp(-(V + 65) / 20),
        1 / (1 + exp(-(V + 35) / 10)),
        0.01 * (V + 55) / (1 - exp(-(V + 55) / 10)),
        0.125 * exp(-(V + 65) / 80),
    )


def membrane(V, m, h, n, current, g):
    """Hodgkin and Huxley, J. Physiol. 117 (1952), with rest at -65 mV."""
    am, bm, ah, bh, an, bn = rates(V, np.exp)
    flow = current - g[0] * m**3 * h * (V - 50) - g[1] * n**4 * (V + 77) - g[2] * (V + 54.4)
    return flow, am * (1 - m) - bm * m, ah * (1 - h) - bh * h, an * (1 - n) - bn * n


@pytest.mark.parametrize("method", [cs.MultipleShooting(), cs.Collocation()], ids=lambda m: type(m).__name__)
def test_a_nerve_of_which_only_the_voltage_is_seen(method):
    t = np.arange(0.0, 50.01, 0.1)
    current, truth = np.where(t > 5.0, 10.0, 0.0), (120.0, 36.0, 0.3)
    x = solve_ivp(
        lambda s, x: membrane(*x, np.interp(s, t, current), truth),
        (0, 50),
        [-65, 0.0529, 0.5961, 0.3177],
        method="LSODA",
        t_eval=t,
        rtol=1e-8,
        atol=1e-9,
        max_step=0.1,
    ).y
    names = ("Vs", "m", "h", "n")
    model = cs.define_model(
        "nerve",
        states=names,
        inputs=["I"],
        parameters={"gNa": 90.0, "gK": 25.0, "gL": 0.5},
        outputs=["Vm"],
        dynamics=lambda s: dict(zip(names, membrane(s.Vs, s.m, s.h, s.n, s.I, (s.gNa, s.gK, s.gL)), strict=True)),
        output=lambda s: {"Vm": s.Vs},
        state_scale={"Vs": 50.0, "m": 0.3, "h": 0.3, "n": 0.3},
    )
    noisy = x[0] + np.random.default_rng(0).standard_normal(len(t))
    fit = cs.solve(
        cs.Problem(model, [cs.Record(name="m1", t=t, channels={"I": current, "Vm": noisy})], free=["*"]), method
    )
    assert fit.converged, fit.status
    for name, value in zip(("gNa", "gK", "gL"), truth, strict=True):
        assert abs(fit[name].value - value) < 4.0 * fit[name].std


def test_two_parameters_that_nothing_tells_apart_are_named():
    """Only the product of a and b moves x, and e stands in nothing that is seen."""
    model = cs.define_model(
        "product",
        states=["x", "z"],
        inputs=[],
        parameters={"a": 1.0, "b": 0.5, "c": 1.0, "e": 1.0},
        outputs=["y"],
        dynamics=lambda s: {"x": s.c - s.a * s.b * s.x, "z": -s.e * s.z},
        output=lambda s: {"y": s.x},
        initial=lambda s: {"x": 0.0, "z": 1.0},
    )
    y = 2.0 / 0.7 * (1.0 - np.exp(-0.7 * T)) + 0.01 * np.random.default_rng(1).standard_normal(len(T))
    record = cs.Record(name="m1", t=T, channels={"y": y})
    for free, named in ((["a", "b", "c"], ("a", "b")), (["a", "c", "e"], ("e",)), (["*"], ("a", "b", "e"))):
        fit = cs.solve(cs.Problem(model, [record], free=free, noise={"y": 0.01}))
        assert not fit.converged and "ingular" not in fit.status
        said = fit.status.replace(",", " ").replace(";", " ").split()
        assert any(name in said for name in named), fit.status
        assert "c" not in said, fit.status


_JUMPS = [(100.0, 2.0), *[pytest.param(*one, marks=pytest.mark.slow) for one in ((100.0, 1.9), (60.0, 1.3))]]


@pytest.mark.parametrize(("mu", "interval"), _JUMPS)
def test_a_motion_that_jumps_within_a_sample_interval_is_followed_from_the_truth(mu, interval):
    """Van der Pol's relaxation oscillator, whose jumps take a hundredth of the interval. Truth: scipy's Radau.

    Where steps are still too long for so sharp a reading, the status says that and nothing else."""
    t = np.arange(0.0, 400.0, interval)
    exact = solve_ivp(
        lambda _, x: [x[1], mu * (1.0 - x[0] ** 2) * x[1] - x[0]],
        (0.0, 400.0),
        [2.0, 0.0],
        t_eval=t,
        method="Radau",
        rtol=1e-10,
        atol=1e-11,
    ).y[0]
    model = cs.define_model(
        "relaxation",
        states=["x", "v"],
        inputs=[],
        parameters={"mu": mu},
        outputs=["x"],
        dynamics=lambda s: {"x": s.v, "v": s.mu * (1.0 - s.x**2) * s.v - s.x},
        output=lambda s: {"x": s.x},
        state_scale={"v": mu},
    )
    y = exact + 0.02 * np.random.default_rng(0).standard_normal(len(t))
    record = cs.Record(name="r", t=t, channels={"x": y})
    known = cs.InitialState(value={"x": 2.0, "v": 0.0}, std={"x": 0.0, "v": 0.0})
    fit = cs.solve(cs.Problem(model, [record], free=["mu"], noise={"x": 0.02}, initial_state=known))
    assert fit.converged or "steps per sample interval" in fit.reason, fit.status
    assert fit["mu"].value == pytest.approx(mu, abs=4.0 * fit["mu"].std) and 0.0 < fit["mu"].std < 1e-3 * mu
    assert fit.cost == pytest.approx(0.5 * len(t), rel=0.3)
