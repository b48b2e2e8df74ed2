"""Inputs held, linear or cubic between samples, each by itself. Truth: exact discretisation by scipy and matrix
exponentials, and CasADi's own example of system identification, whose input is held."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete

import casid as cs
from casid.errors import InputError
from casid.estimation.attempt import build_objective
from casid.estimation.working import along_splines
from casid.native import compiler

A = np.array([[-0.8, 1.0], [-4.0, -1.3]])
B = np.array([[0.4, -0.3], [2.0, 1.0]])
TRUTH = {"a": -4.0, "b1": 2.0, "b2": 1.0}
START = {"a": -3.0, "b1": 1.5, "b2": 0.7}
T = np.arange(0.0, 12.0, 0.15)


def oscillator(disturbances: tuple[str, ...] = ()) -> cs.Model:
    return cs.define_model(
        "oscillator",
        states=("x0", "x1"),
        inputs=("u1", "u2"),
        parameters=TRUTH,
        outputs=("y0", "y1"),
        disturbances=disturbances,
        dynamics=lambda s: {
            "x0": -0.8 * s.x0 + s.x1 + 0.4 * s.u1 - 0.3 * s.u2,
            "x1": s.a * s.x0 - 1.3 * s.x1 + s.b1 * s.u1 + s.b2 * s.u2 + (s.w if disturbances else 0.0),
        },
        output=lambda s: {"y0": s.x0, "y1": s.x1},
    )


def discretised(u: np.ndarray, method: str, columns: list[int]) -> np.ndarray:
    """(N, 2) motion from rest by scipy's exact discretisation for the input columns alone."""
    a, b, c, d, _ = cont2discrete((A, B[:, columns], np.eye(2), np.zeros((2, len(columns)))), T[1] - T[0], method)
    x, y = np.zeros((2, 1)), []
    for uk in u[:, columns]:
        y.append((c @ x + d @ uk[:, None])[:, 0])
        x = a @ x + b @ uk[:, None]
    return np.array(y)


def record(y: np.ndarray, u: np.ndarray, hold, t: np.ndarray = T, noise: float = 0.0) -> cs.Record:
    y = y + noise * np.random.default_rng(5).standard_normal(y.shape)
    return cs.Record(name="m", t=t, channels={"u1": u[:, 0], "u2": u[:, 1], "y0": y[:, 0], "y1": y[:, 1]}, hold=hold)


def random_inputs() -> np.ndarray:
    """(N, 2), from zero, so that `foh` of scipy begins at rest."""
    u = np.random.default_rng(3).standard_normal((len(T), 2))
    u[0] = 0.0
    return u


HOLDS = {
    "held": ("zoh", "zoh"),
    "linear": ("foh", "foh"),
    "first held": ("zoh", "foh"),
    "second held": ("foh", "zoh"),
}
METHODS = {
    "single": cs.SingleShooting(substeps=12),
    "multiple": cs.MultipleShooting(interval=7, substeps=12),
    "collocation": cs.Collocation(degree=5, substeps=1),
}


def mixed(u: np.ndarray, holds: tuple[str, str]) -> np.ndarray:
    """The motion is linear in the inputs, so each may have its own discretisation."""
    return sum(discretised(u, how, [j]) for j, how in enumerate(holds))


@pytest.mark.parametrize("holds", HOLDS.values(), ids=HOLDS)
def test_simulation_is_the_exact_discretisation(holds):
    u = random_inputs()
    y = mixed(u, holds)
    flown = record(y, u, {"u1": holds[0], "u2": holds[1]})
    for options in ({"substeps": 40}, {"integrator": "cvodes"}):
        found = cs.simulate(oscillator(), flown, [0.0, 0.0], **options)
        np.testing.assert_allclose(found.outputs, y, atol=3e-7)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("holds", HOLDS.values(), ids=HOLDS)
def test_every_transcription_recovers_the_parameters(holds, method):
    u = random_inputs()
    flown = record(mixed(u, holds), u, {"u1": holds[0], "u2": holds[1]})
    problem = cs.Problem(oscillator(), flown, free=["*"], start=START, noise={"y0": 0.01, "y1": 0.01})
    fit = cs.solve(problem, method)
    assert fit.converged and fit.values == pytest.approx(TRUTH, abs=2e-5)
    other = cs.solve(replace(problem, records=[replace(flown, hold="linear" if "zoh" in holds else "held")]), method)
    assert max(abs(other.values[n] - TRUTH[n]) for n in TRUTH) > 0.01  # another hold is another model


