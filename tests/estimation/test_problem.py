"""A problem says at once what is wrong with it; a fit is addressed by name and goes into JSON."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import NOISE, START, TRUTH, flight, short_period
from hypothesis import given, settings
from hypothesis import strategies as st

import casid as cs
from casid.errors import EstimationError, InputError
from casid.estimation import (
    Collocation,
    EquationError,
    GaussNewton,
    InitialState,
    Ipopt,
    MultipleShooting,
    Problem,
    SingleShooting,
    solve,
)


def problem(**options) -> Problem:
    return Problem(short_period(), [flight()], **({"free": ["*"], "noise": NOISE} | options))


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"free": ["Zz"]}, InputError, "unknown parameter 'Zz'"),
        ({"free": ["Q*"]}, InputError, "unknown parameter"),
        ({"free": "Z*"}, InputError, "expected a list"),
        ({"free": [], "cost": EquationError()}, EstimationError, "no parameter is free"),
        ({"fixed": {"mq": 1.0}}, InputError, "did you mean 'Mq'"),
        ({"start": {"mq": 1.0}}, InputError, "did you mean 'Mq'"),
        ({"initial_state": InitialState(std={"alpha": -1.0})}, InputError, "expected 0"),
        ({"initial_state": InitialState(value={"alfa": 0.0})}, InputError, "did you mean 'alpha'"),
    ],
)
def test_a_wrong_choice_is_named(options, error, words):
    with pytest.raises(error, match=words):
        problem(**options)


def test_records_are_checked():
    model, record = short_period(), flight()
    gap = record["delta_e"].copy()
    gap[50] = np.nan
    with pytest.raises(InputError, match="input 'delta_e' has no value at t = 2 s"):
        Problem(model, [record.with_channels(delta_e=gap)], free=["*"])
    with pytest.raises(InputError, match="not unique"):
        Problem(model, [record, record], free=["*"])
    with pytest.raises(InputError, match="no record"):
        Problem(model, [], free=["*"])
    with pytest.raises(InputError, match="strictly increase"):
        Problem(model, [replace(record, t=record.t[::-1])], free=["*"])
    with pytest.raises(EstimationError, match="no record has a sample of any output"):
        Problem(model, [record.without("alpha", "q")], free=["*"])
    with pytest.raises(InputError, match="unknown channel 'delta_e'"):
        Problem(model, [record.without("delta_e")], free=["*"])


def test_noise_must_name_every_output():
    for noise, words in (
        ({"alpha": 1.0}, "no 1-sigma of 'q'"),
        (NOISE | {"r": 1.0}, "unknown channel"),
        ({"alpha": 1.0, "q": 0.0}, "expected a positive"),
    ):
        with pytest.raises(InputError, match=words):
            solve(problem(noise=noise))


def test_fixed_wins_over_globs_and_everything_else_is_nominal():
    chosen = problem(free=["M*"], fixed={"Mq": -2.5}, start={"Ma": -1.0})
    assert chosen.parameters == ("Ma", "Mde")
    np.testing.assert_array_equal(chosen.start_vector, [-1.0, TRUTH["Mde"]])
    np.testing.assert_array_equal(chosen.model_parameters(np.array([-3.0, -4.0])), [[-1.2, -0.15, -3.0, -2.5, -4.0]])


def test_a_fit_is_addressed_by_name():
    record = flight(noise=NOISE, rng=np.random.default_rng(0))
    fit = solve(Problem(short_period(), [record], free=["*"], start=START, noise=NOISE))
    assert fit.converged and fit["Mq"].std > 0
    assert fit.correlation("Ma", "Ma") == pytest.approx(1.0)
    i, j = list(fit.values).index("Ma"), list(fit.values).index("Mq")
    both = fit["Ma"].std_cramer_rao * fit["Mq"].std_cramer_rao
    assert fit.correlation("Ma", "Mq") == pytest.approx(fit.covariance[i, j] / both)
    with pytest.raises(InputError, match="did you mean 'Mq'"):
        fit["mq"]
    z, y = record["q"], fit.predictions["m1"][:, 1]
    rms = np.sqrt(np.mean((z - y) ** 2))
    assert fit.channels["q"].rms == pytest.approx(rms)
    assert abs(fit.channels["q"].R2 - (1 - rms**2 / z.var())) < 1e-12
    theil = rms / (np.sqrt(np.mean(z**2)) + np.sqrt(np.mean(y**2)))
    assert fit.channels["q"].theil == pytest.approx(theil)
    white = fit.residuals["m1"] / list(NOISE.values())
    expected = -0.5 * (white**2).sum() - len(record) * np.log(np.prod(list(NOISE.values())) * 2 * math.pi)
    assert fit.log_likelihood == pytest.approx(expected)
    for text in ("converged", "Mde", "Theil"):
        assert text in str(fit)


def test_a_fit_goes_into_json_without_numbers_that_json_does_not_have():
    fit = solve(problem())
    again = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
    assert again["schema"] == "casid.estimate/2" and again["converged"] is True
    assert again["parameters"]["Mq"]["value"] == fit["Mq"].value
    assert again["parameters"]["Mq"]["prior_std"] is None  # there is none
    assert again["correlation"]["names"] == list(fit.values) and len(again["correlation"]["matrix"]) == 5
    assert set(again["channels"]["q"]) == {"rms", "R2", "theil", "samples"}


@pytest.mark.parametrize("solver", ["gauss-newton", "ipopt"])
def test_a_simulation_that_departs_is_said_and_harms_nobody(solver):
    wild = problem(start={"Mq": 1e4, "Za": 1e4})
    fit = solve(wild, SingleShooting(), Ipopt() if solver == "ipopt" else GaussNewton())
    assert not fit.converged and fit.status.startswith("departed") and "MultipleShooting" in fit.status
    assert np.isnan(fit["Mq"].std)
    json.dumps(fit.to_dict(), allow_nan=False)


def test_an_iteration_that_is_cut_short_does_not_claim_convergence():
    for solver in (GaussNewton(iterations=1), Ipopt(iterations=1)):
        fit = solve(problem(start=START), MultipleShooting(), solver)
        assert not fit.converged and "not converged" in fit.status


def test_transcriptions_refuse_what_makes_no_sense():
    with pytest.raises(InputError, match="at least 1"):
        MultipleShooting(interval=0)
    with pytest.raises(InputError, match="expected 1 to 9"):
        Collocation(degree=10)
    with pytest.raises(InputError, match="did you mean 'exact'"):
        Ipopt(hessian="exakt")


def test_the_initial_state_is_free_with_a_prior():
    """A prior that is sharp holds the start; the default one lets the data speak."""
    off = InitialState(value={"alpha": 0.5, "q": 0.0}, std={"alpha": 1e-9, "q": 1e-9})
    held = solve(problem(initial_state=off))
    assert held.states["m1"].nodes[0] == pytest.approx([0.5, 0.0], abs=1e-5)
    loose = solve(problem(initial_state=InitialState(value={"alpha": 0.5, "q": 0.0})))
    assert loose.states["m1"].nodes[0] == pytest.approx([0.01, -0.02], abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(0.05, 5.0), st.integers(0, 99))
def test_a_given_prior_is_that_of_bayes_for_a_line(mean, std, seed):
    """Truth: the posterior of a linear model with normal noise, in closed form. The model's own prior has no part."""
    rng = np.random.default_rng(seed)
    h = rng.standard_normal((15, 2))
    y = h @ [1.0, -2.0] + 0.5 * rng.standard_normal(15)
    model = cs.define_regression(
        "line",
        inputs=["h0", "h1"],
        parameters={"a": 7.0, "b": 1.0},
        outputs=["y"],
        output=lambda s: {"y": s.a * s.h0 + s.b * s.h1},
        prior_std={"b": 1e-3},
    )
    record = cs.Record(name="r", t=np.arange(15.0), channels={"h0": h[:, 0], "h1": h[:, 1], "y": y})
    fit = cs.solve(cs.Problem(model, [record], free=["*"], noise={"y": 0.5}, prior={"a": (mean, std)}))
    information = h.T @ h / 0.25 + np.diag([1.0 / std**2, 0.0])
    best = np.linalg.solve(information, h.T @ y / 0.25 + [mean / std**2, 0.0])
    assert list(fit.values.values()) == pytest.approx(best, rel=1e-6, abs=1e-6)
    errors = np.sqrt(np.diagonal(np.linalg.inv(information)))
    assert [e.std_cramer_rao for e in fit.parameters.values()] == pytest.approx(errors, rel=1e-6)
    assert fit["a"].prior == mean and fit["a"].prior_std == std and not np.isfinite(fit["b"].prior_std)


@pytest.mark.parametrize(
    "prior", [{"k": (1.0, 1.0)}, {"T": 1.0}, {"T": (1.0,)}, {"T": (1.0, 0.0)}, {"T": ("1", 1.0)}, "T", 1]
)
def test_a_prior_that_is_none_is_told(prior):
    model = cs.define_regression(
        "line", inputs=["u"], parameters={"T": 1.0, "k": 1.0}, outputs=["y"], output=lambda s: {"y": s.T * s.u + s.k}
    )
    record = cs.Record(name="r", t=np.arange(4.0), channels={"u": np.arange(4.0), "y": np.arange(4.0)})
    with pytest.raises(cs.InputError, match="prior"):
        cs.Problem(model, [record], free=["T"], prior=prior)
