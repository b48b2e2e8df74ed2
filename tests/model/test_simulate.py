"""Motion by CVODES against formulae and a published figure, and beside Runge-Kutta's and collocation's."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError


def follower(rate: float) -> cs.Model:
    """x follows cos t at a rate, from 0: x = r (r cos t + sin t - r exp(-r t))/(1 + r^2)."""
    return cs.define_model(
        "follower",
        states=["x"],
        inputs=["t"],
        parameters={"c": 1.0, "rate": rate},
        outputs=["x"],
        dynamics=lambda s: {"x": -s.rate * (s.x - s.c * np.cos(s.t))},
        output=lambda s: {"x": s.x},
        initial=lambda s: {"x": 0.0},
    )


@pytest.mark.parametrize("rate", [1.0, 1e5])
def test_it_follows_slow_and_stiff_motion_alike(rate: float) -> None:
    """The input is linear between samples: chords of cos t lie off it by 0.005^2/8."""
    t = np.arange(0.0, 3.0, 0.005)
    record = cs.Record(name="m", t=t, channels={})
    found = cs.simulate(follower(rate), record, [0.0], integrator="cvodes").output("x")
    truth = rate * (rate * np.cos(t) + np.sin(t) - rate * np.exp(-rate * t)) / (1.0 + rate**2)
    np.testing.assert_allclose(found, truth, atol=1e-6)
    if rate == 1.0:
        explicit = cs.simulate(follower(rate), record, [0.0]).output("x")
        np.testing.assert_allclose(found, explicit, atol=1e-8)


def test_robertsons_kinetics() -> None:
    """y(40) as printed for the example of CVODES' own documentation, cvRoberts_dns, at a tolerance of 1e-4."""
    model = cs.define_model(
        "Robertson",
        states=["a", "b", "c"],
        inputs=[],
        parameters={"k1": 0.04, "k2": 1e4, "k3": 3e7},
        outputs=["a", "b", "c"],
        dynamics=lambda s: {
            "a": -s.k1 * s.a + s.k2 * s.b * s.c,
            "b": s.k1 * s.a - s.k2 * s.b * s.c - s.k3 * s.b**2,
            "c": s.k3 * s.b**2,
        },
        output=lambda s: {"a": s.a, "b": s.b, "c": s.c},
        state_scale={"b": 1e-5},
    )
    record = cs.Record(name="m", t=np.array([0.0, 0.4, 4.0, 40.0]), channels={})
    found = cs.simulate(model, record, [1.0, 0.0, 0.0], integrator="cvodes")
    np.testing.assert_allclose(found.states[-1], [7.1583e-01, 9.1855e-06, 2.8416e-01], rtol=2e-4)


def test_it_checks_a_fit_of_a_stiff_system() -> None:
    """Collocation promises predictions within a tenth of the noise."""
    t = np.arange(0.0, 10.0, 0.1)
    model, rng = follower(1e4), np.random.default_rng(1)
    flown = cs.simulate(model, cs.Record(name="m", t=t, channels={}), [0.0], {"c": 2.5}, integrator="cvodes")
    record = flown.as_record("m").with_channels(x=flown.output("x") + 0.01 * rng.standard_normal(len(t)))
    fit = cs.solve(cs.Problem(model, [record], free=["c"], noise={"x": 0.01}))
    assert fit.converged and "implicit" in fit.integrator
    checked = cs.simulate(model, record, fit.states["m"].trajectory[0], dict(fit.values), integrator="cvodes")
    np.testing.assert_allclose(checked.outputs, fit.predictions["m"], atol=1e-3)


def test_held_inputs_and_disturbances_are_seen() -> None:
    """x' = u + w: sums."""
    model = cs.define_model(
        "integrator",
        states=["x"],
        inputs=["u"],
        parameters={},
        outputs=["x"],
        disturbances=["w"],
        dynamics=lambda s: {"x": s.u + s.w},
        output=lambda s: {"x": s.x},
    )
    t, u, w = np.arange(4.0), np.array([1.0, 3.0, -2.0, 0.0]), np.array([0.5, 0.5, 1.5, 1.5])
    for hold, truth in (("held", [0.0, 1.5, 5.0, 4.5]), ("linear", [0.0, 2.5, 4.0, 4.5])):
        record = cs.Record(name="m", t=t, channels={"u": u}, hold=hold)
        found = cs.simulate(model, record, [0.0], disturbances={"w": w}, integrator="cvodes")
        np.testing.assert_allclose(found.output("x"), truth, atol=1e-8)


def test_a_motion_that_ends_is_said() -> None:
    """x' = x^2 from 1 is at infinity at t = 1."""
    model = cs.define_model(
        "escape",
        states=["x"],
        inputs=[],
        parameters={},
        outputs=["x"],
        dynamics=lambda s: {"x": s.x**2},
        output=lambda s: {"x": s.x},
    )
    record = cs.Record(name="m", t=np.arange(0.0, 2.0, 0.25), channels={})
    with pytest.raises(InputError, match=r"diverged at t = 1\.00 s"):
        cs.simulate(model, record, [1.0], integrator="cvodes")
    with pytest.raises(InputError, match="did you mean 'cvodes'"):
        cs.simulate(model, record, [1.0], integrator="cvode")
