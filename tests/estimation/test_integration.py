"""Truth: solutions by matrix exponential, with the samples and rates of COPS' isomerisation of alpha-pinene."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import casid as cs
from casid.errors import InputError

RATES = {"p0": 5.93e-5, "p1": 2.96e-5, "p2": 2.05e-5, "p3": 27.5e-5, "p4": 4.0e-5}


def pinene(start: float) -> cs.Model:
    return cs.define_model(
        "alpha-pinene",
        states=[f"x{i}" for i in range(5)],
        inputs=(),
        parameters=dict.fromkeys(RATES, start),
        outputs=[f"y{i}" for i in range(5)],
        dynamics=lambda s: {
            "x0": -(s.p0 + s.p1) * s.x0,
            "x1": s.p0 * s.x0,
            "x2": s.p1 * s.x0 - (s.p2 + s.p3) * s.x2 + s.p4 * s.x4,
            "x3": s.p2 * s.x2,
            "x4": s.p3 * s.x2 - s.p4 * s.x4,
        },
        output=lambda s: {f"y{i}": getattr(s, f"x{i}") for i in range(5)},
        state_scale={f"x{i}": 100.0 for i in range(5)},
    )


def flown(t: np.ndarray, noise: float, rng: np.random.Generator) -> cs.Record:
    p0, p1, p2, p3, p4 = RATES.values()
    a = np.zeros((5, 5))
    a[0, 0], a[1, 0], a[2, 0] = -(p0 + p1), p0, p1
    a[2, 2], a[2, 4], a[3, 2] = -(p2 + p3), p4, p2
    a[4, 2], a[4, 4] = p3, -p4
    x = np.array([expm(a * tk) @ [100.0, 0.0, 0.0, 0.0, 0.0] for tk in t])
    y = x + noise * rng.standard_normal(x.shape)
    return cs.Record(name="m1", t=t, channels={f"y{i}": y[:, i] for i in range(5)})


SAMPLES = np.array([0.0, 1230.0, 3060.0, 4920.0, 7800.0, 10680.0, 15030.0, 22620.0, 36420.0])


def problem(noise: float = 0.3) -> cs.Problem:
    known = cs.InitialState(
        value={"x0": 100.0, "x1": 0.0, "x2": 0.0, "x3": 0.0, "x4": 0.0}, std={f"x{i}": 1e-6 for i in range(5)}
    )
    record = flown(SAMPLES, noise, np.random.default_rng(3))
    sigma = {f"y{i}": noise for i in range(5)}
    return cs.Problem(pinene(1e-5), [record], free=["*"], noise=sigma, initial_state=known)


def test_steps_are_chosen_for_samples_far_apart():
    """One step over 13800 s, four times the fastest time constant, is wrong by far; what is chosen is not."""
    once = cs.solve(problem(), cs.SingleShooting(substeps=1))
    chosen, many = cs.solve(problem(), cs.SingleShooting()), cs.solve(problem(), cs.SingleShooting(substeps=60))
    assert chosen.converged and many.converged and chosen.substeps > 1 and many.substeps == 60
    for name, truth in RATES.items():
        assert abs(chosen[name].value - many[name].value) < 0.1 * many[name].std
        assert abs(chosen[name].value - truth) < 4.0 * chosen[name].std
    off = max(abs(once[name].value - many[name].value) / many[name].std for name in RATES)
    assert off > 1.0 and chosen.states["m1"].trajectory.shape == (9, 5)
    assert any("integration" in remark for remark in once.remarks)
    assert not any("integration" in remark for fit in (chosen, many) for remark in fit.remarks)


def test_a_start_that_only_short_steps_follow() -> None:
    """x'' = -4 x - 0.4 |x'| x', samples 6 s apart: with one step of Runge and Kutta per sample the start at 40 has no
    end, while the motion, by LSODA, is calm. The damping is that which made the data."""
    model = cs.define_model(
        "drag",
        states=["x", "v"],
        inputs=[],
        parameters={"d": 0.3},
        outputs=["x"],
        dynamics=lambda s: {"x": s.v, "v": -4.0 * s.x - s.d * ca.fabs(s.v) * s.v},
        output=lambda s: {"x": s.x},
    )
    t = 6.0 * np.arange(12.0)
    true = solve_ivp(
        lambda _, x: [x[1], -4.0 * x[0] - 0.4 * abs(x[1]) * x[1]], (0.0, t[-1]), [40.0, 0.0], "LSODA", t, rtol=1e-10
    )
    record = cs.Record(name="m1", t=t, channels={"x": true.y[0] + 0.01 * np.random.default_rng(0).standard_normal(12)})
    begin = cs.InitialState(value={"x": 40.0, "v": 0.0}, std={"x": 0.0, "v": 0.0})
    posed = cs.Problem(model, [record], free=["d"], noise={"x": 0.01}, initial_state=begin)
    fit = cs.solve(posed, cs.SingleShooting())
    assert fit.converged and abs(fit["d"].value - 0.4) < 4.0 * fit["d"].std


@pytest.mark.parametrize("samples, noise, seed", [(SAMPLES, 0.3, 6), (np.linspace(0.0, 36000.0, 25), 0.1, 3)])
def test_the_likelihood_is_that_of_the_motion_too(samples, noise, seed):
    """Against many steps: off by less than 0.01, a fiftieth of what a parameter more is worth. Estimates alone, good to
    a tenth of their standard deviations, would leave 0.011 by collocation and 0.077 by shooting."""
    given, record = problem(), flown(samples, noise, np.random.default_rng(seed))
    sigma = {f"y{i}": noise for i in range(5)}
    posed = cs.Problem(given.model, [record], free=["*"], noise=sigma, initial_state=given.initial_state)
    fine = cs.solve(posed, cs.SingleShooting(substeps=60))
    for method in (cs.SingleShooting(), cs.MultipleShooting(), cs.Collocation()):
        fit = cs.solve(posed, method)
        assert fit.converged and fit.log_likelihood == pytest.approx(fine.log_likelihood, abs=0.01)


def test_multiple_shooting_and_collocation_take_steps_between_samples_too():
    wanted = cs.solve(problem(), cs.SingleShooting(substeps=60))
    for method in (cs.MultipleShooting(interval=2, substeps=60), cs.Collocation(substeps=20)):
        found = cs.solve(problem(), method)
        assert found.converged and found.substeps == method.substeps
        for name in RATES:
            assert found[name].value == pytest.approx(wanted[name].value, abs=1e-3 * wanted[name].std)
            assert found[name].std == pytest.approx(wanted[name].std, rel=1e-3)


@pytest.mark.parametrize("method", [cs.SingleShooting, cs.MultipleShooting, cs.Collocation])
@pytest.mark.parametrize("substeps", [0, -1, 20.5, True, "two"])
def test_a_number_of_steps_that_is_none_is_refused(method, substeps):
    with pytest.raises(InputError, match="substeps"):
        method(substeps=substeps)


def test_sub_steps_of_time_and_of_held_inputs():
    """xdot = t + u: time runs on within a held sample, whatever the number of steps."""
    model = cs.define_model(
        "ramp",
        states=("x",),
        inputs=("t", "u"),
        parameters={"k": 1.0},
        outputs=("x",),
        dynamics=lambda s: {"x": s.k * s.t + s.u},
        output=lambda s: {"x": s.x},
    )
    t, u = np.arange(0.0, 5.0, 0.5), np.array([1.0, -1.0] * 5)
    x = t**2 + np.concatenate([[0.0], np.cumsum(0.5 * u[:-1])])
    record = cs.Record(name="m1", t=t, channels={"u": u, "x": x}, hold="held")
    for substeps in (1, 3):
        fit = cs.solve(cs.Problem(model, [record], free=["k"]), cs.MultipleShooting(interval=4, substeps=substeps))
        assert fit["k"].value == pytest.approx(2.0, abs=1e-9)


def test_a_solver_that_gave_up_says_nothing_of_the_steps():
    """Far from the solution residuals are no noise: what is wrong by their measure is no reason for another method."""
    stopped = cs.solve(problem(), cs.MultipleShooting(interval=2), cs.Ipopt(iterations=2))
    assert not stopped.converged and stopped.method == "MultipleShooting"


def test_a_motion_that_grows_by_itself_needs_no_other_method() -> None:
    """An unstable pair, x'' = 4 x + u, doubles its errors every 0.35 s: over the record by e^60. The data hold its
    nodes, so a few steps per sample are as good as eight, by multiple shooting and not by what is for stiff motions."""
    model = cs.define_model(
        "unstable",
        states=["x", "v"],
        inputs=["u"],
        parameters={"a": 3.0, "b": 0.8},
        outputs=["y"],
        dynamics=lambda s: {"x": s.v, "v": s.a * s.x + s.b * s.u},
        output=lambda s: {"y": s.x},
    )
    t, rng = np.arange(0.0, 30.0, 0.05), np.random.default_rng(2)
    x, v = np.zeros(len(t)), np.zeros(len(t))
    drawn = 0.3 * np.repeat(rng.standard_normal(len(t) // 20 + 1), 20)[: len(t)]
    u = np.zeros(len(t))
    for k in range(len(t) - 1):  # a pilot holds it; exact over a sample, the input straight between two of them
        u[k + 1] = drawn[k + 1] - 12.0 * x[k] - 6.0 * v[k]
        block = expm(np.array([[0, 1, 0, 0], [4, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]]) * 0.05)
        slope = (u[k + 1] - u[k]) / 0.05
        x[k + 1], v[k + 1] = (block @ [x[k], v[k], u[k], slope])[:2]
    record = cs.Record(name="held", t=t, channels={"u": u, "y": x + rng.normal(0.0, 1e-4, len(t))})
    problem = cs.Problem(model, [record], free=["a", "b"])
    chosen, fine = cs.solve(problem), cs.solve(problem, cs.MultipleShooting(substeps=8))
    assert chosen.converged and chosen.substeps <= 4 and chosen.method == "MultipleShooting"
    for name, one in fine.parameters.items():
        assert abs(chosen.parameters[name].value - one.value) < 0.1 * one.std
    assert abs(chosen.parameters["a"].value - 4.0) < 4.0 * chosen.parameters["a"].std
