"""Events at known times. Truth: the closed form of a linear motion with doses, and scipy's integrator from event to
event."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import casid as cs
from casid.errors import EstimationError, InputError
from casid.estimation.attempt import build_objective

TRUTH = {"k": 0.4, "V": 20.0, "share": 0.7}
DOSES = [0.0, 3.3, 8.0]  # the first at the first sample, the second between samples, the third at a sample
T = np.linspace(0.0, 12.0, 25)
KNOWN = cs.InitialState(value={"A": 0.0}, std={"A": 0.0})


def drug() -> cs.Model:
    """An amount that decays, and doses of which a share arrives."""
    return cs.define_model(
        "drug",
        states=("A",),
        inputs=("amount",),
        parameters={"k": 0.25, "V": 20.0, "share": 0.5},
        outputs=("c",),
        dynamics=lambda s: {"A": -s.k * s.A},
        output=lambda s: {"c": s.A / s.V},
        events=lambda s: {"dose": {"A": s.A + s.share * s.amount}},
        state_scale={"A": 100.0},
    )


def on_paper(t: np.ndarray, amounts: tuple[float, ...] = (100.0, 50.0, 80.0), p: dict = TRUTH) -> np.ndarray:
    """Concentration: every dose decays from its time on."""
    parts = [
        np.where(t >= at - 1e-12, p["share"] * a * np.exp(-p["k"] * np.maximum(t - at, 0.0)), 0.0)
        for at, a in zip(DOSES, amounts, strict=True)
    ]
    return np.sum(parts, axis=0) / p["V"]


def patient(noise: float = 0.0, name: str = "a") -> cs.Record:
    amount = np.where(T < 3.0, 100.0, np.where(T < 8.0, 50.0, 80.0))  # held: 50 at 3.3 s
    c = on_paper(T) + noise * np.random.default_rng(1).standard_normal(len(T))
    return cs.Record(name=name, t=T, channels={"amount": amount, "c": c}, hold="held", events={"dose": DOSES})


@pytest.mark.parametrize("integrator", ["runge-kutta", "cvodes"])
def test_simulation_is_the_closed_form(integrator: str) -> None:
    steps = 60 if integrator == "runge-kutta" else 1
    found = cs.simulate(drug(), patient(), [0.0], TRUTH, substeps=steps, integrator=integrator)
    assert np.abs(found.output("c") - on_paper(T)).max() < 1e-8


METHODS = {
    "single": cs.SingleShooting(),
    "multiple": cs.MultipleShooting(interval=4),
    "every sample": cs.MultipleShooting(interval=1),
    "implicit": cs.SingleShooting(implicit=True),
    "collocation": cs.Collocation(),
}


@pytest.mark.parametrize("name", METHODS)
def test_estimates_and_their_deviations_are_those_of_the_closed_form(name: str) -> None:
    """Least squares on paper, with derivatives by differences."""
    record = patient(noise=0.02)
    problem = cs.Problem(drug(), [record], free=["k", "share"], noise={"c": 0.02}, initial_state=KNOWN)
    fit = cs.solve(problem, METHODS[name])
    least = least_squares(
        lambda q: (on_paper(T, p=TRUTH | {"k": q[0], "share": q[1]}) - record["c"]) / 0.02, [0.3, 0.6], xtol=1e-14
    )
    assert fit.status == "converged"
    assert [fit.values["k"], fit.values["share"]] == pytest.approx(least.x.tolist(), rel=2e-4)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(
        np.sqrt(np.diag(np.linalg.inv(least.jac.T @ least.jac))), rel=2e-3
    )
    assert fit.log_likelihood == pytest.approx(-0.5 * (2 * least.cost + 25 * np.log(2 * np.pi * 0.02**2)), abs=0.01)


def test_a_nonlinear_programme_comes_to_the_same() -> None:
    problem = cs.Problem(drug(), [patient(noise=0.02)], free=["k", "share"], noise={"c": 0.02}, initial_state=KNOWN)
    method = cs.MultipleShooting(interval=4, substeps=4)
    one, other = cs.solve(problem, method), cs.solve(problem, method, cs.Ipopt())
    assert other.values == pytest.approx(one.values, rel=1e-6)


def ball() -> cs.Model:
    """A ball that is kicked upwards and loses speed when it is: two states, a jump that depends on the state and on
    parameters, and air drag that is not linear."""
    return cs.define_model(
        "ball",
        states=("h", "v"),
        inputs=(),
        parameters={"drag": 0.02, "loss": 0.8, "kick": 12.0},
        outputs=("h",),
        dynamics=lambda s: {"h": s.v, "v": -9.81 - s.drag * s.v * np.fabs(s.v)},
        output=lambda s: {"h": s.h},
        events=lambda s: {"kick": {"v": s.kick - s.loss * s.v}, "brake": {"v": 0.3 * s.v}},
    )


KICKS = {"kick": (0.77, 1.9), "brake": (1.9, 2.6)}  # two events at one time: the kick first


def thrown(p: dict[str, float], t: np.ndarray) -> np.ndarray:
    """(N, 2) by scipy, from event to event."""

    def run(x, a, b, at):
        def rates(_, x):
            return [x[1], -9.81 - p["drag"] * x[1] * abs(x[1])]

        motion = solve_ivp(rates, (a, b), x, dense_output=True, rtol=1e-11, atol=1e-12, method="DOP853")
        return motion.sol(at).T

    found, x, begin = [], np.array([50.0, 0.0]), 0.0
    for time, names in ((0.77, "k"), (1.9, "kb"), (2.6, "b"), (4.0, "")):
        inside = t[(t >= begin) & (t < time)] if names else t[t >= begin]
        states = run(x, begin, time, np.append(inside, time))
        found.append(states[:-1])
        x = states[-1]
        for event in names:
            x = np.array([x[0], p["kick"] - p["loss"] * x[1] if event == "k" else 0.3 * x[1]])
        begin = time
    return np.concatenate(found)


@pytest.mark.parametrize("method", [cs.SingleShooting(substeps=2), cs.MultipleShooting(interval=5, substeps=2)])
def test_motion_and_derivatives_are_those_of_scipy(method) -> None:
    """Predictions, and their sensitivities through the jumps against differences of scipy's."""
    t, p = np.linspace(0.0, 4.0, 41), {"drag": 0.02, "loss": 0.8, "kick": 12.0}
    h = thrown(p, t)[:, 0]
    record = cs.Record(name="m", t=t, channels={"h": h}, events=KICKS)
    found = cs.simulate(ball(), record, [50.0, 0.0], substeps=4)
    assert np.abs(found.states - thrown(p, t)).max() < 1e-5
    exact = cs.InitialState(value={"h": 50.0, "v": 0.0}, std={"h": 0.0, "v": 0.0})
    problem = cs.Problem(ball(), [record], free=["*"], noise={"h": 0.1}, initial_state=exact)
    fit = cs.solve(problem, method)
    assert all(abs(fit.values[n] - v) < 0.01 * fit[n].std_cramer_rao for n, v in p.items())
    jacobian = []
    for name, value in p.items():
        step = 1e-5 * value
        sides = [thrown(p | {name: value + s * step}, t)[:, 0] for s in (1.0, -1.0)]
        jacobian.append((sides[0] - sides[1]) / (2.0 * step) / 0.1)
    information = np.array(jacobian) @ np.array(jacobian).T
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=2e-3, atol=0.0)
    assert fit.states["m"].trajectory.shape == (41, 2)


