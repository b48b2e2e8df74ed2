"""Algebraic states of index 1. Truth: IDAS of SUNDIALS on the equations as they are, and an elimination by hand."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

CELL = {"C": 0.8, "leak": 0.4, "gain": 1.5}


def clipper(**more) -> cs.Model:
    """A capacitor whose current z goes through a branch like a diode: x + u = z + gain sinh(z), without a formula."""
    return cs.define_model(
        "clipper",
        states=("x",),
        inputs=("u",),
        parameters=CELL,
        outputs=("x", "current"),
        algebraic={"z": 0.1},
        dynamics=lambda s: {"x": -(s.z + s.leak * s.x) / s.C},
        output=lambda s: {"x": s.x, "current": s.z},
        balance=lambda s: {"z": s.z + s.gain * np.sinh(s.z) - s.x - s.u},
        **more,
    )


def by_idas(t: np.ndarray, u: np.ndarray, p: dict[str, float], start: float = 0.5) -> np.ndarray:
    """(N, 2) state and current: IDAS from sample to sample with a straight input, current where the balance is met."""
    x, z, s = ca.SX.sym("x"), ca.SX.sym("z"), ca.SX.sym("s")
    a, b, dt, q = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("dt"), ca.SX.sym("q", 3)
    dae = {
        "x": x,
        "z": z,
        "t": s,
        "p": ca.vertcat(a, b, dt, q),
        "ode": -dt * (z + q[1] * x) / q[0],
        "alg": z + q[2] * ca.sinh(z) - x - a - s * (b - a),
    }
    step = ca.integrator("step", "idas", dae, 0.0, 1.0, {"reltol": 1e-11, "abstol": 1e-13})
    values, states, now = [p[n] for n in ("C", "leak", "gain")], [start], start
    for k, duration in enumerate(np.diff(t)):
        now = float(step(x0=now, z0=0.2, p=[u[k], u[k + 1], duration, *values])["xf"])
        states.append(now)
    current = []
    for state, one in zip(states, u, strict=True):  # bisection: the balance grows with z
        low, high = -10.0, 10.0
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if middle + p["gain"] * np.sinh(middle) < state + one else (low, middle)
        current.append(low)
    return np.stack([states, current], axis=1)


T = np.linspace(0.0, 6.0, 61)
U = 2.0 * np.sin(2.0 * T)


def test_simulation_is_that_of_idas() -> None:
    record = cs.Record(name="m", t=T, channels={"u": U})
    truth = by_idas(T, U, CELL)
    assert np.abs(cs.simulate(clipper(), record, [0.5], substeps=8).outputs - truth).max() < 1e-7
    assert np.abs(cs.simulate(clipper(), record, [0.5], integrator="cvodes").outputs - truth).max() < 1e-8


@pytest.mark.parametrize(
    "method", [cs.SingleShooting(), cs.MultipleShooting(), cs.SingleShooting(implicit=True), cs.Collocation()]
)
def test_estimates_and_sensitivities_are_those_of_idas(method) -> None:
    """Parameters that made the record, and their covariance against differences of IDAS."""
    truth = by_idas(T, U, CELL)
    record = cs.Record(name="m", t=T, channels={"u": U, "x": truth[:, 0], "current": truth[:, 1]})
    noise = {"x": 0.01, "current": 0.02}
    exact = cs.InitialState(value={"x": 0.5}, std={"x": 0.0})
    problem = cs.Problem(
        clipper(), [record], free=["*"], start={"C": 1.0, "leak": 0.3, "gain": 1.2}, noise=noise, initial_state=exact
    )
    fit = cs.solve(problem, method)
    assert fit.converged
    assert all(abs(fit.values[n] - v) < 0.1 * fit[n].std_cramer_rao for n, v in CELL.items())
    columns = []
    for name, value in CELL.items():
        step = 1e-4 * value
        sides = [by_idas(T, U, CELL | {name: value + sign * step}) for sign in (1.0, -1.0)]
        columns.append(((sides[0] - sides[1]) / (2.0 * step) / [0.01, 0.02]).ravel())
    information = np.array(columns) @ np.array(columns).T
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=0.01)


def test_what_is_linear_in_it_is_written_out() -> None:
    """Robertson's reaction with the sum of shares as a balance: no call, the same derivatives as by hand."""
    rates = {"k1": 0.04, "k2": 3e7, "k3": 1e4}

    def moved(s, c):
        first = -s.k1 * s.a + s.k3 * s.b * c
        return {"a": first, "b": -first - s.k2 * s.b**2}

    common = {"states": ("a", "b"), "inputs": (), "parameters": rates, "outputs": ("c",)}
    model = cs.define_model(
        "robertson",
        **common,
        algebraic={"c": 0.0},
        dynamics=lambda s: moved(s, s.c),
        output=lambda s: {"c": s.c},
        balance=lambda s: {"c": s.a + s.b + s.c - 1.0},
    )
    by_hand = cs.define_model(
        "by hand", **common, dynamics=lambda s: moved(s, 1.0 - s.a - s.b), output=lambda s: {"c": 1.0 - s.a - s.b}
    )
    t = np.concatenate([[0.0], np.logspace(-2, 2, 30)])
    record = cs.Record(name="m", t=t, channels={})
    one, other = (cs.simulate(m, record, [1.0, 0.0], integrator="cvodes").output("c") for m in (model, by_hand))
    assert np.abs(one - other).max() < 1e-9
    dae = {"x": ca.SX.sym("x", 2), "z": ca.SX.sym("c")}
    a, b, c = dae["x"][0], dae["x"][1], dae["z"]
    first = -rates["k1"] * a + rates["k3"] * b * c
    dae |= {"ode": ca.vertcat(first, -first - rates["k2"] * b**2), "alg": a + b + c - 1.0}
    idas = ca.integrator("r", "idas", dae, 0.0, t[1:].tolist(), {"reltol": 1e-10, "abstol": 1e-14})
    found = idas(x0=[1.0, 0.0], z0=0.0)["zf"].full()[0]
    assert np.abs(one[1:] - found).max() < 1e-7
    written = ca.Function("f", [model.x, model.u, model.p], [model.f])
    assert "Newton" not in [one.class_name() for one in written.find_functions()]


