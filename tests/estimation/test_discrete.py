"""Models in discrete time. Truth: scipy's simulation of a linear system, least squares by numpy, differences, and the
same motion in continuous time with its exact discretisation."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import dlsim

import casid as cs
from casid.errors import InputError
from casid.estimation.attempt import build_objective
from casid.native import compiler

PERIOD = 0.2
TRUTH = {"a1": 1.5, "a2": -0.7, "b": 0.5}
U = np.random.default_rng(1).standard_normal(300)
T = PERIOD * np.arange(300)
NEEDS_COMPILER = pytest.mark.skipif(compiler.c_compiler() is None, reason="no C compiler on this machine")


def second_order(**more) -> cs.Model:
    """y[k+2] = a1 y[k+1] + a2 y[k] + b u[k]."""
    return cs.define_model(
        "second order",
        states=("y", "later"),
        inputs=("u",),
        parameters=TRUTH,
        outputs=("y",),
        period=PERIOD,
        dynamics=lambda s: {"y": s.later, "later": s.a1 * s.later + s.a2 * s.y + s.b * s.u},
        output=lambda s: {"y": s.y},
        **more,
    )


def by_scipy(u: np.ndarray = U, truth: dict[str, float] = TRUTH) -> np.ndarray:
    """(N,) output of the second-order system from rest."""
    a = np.array([[0.0, 1.0], [truth["a2"], truth["a1"]]])
    b, c, d = np.array([[0.0], [truth["b"]]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
    return dlsim((a, b, c, d, PERIOD), u)[1][:, 0]


def logistic(disturbances: tuple[str, ...] = ()) -> cs.Model:
    """Ricker's map of a population, which is not linear."""
    return cs.define_model(
        "ricker",
        states=("n",),
        inputs=("catch",),
        parameters={"r": 0.6, "k": 10.0},
        outputs=("counted",),
        disturbances=disturbances,
        period=1.0,
        dynamics=lambda s: {"n": s.n * np.exp(s.r * (1.0 - s.n / s.k)) - s.catch + (s.w if disturbances else 0.0)},
        output=lambda s: {"counted": s.n},
        state_scale={"n": 10.0},
    )


def population(n: int = 60, noise: float = 0.2, seed: int = 2, name: str = "years") -> cs.Record:
    rng = np.random.default_rng(seed)
    still = cs.Record(name=name, t=np.arange(float(n)), channels={"catch": rng.uniform(0.0, 2.0, n)})
    flown = cs.simulate(logistic(), still, [3.0], {"r": 0.9, "k": 12.0}).as_record()
    return flown.with_channels(counted=flown["counted"] + noise * rng.standard_normal(n))


def measured(noise: float = 0.05) -> cs.Record:
    y = by_scipy() + noise * np.random.default_rng(3).standard_normal(len(U))
    return cs.Record(name="m", t=T, channels={"u": U, "y": y})


def test_simulation_is_that_of_scipy() -> None:
    found = cs.simulate(second_order(), cs.Record(name="m", t=T, channels={"u": U}), [0.0, 0.0])
    assert np.abs(found.output("y") - by_scipy()).max() < 1e-12


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting(), cs.MultipleShooting(interval=1)])
def test_output_error_is_least_squares_on_scipy(method) -> None:
    """The minimum of the sum of squares of dlsim's output, found without any derivative of casid's."""
    record, rest = measured(), cs.InitialState(value={"y": 0.0, "later": 0.0}, std={"y": 0.0, "later": 0.0})
    problem = cs.Problem(
        second_order(), [record], free=["*"], noise={"y": 0.05}, initial_state=rest, start={"a1": 1.3, "b": 0.3}
    )
    fit = cs.solve(problem, method)
    least = least_squares(
        lambda p: by_scipy(U, dict(zip(TRUTH, p, strict=True))) - record["y"], list(TRUTH.values()), xtol=1e-14
    )
    assert fit.status == "converged"
    assert [fit.values[n] for n in TRUTH] == pytest.approx(least.x.tolist(), rel=1e-5)
    covariance = 0.05**2 * np.linalg.inv(least.jac.T @ least.jac)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-3)