@pytest.mark.parametrize("method", [cs.MultipleShooting(interval=5), cs.Collocation()], ids=["shooting", "collocation"])
def test_kernel_and_numpy_agree(method, own_cache, monkeypatch) -> None:
    t = np.linspace(0.0, 4.0, 41)
    records = [cs.Record(name="m", t=t, channels={"h": np.cos(t)}, events=KICKS)]
    records.append(cs.Record(name="still", t=t[:17], channels={"h": np.cos(t[:17])}))
    problem = cs.Problem(ball(), records, free=["*"], noise={"h": 0.1})

    def blocks():
        objective = build_objective(problem, method)
        value = objective.value(objective.start())
        return objective.linearise(objective.start(), value).blocks

    plain = blocks()
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    fast = blocks()
    for name in ("hessian", "gradient", "transition", "end"):
        one, other = getattr(plain, name), getattr(fast, name)
        np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-10 * np.abs(one).max())


def test_logarithms_and_initial_states_by_formula_are_taken() -> None:
    """Both change the coordinates of the state and of the parameters, in the jump too."""
    model = cs.define_model(
        "drug",
        states=("A",),
        inputs=("amount",),
        parameters={"k": 0.25, "V": 20.0, "share": 0.5, "A0": 5.0},
        outputs=("c",),
        dynamics=lambda s: {"A": -s.k * s.A},
        output=lambda s: {"c": s.A / s.V},
        initial=lambda s: {"A": s.A0},
        events=lambda s: {"dose": {"A": 0.9 * s.A + s.share * s.amount}},
        state_scale={"A": 100.0},
    )
    truth = {"k": 0.4, "share": 0.7, "A0": 8.0}
    still = patient()
    c = cs.simulate(model, still, [8.0], truth, substeps=20).output("c")
    fit = cs.solve(
        cs.Problem(model, [still.with_channels(c=c)], free=list(truth), log=["k", "share"], noise={"c": 0.02})
    )
    assert fit.status == "converged" and fit.values == pytest.approx(truth, rel=2e-3)