def test_a_pendulum_in_cartesian_coordinates() -> None:
    """The force in the rod is algebraic once the length is differentiated twice; the angle swings as in the formula."""
    pendulum = cs.define_model(
        "rod",
        states=("x", "y", "vx", "vy"),
        inputs=(),
        parameters={"length": 0.8, "g": 9.81},
        outputs=("x",),
        algebraic={"force": 0.0},
        dynamics=lambda s: {
            "x": s.vx,
            "y": s.vy,
            "vx": -s.force * s.x / s.length,
            "vy": -s.force * s.y / s.length - s.g,
        },
        output=lambda s: {"x": s.x},
        balance=lambda s: {"force": s.vx**2 + s.vy**2 - s.force * s.length - s.g * s.y},
    )
    angle = cs.define_model(
        "angle",
        states=("a", "w"),
        inputs=(),
        parameters={"length": 0.8, "g": 9.81},
        outputs=("x",),
        dynamics=lambda s: {"a": s.w, "w": -s.g / s.length * np.sin(s.a)},
        output=lambda s: {"x": s.length * np.sin(s.a)},
    )
    record = cs.Record(name="m", t=np.linspace(0.0, 3.0, 61), channels={})
    start = [0.8 * np.sin(1.0), -0.8 * np.cos(1.0), 0.0, 0.0]
    one = cs.simulate(pendulum, record, start, integrator="cvodes").output("x")
    assert np.abs(one - cs.simulate(angle, record, [1.0, 0.0], integrator="cvodes").output("x")).max() < 1e-8


def test_it_is_kept_taken_by_logarithm_and_linearised() -> None:
    again = pickle.loads(pickle.dumps(clipper()))
    record = cs.Record(name="m", t=T, channels={"u": U})
    plain = cs.simulate(clipper(), record, [0.5], substeps=4)
    assert np.abs(cs.simulate(again, record, [0.5], substeps=4).outputs - plain.outputs).max() < 1e-12
    problem = cs.Problem(clipper(), [plain.as_record()], free=["gain"], log=["gain"], start={"gain": 2.5})
    assert cs.solve(problem).values["gain"] == pytest.approx(1.5, rel=1e-4)
    slope = cs.linear_model(clipper(), {"x": 0.5, "u": 0.2}).A[0, 0]
    grid = np.linspace(0.0, 1.0, 200001)
    root = float(np.interp(0.7, grid + 1.5 * np.sinh(grid), grid))
    # dz/dx = 1/(1 + gain cosh z)
    assert slope == pytest.approx(-(1.0 / (1.0 + 1.5 * np.cosh(root)) + 0.4) / 0.8, rel=1e-6)


def test_what_cannot_be_solved_is_said() -> None:
    with pytest.raises(InputError, match="belong together"):
        cs.define_model(
            "x",
            states=("x",),
            inputs=(),
            parameters={},
            outputs=("x",),
            algebraic={"z": 1.0},
            dynamics=lambda s: {"x": s.z},
            output=lambda s: {"x": s.x},
        )
    with pytest.raises(InputError, match="index above 1"):
        cs.define_model(
            "x",
            states=("x",),
            inputs=(),
            parameters={},
            outputs=("x",),
            algebraic={"z": 1.0},
            dynamics=lambda s: {"x": s.z},
            output=lambda s: {"x": s.x},
            balance=lambda s: {"z": s.x - 1.0},
        )
    rootless = cs.define_model(
        "x",
        states=("x",),
        inputs=(),
        parameters={},
        outputs=("x",),
        algebraic={"z": 1.0},
        dynamics=lambda s: {"x": s.z},
        output=lambda s: {"x": s.x},
        balance=lambda s: {"z": s.z**2 + 1.0 - s.x},
    )
    record = cs.Record(name="m", t=np.arange(5.0), channels={})
    with pytest.raises(InputError, match="no number"):
        cs.simulate(rootless, record, [0.0])