def test_equation_error_is_linear_regression() -> None:
    """Ljung, System Identification, 4.2: an ARX model by least squares."""
    record = measured()
    y = record["y"]
    later = np.append(y[1:], np.nan)
    record = record.with_channels(later=later)
    fit = cs.solve(cs.Problem(second_order(), [record], free=["*"], cost=cs.EquationError()))
    regressors = np.stack([y[1:-1], y[:-2], U[:-2]], axis=1)
    expected = np.linalg.lstsq(regressors, y[2:], rcond=None)[0]
    assert [fit.values[n] for n in ("a1", "a2", "b")] == pytest.approx(expected.tolist(), rel=1e-9)


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=NEEDS_COMPILER)])
def test_derivatives_are_differences(compiled: bool, own_cache, monkeypatch) -> None:
    """Gradients and transitions of a map that is not linear, in records of two lengths."""
    if compiled:
        monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    problem = cs.Problem(
        logistic(), [population(), population(37, seed=4, name="short")], free=["*"], noise={"counted": 0.2}
    )
    objective = build_objective(problem, cs.SingleShooting())
    point = replace(objective.start(), nodes=np.array([[4.0], [6.0]]))
    value = objective.value(point)
    parameters = problem.model_parameters(point.theta)
    assert objective.dynamics is not None and value.trajectory is not None
    blocks = objective.dynamics.blocks(value.trajectory, parameters, objective.whitening(value.noise.levels))
    assert (objective.dynamics.kernel is not None) == compiled

    motion = objective.dynamics.trajectory

    def squares(nodes: np.ndarray, p: np.ndarray) -> np.ndarray:
        y = motion(nodes, p).y
        off = (y - objective.layout.z) * objective.layout.present / 0.2
        return 0.5 * (off**2).sum(axis=(1, 2))

    step = 1e-6
    for j in range(3):  # initial state, r, k
        sides = []
        for sign in (1.0, -1.0):
            nodes, p = point.nodes.copy(), parameters.copy()
            (nodes if j == 0 else p)[:, max(j - 1, 0)] += sign * step * 10.0
            sides.append((squares(nodes, p), motion(nodes, p).end[:, 0]))
        slope = [(a - b) / (20.0 * step) for a, b in zip(*sides, strict=True)]
        assert blocks.gradient[:, j] == pytest.approx(slope[0], rel=1e-5, abs=1e-5)
        assert blocks.transition[:, 0, j] == pytest.approx(slope[1], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(
    "change", [{}, {"log": ["k"]}, {"initial": True}], ids=["plain", "by logarithm", "initial state by formula"]
)
def test_every_way_of_posing_it_comes_to_the_truth(change: dict) -> None:
    """Within four standard deviations of the parameters that made the record; by all solvers the same."""
    records = [population(seed=seed, name=f"m{seed}") for seed in (2, 3)]
    model = logistic()
    if change.pop("initial", False):
        model = cs.define_model(
            "ricker",
            states=("n",),
            inputs=("catch",),
            parameters={"r": 0.6, "k": 10.0, "n0": 5.0},
            outputs=("counted",),
            period=1.0,
            dynamics=lambda s: {"n": s.n * np.exp(s.r * (1.0 - s.n / s.k)) - s.catch},
            output=lambda s: {"counted": s.n},
            initial=lambda s: {"n": s.n0},
            state_scale={"n": 10.0},
        )
    problem = cs.Problem(model, records, free=["*"], **change)
    fit = cs.solve(problem)
    truth = {"r": 0.9, "k": 12.0, "n0": 3.0}
    assert fit.status == "converged"
    assert all(abs(v - truth[n]) < 4.0 * fit[n].std for n, v in fit.values.items())
    other = cs.solve(problem, cs.SingleShooting(), cs.Ipopt())
    assert other.values == pytest.approx(fit.values, rel=1e-5)


def test_process_noise_is_by_sample() -> None:
    """The covariance that a linear map x+ = a x + w gains over m samples is q^2 (1 + a^2 + ... + a^2(m-1))."""
    a, q, m = 0.9, 0.3, 5
    model = cs.define_model(
        "noisy",
        states=("x",),
        inputs=(),
        parameters={"a": a},
        outputs=("x",),
        disturbances=("w",),
        period=0.5,
        dynamics=lambda s: {"x": s.a * s.x + s.w},
        output=lambda s: {"x": s.x},
    )
    record = cs.Record(name="m", t=0.5 * np.arange(20.0), channels={"x": 0.9 ** np.arange(20.0)})
    problem = cs.Problem(model, [record], free=["a"], noise={"x": 0.1})
    for name in ("w", "x"):
        objective = build_objective(problem, cs.MultipleShooting(interval=m, process_noise={name: q}))
        value = objective.value(objective.start())
        assert objective.dynamics is not None and value.trajectory is not None
        found = objective.dynamics.blocks(
            value.trajectory, value.parameters[objective.layout.record], objective.whitening(value.noise.levels)
        )
        assert found.covariance is not None
        assert found.covariance[0, 0, 0] == pytest.approx(q**2 * sum(a ** (2 * k) for k in range(m)), rel=1e-10)


def test_missing_readings_and_an_unmeasured_state_are_no_obstacle() -> None:
    record = measured()
    y = record["y"].copy()
    y[40:60] = np.nan
    fit = cs.solve(cs.Problem(second_order(), [record.with_channels(y=y)], free=["*"]))
    assert fit.status == "converged"
    assert all(abs(fit.values[n] - TRUTH[n]) < 4.0 * fit[n].std for n in TRUTH)


def test_what_makes_no_sense_is_refused_in_one_line() -> None:
    model, record = second_order(), measured()
    problem = cs.Problem(model, [record], free=["*"])
    refused = (
        lambda: cs.solve(problem, cs.Collocation()),
        lambda: cs.solve(problem, cs.SingleShooting(implicit=True)),
        lambda: cs.solve(problem, cs.MultipleShooting(substeps=2)),
        lambda: cs.simulate(model, record, [0.0, 0.0], integrator="cvodes"),
        lambda: cs.simulate(model, record, [0.0, 0.0], substeps=3),
        lambda: cs.linear_model(model, {}),
        lambda: cs.diagnose(model, [record]),
        lambda: cs.solve(cs.Problem(model, [record], free=["*"], cost=cs.FourierEquationError(band=(1.0, 5.0)))),
        lambda: cs.solve(cs.Problem(model, [record], free=["*"], cost=cs.FourierOutputError(band=(1.0, 5.0)))),
    )
    for one in refused:
        with pytest.raises(InputError, match="discrete time") as error:
            one()
        assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="takes one sample every 0.2 s"):
        cs.Problem(model, [cs.Record(name="m", t=np.delete(T, 7), channels={"u": U[1:], "y": U[1:]})], free=["*"])
    with pytest.raises(InputError, match="period"):
        cs.define_model(
            "x",
            states=("x",),
            inputs=(),
            parameters={},
            outputs=("x",),
            period=-1.0,
            dynamics=lambda s: {"x": s.x},
            output=lambda s: {"x": s.x},
        )


def test_it_can_be_kept() -> None:
    again = pickle.loads(pickle.dumps(second_order()))
    assert again.period == PERIOD