def test_times_go_with_the_record() -> None:
    record = patient()
    assert record.between(3.0, 9.0).events == {"dose": (3.3, 8.0)}
    assert pickle.loads(pickle.dumps(record)).events == record.events
    model = pickle.loads(pickle.dumps(drug()))
    assert np.abs(cs.simulate(model, record, [0.0], TRUTH, substeps=60).output("c") - on_paper(T)).max() < 1e-8


def test_what_makes_no_sense_is_refused(tmp_path) -> None:
    record = patient()
    for change, said in (({"dose": [20.0]}, "outside the record"), ({"dose": ["x"]}, "expected numbers")):
        with pytest.raises(InputError, match=said):
            replace(record, events=change)
    strange = replace(record, events={"doze": [1.0]})
    with pytest.raises(InputError, match="dose"):
        cs.Problem(drug(), [strange], free=["k"])
    with pytest.raises(InputError, match="dose"):
        cs.simulate(drug(), strange, [0.0])
    with pytest.raises(EstimationError, match="events"):
        cs.Problem(drug(), [record], free=["k"], cost=cs.EquationError())
    with pytest.raises(InputError, match="events"):
        cs.write_record(record, tmp_path / "a.csv")
    with pytest.raises(InputError, match="discrete"):
        replace(drug(), period=1.0)


def test_counts_over_an_interval():
    """Weekly cases of an epidemic, added up by scipy over each week."""
    truth, weeks = {"beta": 1.5, "gamma": 0.8, "I0": 0.01}, np.arange(15.0)

    def spread(_: float, x: np.ndarray) -> list[float]:
        new = truth["beta"] * x[0] * x[1]
        return [-new, new - truth["gamma"] * x[1], new]

    whole = solve_ivp(spread, (0.0, 14.0), [0.99, 0.01, 0.0], t_eval=weeks, rtol=1e-10, atol=1e-12).y[2]
    cases = np.concatenate([[np.nan], 1000.0 * np.diff(whole)])
    model = cs.define_model(
        "epidemic",
        states=("S", "I", "new", "counted"),
        inputs=(),
        parameters={"beta": 1.2, "gamma": 0.6, "I0": 0.02},
        outputs=("cases",),
        dynamics=lambda s: {
            "S": -s.beta * s.S * s.I,
            "I": s.beta * s.S * s.I - s.gamma * s.I,
            "new": s.beta * s.S * s.I,
            "counted": 0.0,
        },
        output=lambda s: {"cases": 1000.0 * s.counted},
        initial=lambda s: {"S": 1.0 - s.I0, "I": s.I0, "new": 0.0, "counted": 0.0},
        events=lambda s: {"week": {"counted": s.new, "new": 0.0}},
    )
    record = cs.Record(name="a", t=weeks, channels={"cases": cases}, events={"week": weeks[1:].tolist()})
    fit = cs.solve(cs.Problem(model, record, free=["*"], noise={"cases": 1.0}))
    assert fit.converged
    for name, value in truth.items():
        assert fit[name].value == pytest.approx(value, abs=0.1 * fit[name].std)