def along_polynomial(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u (N, 2) and exact motion (N, 2) from rest of inputs that are polynomials of third degree in time."""
    c = np.array([[0.3, 0.2, -0.06, 0.004], [-0.1, 0.3, 0.02, -0.003]])  # u_j = sum of c[j, k] t^k
    # states, then 1, t, t^2, t^3
    big = np.zeros((6, 6))
    big[:2, :2], big[:2, 2:] = A, B @ c
    big[3, 2], big[4, 3], big[5, 4] = 1.0, 2.0, 3.0
    begin = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    u = np.stack([np.polynomial.polynomial.polyval(t, row) for row in c], axis=1)
    return u, np.array([(expm(big * one) @ begin)[:2] for one in t])


COARSE = np.concatenate([np.arange(0.0, 4.0, 0.8), np.arange(4.2, 12.0, 0.6)])


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_cubic_inputs_follow_polynomials_exactly(method):
    """A cubic spline is the polynomial of third degree that it goes through, at coarse and uneven samples too."""
    u, y = along_polynomial(COARSE)
    flown = record(y, u, "cubic", COARSE)
    problem = cs.Problem(oscillator(), flown, free=["*"], start=START, noise={"y0": 0.01, "y1": 0.01})
    fit = cs.solve(problem, replace(method, substeps=20))
    assert fit.converged and fit.values == pytest.approx(TRUTH, abs=1e-4)
    assert fit.problem is problem
    straight = cs.solve(replace(problem, records=[replace(flown, hold="linear")]), replace(method, substeps=20))
    assert max(abs(straight.values[n] - TRUTH[n]) for n in TRUTH) > 0.005


def test_simulation_along_a_cubic_and_a_held_input():
    u, _ = along_polynomial(COARSE)
    flown = record(np.zeros_like(u), u, {"u1": "cubic", "u2": "held"}, COARSE)
    found = [
        cs.simulate(oscillator(), flown, [0.0, 0.0], **options)
        for options in ({"substeps": 60}, {"integrator": "cvodes"})
    ]
    np.testing.assert_allclose(found[0].states, found[1].states, atol=1e-7)
    assert found[0].record is flown
    # each alone: the motion is linear in the inputs
    alone = [u * [1.0, 0.0], u * [0.0, 1.0]]
    parts = [
        cs.simulate(oscillator(), record(np.zeros_like(u), one, how, COARSE), [0.0, 0.0], substeps=60).states
        for one, how in zip(alone, ("cubic", "held"), strict=True)
    ]
    np.testing.assert_allclose(found[0].states, parts[0] + parts[1], atol=1e-12)


@pytest.mark.skipif(compiler.c_compiler() is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("hold", ["cubic", {"u1": "cubic", "u2": "held"}, {"u1": "held"}])
def test_the_kernel_agrees_with_the_virtual_machine(hold, own_cache, monkeypatch):
    u = random_inputs()
    problem = along_splines(
        cs.Problem(oscillator(), record(0.5 * u, u, hold), free=["*"], noise={"y0": 0.01, "y1": 0.01})
    )

    def blocks():
        objective = build_objective(problem, cs.MultipleShooting(interval=9, substeps=2))
        value = objective.value(objective.start())
        return objective.dynamics, objective.linearise(objective.start(), value)

    dynamics, plain = blocks()
    assert dynamics.kernel is None
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    dynamics, fast = blocks()
    assert dynamics.kernel is not None
    for name in ("hessian", "gradient", "transition", "end"):
        one, other = getattr(plain.blocks, name), getattr(fast.blocks, name)
        np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-10 * np.abs(one).max())


def sysid(hold: str, samples: int = 2000) -> cs.Problem:
    """CasADi's docs/examples/python/sysid.py: a mass on a nonlinear spring, random force that is held, 610.1 Hz, ten
    steps of Runge and Kutta per sample in the simulation; its own guess and scale of the parameters."""
    model = cs.define_model(
        "casadi sysid",
        states=("y", "dy"),
        inputs=("u",),
        parameters=SYSID_GUESS,
        outputs=("z",),
        dynamics=lambda s: {
            "y": s.dy,
            "dy": (s.u - s.k_NL * s.y**3 - s.k * s.y - 1e-4 * s.c * s.dy) / (1e-6 * s.M),
        },
        output=lambda s: {"z": s.y},
        state_scale={"y": 0.1, "dy": 30.0},
    )
    u = 0.1 * np.random.default_rng(0).random(samples)
    x, u_of, p = ca.SX.sym("x", 2), ca.SX.sym("u"), model.nominal_vector(SYSID_TRUTH)
    f = ca.Function("f", [model.x, model.u, model.p], [model.f])
    h, after = 1.0 / 610.1 / 10, x
    for _ in range(10):
        k1 = f(after, u_of, p)
        k2 = f(after + h / 2 * k1, u_of, p)
        k3 = f(after + h / 2 * k2, u_of, p)
        after = after + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(after + h * k3, u_of, p))
    chain = ca.Function("step", [x, u_of], [after]).mapaccum("chain", samples - 1)
    y = np.hstack([np.zeros((2, 1)), chain([0.0, 0.0], u[None, :-1]).full()])[0]
    z = y + 1e-3 * np.random.default_rng(1).standard_normal(samples)
    record = cs.Record(name="m", t=np.arange(samples) / 610.1, channels={"u": u, "z": z}, hold=hold)
    return cs.Problem(model, record, free=["*"], noise={"z": 1e-3})


SYSID_TRUTH = {"M": 5.625, "c": 2.3, "k": 1.0, "k_NL": 4.69}
SYSID_GUESS = {"M": 5.0, "c": 2.0, "k": 1.0, "k_NL": 5.0}


def test_casadis_example_of_system_identification_with_its_held_input():
    fit = cs.solve(sysid("zoh"))
    assert fit.converged
    for name, truth in SYSID_TRUTH.items():
        assert abs(fit[name].value - truth) < 4.0 * fit[name].std
    assert abs(fit["k_NL"].value / SYSID_TRUTH["k_NL"] - 1.0) < 0.02
    assert not any("held" in remark for remark in fit.remarks)


def test_a_held_input_that_is_taken_as_linear_is_remarked():
    """The same data as linear: k_NL is 10 % off, and the remark says what the hold is worth."""
    fit = cs.solve(sysid("linear"))
    assert abs(fit["k_NL"].value / SYSID_TRUTH["k_NL"] - 1.0) > 0.05
    said = [remark for remark in fit.remarks if "'u'" in remark and "held" in remark]
    assert len(said) == 1


def test_steps_that_are_linear_indeed_are_not_remarked():
    """An input that jumps, and a system that got it along straight lines."""
    u = np.where(T[:, None] % np.array([4.0, 2.6]) < np.array([2.0, 1.1]), [1.0, -0.5], 0.0)
    u[0] = 0.0
    flown = record(mixed(u, ("foh", "foh")), u, "linear", noise=0.01)
    fit = cs.solve(cs.Problem(oscillator(), flown, free=["*"], start=START))
    assert fit.converged and not any("held" in remark for remark in fit.remarks)


@pytest.mark.parametrize("hold", [{"u1": "held"}, {"u2": "held"}, "cubic"])
def test_filter_error_takes_each_hold(hold):
    """Little process noise: the estimates of output error, of the same hold, within a few standard errors."""
    u = random_inputs()
    model = oscillator(("w",))
    quiet = cs.simulate(model, record(np.zeros((len(T), 2)), u, hold), [0.0, 0.0], substeps=20)
    flown = record(quiet.outputs, u, hold, noise=0.02)
    problem = cs.Problem(model, flown, free=["*"], start=START, noise={"y0": 0.02, "y1": 0.02})
    problem = replace(problem, cost=cs.FilterError(process_noise={"w": 0.0}))
    fit = cs.solve(problem)
    assert fit.converged and fit.problem is problem
    for name, truth in TRUTH.items():
        assert abs(fit.values[name] - truth) < 4.0 * fit[name].std + 0.01 * abs(truth)


def test_records_keep_their_holds(tmp_path):
    t = np.arange(0.0, 6.0, 0.05)
    channels = {"delta_e": 0.01 * np.sin(t), "thrust": 100.0 * np.sin(t), "q": 0.1 * np.cos(t)}
    flown = cs.Record(name="m", t=t, channels=channels, hold={"delta_e": "zoh", "thrust": "cubic"})
    assert flown.hold == {"delta_e": "held", "thrust": "cubic"} and flown.hold_of("q") == flown.hold_of("t") == "linear"
    cs.write_record(flown, tmp_path / "m.csv")
    back = cs.read_record(tmp_path / "m.csv")
    assert back.hold == flown.hold and "delta_e = held, thrust = cubic" in repr(back)
    made = cs.Record.from_arrays("m", t, channels, hold={"delta_e": "held"})
    assert made.hold_of("delta_e") == "held" and made.hold_of("thrust") == "linear"
    with pytest.raises(InputError, match="unknown channel 'u3'"):
        record(np.zeros((4, 2)), np.ones((4, 2)), {"u3": "held"}, np.arange(4.0))
    with pytest.raises(InputError, match="did you mean 'cubic'"):
        record(np.zeros((4, 2)), np.ones((4, 2)), {"u1": "cubik"}, np.arange(4.0))
