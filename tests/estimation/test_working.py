"""Truth: the same residuals minimised by scipy, with the closed solution c0 exp(-k t) of a decay."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import casid as cs
from casid.errors import EstimationError, InputError

T = np.linspace(0.0, 5.0, 51)
EVERY_METHOD = (cs.SingleShooting(), cs.MultipleShooting(interval=10), cs.Collocation())
EVERY_SOLVER = (cs.Automatic(), cs.GaussNewton(), cs.Ipopt())


def decay(**more) -> cs.Model:
    return cs.define_model(
        "decay",
        states=["c"],
        inputs=[],
        parameters={"k": 1.0, "c0": 1.0},
        outputs=["y"],
        dynamics=lambda s: {"c": -s.k * s.c},
        output=lambda s: {"y": s.c},
        **more,
    )


def record(name: str, c0: float, rng: np.random.Generator) -> cs.Record:
    sigma = 0.01 + 0.05 * np.exp(-0.3 * T) * c0
    y = c0 * np.exp(-0.3 * T) + sigma * rng.standard_normal(len(T))
    y[7] = np.nan
    return cs.Record(name=name, t=T, channels={"y": y, "s_y": np.where(np.isnan(y), np.nan, sigma)})


@pytest.fixture(scope="module")
def records() -> list[cs.Record]:
    rng = np.random.default_rng(4)
    return [record("m1", 2.0, rng), record("m2", 5.0, rng)]


@pytest.fixture(scope="module")
def reference(records):
    """(k, c0[m1], c0[m2]), their 1-sigma and ln L, by scipy."""

    def residuals(p):
        both = [(c0 * np.exp(-p[0] * T) - r["y"]) / r["s_y"] for c0, r in zip(p[1:], records, strict=True)]
        return np.concatenate([r[np.isfinite(r)] for r in both])

    found = least_squares(residuals, [1.0, 1.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    sizes = np.concatenate([r["s_y"][np.isfinite(r["s_y"])] for r in records])
    likelihood = -0.5 * found.fun @ found.fun - np.log(sizes * np.sqrt(2.0 * np.pi)).sum()
    return found.x, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))), likelihood


@pytest.mark.parametrize("solver", EVERY_SOLVER, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("method", EVERY_METHOD, ids=lambda m: type(m).__name__)
def test_formula_of_the_start_logarithm_and_noise_per_sample(method, solver, records, reference):
    model = decay(initial=lambda s: {"c": s.c0})
    problem = cs.Problem(model, records, free=["k"], per_record=["c0"], log=["*"], noise={"y": "s_y"})
    fit = cs.solve(problem, method, solver)
    assert fit.converged, fit.status
    values, std, likelihood = reference
    np.testing.assert_allclose(list(fit.values.values()), values, rtol=1e-6)
    np.testing.assert_allclose([fit[n].std_cramer_rao for n in fit.values], std, rtol=1e-4)
    assert fit.log_likelihood == pytest.approx(likelihood, abs=1e-5)
    for r, c0 in zip(records, values[1:], strict=True):
        np.testing.assert_allclose(fit.states[r.name].trajectory[:, 0], c0 * np.exp(-values[0] * T), rtol=1e-5)
        np.testing.assert_allclose(fit.predictions[r.name][:, 0], c0 * np.exp(-values[0] * T), rtol=1e-5)
        np.testing.assert_allclose(
            fit.residuals[r.name][:, 0], r["y"] - fit.predictions[r.name][:, 0], rtol=0, atol=1e-9
        )
    assert fit.problem is problem and list(fit.channels) == ["y"] and fit["k"].prior == 1.0


@pytest.mark.parametrize("solver", EVERY_SOLVER, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("method", EVERY_METHOD, ids=lambda m: type(m).__name__)
def test_initial_states_that_are_known_exactly_and_differ(method, solver, records):
    """Held exactly, by their number or by a known parameter: k is that of the regression with c0 known."""
    weighed = [(r["y"], r["s_y"], c0) for r, c0 in zip(records, (2.1, 4.9), strict=True)]

    def residuals(p):
        both = [(c0 * np.exp(-p[0] * T) - y) / s for y, s, c0 in weighed]
        return np.concatenate([r[np.isfinite(r)] for r in both])

    wanted = least_squares(residuals, [1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14).x[0]
    by_number = cs.Problem(
        decay(),
        records,
        free=["k"],
        noise={"y": "s_y"},
        initial_state=cs.InitialState(value={"c[m1]": 2.1, "c[m2]": 4.9}, std={"c": 0.0}),
    )
    by_parameter = cs.Problem(
        decay(initial=lambda s: {"c": s.c0}),
        records,
        free=["k"],
        fixed={"c0[m1]": 2.1, "c0[m2]": 4.9},
        noise={"y": "s_y"},
    )
    for problem in (by_number, by_parameter):
        fit = cs.solve(problem, method, solver)
        assert fit.converged, fit.status
        assert fit["k"].value == pytest.approx(wanted, rel=1e-6)
        assert fit.states["m1"].trajectory[0, 0] == pytest.approx(2.1, abs=1e-12)
        assert fit.states["m2"].nodes[0, 0] == pytest.approx(4.9, abs=1e-12)


def test_limits_of_a_logarithm(records):
    """A limit that holds a parameter holds it, and its multiplier is that of the parameter itself."""
    model = decay(initial=lambda s: {"c": s.c0})
    limits = [cs.limit_parameter("k", lower=0.0, upper=0.25)]
    plain = cs.Problem(model, records, free=["k"], per_record=["c0"], noise={"y": "s_y"}, constraints=limits)
    by_log = cs.Problem(
        model, records, free=["k"], per_record=["c0"], noise={"y": "s_y"}, constraints=limits, log=["k"]
    )
    wanted, fit = cs.solve(plain), cs.solve(by_log)
    assert wanted.converged and fit.converged and fit["k"].value == pytest.approx(0.25, rel=1e-9)
    np.testing.assert_allclose(fit.multipliers, wanted.multipliers, rtol=1e-5)
    assert fit["c0[m2]"].value == pytest.approx(wanted["c0[m2]"].value, rel=1e-6)


def test_a_logarithm_reaches_what_is_orders_of_magnitude_away(records):
    model = decay(initial=lambda s: {"c": s.c0})
    asked = {"free": ["k"], "per_record": ["c0"], "noise": {"y": "s_y"}, "start": {"k": 1e-4, "c0": 100.0}}
    fit = cs.solve(cs.Problem(model, records, log=["*"], **asked))
    assert fit.converged and fit["k"].value == pytest.approx(0.3, abs=0.03)


def test_a_regression_with_noise_per_sample():
    """Weighted least squares by formula."""
    model = cs.define_regression(
        "line", inputs=["x"], parameters={"a": 1.0, "b": 0.0}, outputs=["y"], output=lambda s: {"y": s.a * s.x + s.b}
    )
    rng = np.random.default_rng(2)
    x, sigma = np.linspace(0.0, 1.0, 40), np.linspace(0.1, 2.0, 40)
    y = 3.0 * x + 1.0 + sigma * rng.standard_normal(40)
    data = cs.Record(name="m1", t=np.arange(40.0), channels={"x": x, "y": y, "s": sigma})
    fit = cs.solve(cs.Problem(model, [data], free=["*"], noise={"y": "s"}))
    rows = np.stack([x, np.ones(40)], axis=1) / sigma[:, None]
    np.testing.assert_allclose(list(fit.values.values()), np.linalg.lstsq(rows, y / sigma, rcond=None)[0], rtol=1e-8)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-8)


@pytest.mark.parametrize("method", EVERY_METHOD, ids=lambda m: type(m).__name__)
def test_time_is_a_symbol(method):
    """xdot = k t from 1: x = 1 + k t^2/2, whatever represents the motion."""
    model = cs.define_model(
        "ramp",
        states=["x"],
        inputs=["t"],
        parameters={"k": 1.0},
        outputs=["y"],
        dynamics=lambda s: {"x": s.k * s.t},
        output=lambda s: {"y": s.x},
        initial=lambda s: {"x": 1.0},
    )
    data = cs.Record(name="m1", t=T, channels={"y": 1.0 + 0.7 * T**2})
    assert cs.solve(cs.Problem(model, [data], free=["k"], noise={"y": 0.1}), method)["k"].value == pytest.approx(1.4)


def test_what_has_no_meaning_is_refused_at_construction(records):
    model, plain = decay(initial=lambda s: {"c": s.c0}), decay()
    with pytest.raises(InputError, match="leave one out"):
        cs.Problem(model, records, free=["k"], initial_state=cs.InitialState(value={"c": 1.0}))
    with pytest.raises(EstimationError, match="CombinedError"):
        cs.Problem(model, records, free=["k"], cost=cs.CombinedError())
    with pytest.raises(EstimationError, match="noise per sample"):
        cs.Problem(plain, records, free=["k"], cost=cs.CombinedError(), noise={"y": "s_y", "cdot": 1.0})
    with pytest.raises(InputError, match="did you mean 's_y'"):
        cs.Problem(plain, records, free=["k"], noise={"y": "sy"})
    with pytest.raises(EstimationError, match="start of 'k'"):
        cs.Problem(plain, records, free=["k"], log=["k"], start={"k": -1.0})
    with pytest.raises(EstimationError, match="logarithm"):
        tied = cs.limit_combination({"k[m1]": 1.0, "k[m2]": -1.0}, lower=0.0, upper=0.0)
        cs.Problem(model, records, free=["c0"], per_record=["k"], log=["k"], constraints=[tied])
    with pytest.raises(InputError, match="unknown record 'm3'"):
        cs.Problem(model, records, free=["k"], fixed={"c0[m3]": 1.0})
    with pytest.raises(InputError, match=r"not 'c0\[m2\]'.*cs.limit_combination"):
        cs.Problem(model, records, free=["k"], fixed={"c0[m1]": 1.0})
    with pytest.raises(InputError, match="expected 0"):
        cs.Problem(plain, records, free=["k"], initial_state=cs.InitialState(std={"c": -1.0}))
    with pytest.raises(InputError, match="unknown symbol 'c'"):
        decay(initial=lambda s: {"c": s.c})
    with pytest.raises(EstimationError, match="path constraint"):
        cs.Problem(model, records, free=["k"], constraints=[cs.limit_trajectory("c", lower=0.0)])
    bad = records[0].with_channels(s_y=np.zeros(len(T)))
    with pytest.raises(InputError, match="1-sigma of 'y'"):
        cs.Problem(plain, [bad], free=["k"], noise={"y": "s_y"})
