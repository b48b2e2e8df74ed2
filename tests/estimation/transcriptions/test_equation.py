"""Truth: equation error that is linear in the parameters is the closed-form weighted least squares."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, START, TRUTH, exact, flight, matrices, short_period, with_derivatives

from casid.errors import EstimationError, InputError
from casid.estimation import (
    Collocation,
    CombinedError,
    EquationError,
    InitialState,
    Ipopt,
    MultipleShooting,
    OutputError,
    Problem,
    RangeWeights,
    SingleShooting,
    solve,
)
from casid.estimation.transcriptions.equation import smoothed_derivative
from casid.model.system import EquationForm as EquationForm
from casid.model.system import define_model
from casid.records.record import Record

WEIGHTS = {"alphadot": 0.02, "qdot": 0.1}


def measured_derivatives(seed: int = 0) -> Record:
    """A record that has noisy measured alphadot and qdot, so that nothing is differentiated."""
    rng = np.random.default_rng(seed)
    return with_derivatives(flight(noise=NOISE, rng=rng), flight(), WEIGHTS, rng)


def closed_form(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Za, Zde, Ma, Mq, Mde and their covariance, two ordinary regressions."""
    alpha, q, de = (record[n] for n in ("alpha", "q", "delta_e"))
    values, covariance = np.zeros(5), np.zeros((5, 5))
    for where, regressors, target, sigma in (
        (slice(0, 2), [alpha, de], record["alphadot"] - q, 0.02),
        (slice(2, 5), [alpha, q, de], record["qdot"], 0.1),
    ):
        phi = np.stack(regressors, axis=1)
        values[where] = np.linalg.solve(phi.T @ phi, phi.T @ target)
        covariance[where, where] = sigma**2 * np.linalg.inv(phi.T @ phi)
    return values, covariance


@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(), Collocation()])
def test_state_equations_are_regressed_on_measured_states(method):
    record = measured_derivatives()
    given = Problem(short_period(), [record], free=["*"], start=START, cost=EquationError(), noise=WEIGHTS)
    fit = solve(given, method)
    expected, covariance = closed_form(record)
    assert fit.converged and fit.iterations <= 3 and not fit.states
    np.testing.assert_allclose(list(fit.values.values()), expected, rtol=1e-10)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-9, atol=1e-15)


def test_weights_do_not_matter_where_equations_share_no_parameter():
    record = measured_derivatives()
    for noise in (None, RangeWeights()):
        fit = solve(Problem(short_period(), [record], free=["*"], cost=EquationError(), noise=noise))
        np.testing.assert_allclose(list(fit.values.values()), closed_form(record)[0], rtol=1e-9)


def test_missing_signals_drop_their_rows_only():
    record = measured_derivatives()
    holed = record["q"].copy()
    holed[10:60] = np.nan
    keep = np.isfinite(holed)
    fit = solve(
        Problem(short_period(), [record.with_channels(q=holed)], free=["*"], cost=EquationError(), noise=WEIGHTS)
    )
    short = Record(name="s", t=record.t[keep], channels={n: v[keep] for n, v in record.channels.items()})
    np.testing.assert_allclose(list(fit.values.values()), closed_form(short)[0], rtol=1e-10)
    assert fit.channels["qdot"].samples == keep.sum()


def test_a_model_with_its_own_equations_is_regressed_on_those():
    """Given form: qdot measured against Ma alpha + Mq q + Mde delta_e, nothing else."""

    def form(s) -> EquationForm:
        m = ca.SX.sym("m", 4)
        return EquationForm(
            names=("Cm",),
            channels=("alpha", "q", "delta_e", "qdot"),
            m=m,
            target=m[3],
            prediction=s.Ma * m[0] + s.Mq * m[1] + s.Mde * m[2],
        )

    record = measured_derivatives()
    model = short_period(equation=form)
    fit = solve(Problem(model, [record], free=["M*"], cost=EquationError(), noise={"Cm": 0.1}))
    np.testing.assert_allclose(list(fit.values.values()), closed_form(record)[0][2:], rtol=1e-10)
    assert list(fit.channels) == ["Cm"]
    with pytest.raises(EstimationError, match="Za, Zde stand in no equation"):
        solve(Problem(model, [record], free=["*"], cost=EquationError()))
    combined = solve(Problem(model, [record], free=["*"], cost=CombinedError()))
    assert combined.converged and list(combined.channels) == ["alpha", "q", "Cm"]


def test_an_equation_that_is_not_linear_is_iterated_to_the_least_squares():
    model = define_model(
        "decay",
        states=("V",),
        inputs=("thrust",),
        parameters={"rate": 0.5, "gain": 1.0},
        outputs=("V",),
        dynamics=lambda s: {"V": -ca.exp(s.rate) * s.V + s.gain * s.rate * s.thrust},
        output=lambda s: {"V": s.V},
    )
    rng = np.random.default_rng(1)
    v, u = rng.standard_normal(60), rng.standard_normal(60)
    vdot = -np.exp(0.3) * v + 2.0 * 0.3 * u + 0.01 * rng.standard_normal(60)
    record = Record(name="m1", t=np.arange(60.0), channels={"V": v, "thrust": u, "Vdot": vdot})
    fit = solve(Problem(model, [record], free=["*"], cost=EquationError(), noise={"Vdot": 0.01}))
    a, b = np.linalg.lstsq(np.stack([-v, u], axis=1), vdot, rcond=None)[0]  # exp(rate), gain * rate
    assert fit.converged
    assert fit["rate"].value == pytest.approx(np.log(a), rel=1e-8)
    assert fit["gain"].value == pytest.approx(b / np.log(a), rel=1e-8)


def test_derivatives_that_are_not_measured_are_computed():
    t = np.arange(0.0, 10.0, 0.02)
    inside = slice(12, -12)  # half a window from the ends
    np.testing.assert_allclose(smoothed_derivative(t, np.sin(2 * t))[inside], 2 * np.cos(2 * t)[inside], atol=1e-3)
    cubic = 1 + t - 0.3 * t**2 + 0.02 * t**3  # the local polynomials are cubic: exact
    np.testing.assert_allclose(smoothed_derivative(t, cubic), 1 - 0.6 * t + 0.06 * t**2, atol=1e-9)
    u = np.sin(3 * t)
    x = exact(*matrices(TRUTH), t, u[:, None], np.zeros(2), "linear")
    record = Record(name="m1", t=t, channels={"delta_e": u, "alpha": x[:, 0], "q": x[:, 1]})
    fit = solve(Problem(short_period(), [record], free=["*"], start=START, cost=EquationError()))
    for name, truth in TRUTH.items():
        assert fit[name].value == pytest.approx(truth, rel=0.03)


def test_equation_error_is_a_start_from_which_output_error_converges():
    record = flight(noise=NOISE, rng=np.random.default_rng(4), t=np.arange(0.0, 8.0, 0.02))
    far = {name: 0.0 for name in TRUTH}
    first = solve(Problem(short_period(), [record], free=["*"], start=far, cost=EquationError()))
    second = solve(Problem(short_period(), [record], free=["*"], start=first.values, noise=NOISE))
    assert second.converged
    for name, truth in TRUTH.items():
        assert abs(second[name].value - truth) < 4 * second[name].std


def test_combined_weight_runs_from_output_to_equation_error():
    """With nearly all weight on one part, the estimate is that part's; in between it minimises the weighted sum."""
    record = measured_derivatives()

    def estimate(cost, noise) -> np.ndarray:
        fit = solve(Problem(short_period(), [record], free=["*"], cost=cost, noise=noise))
        assert fit.converged
        return np.array(list(fit.values.values()))

    both = NOISE | WEIGHTS
    output, equation = estimate(OutputError(), NOISE), estimate(EquationError(), WEIGHTS)
    np.testing.assert_allclose(estimate(CombinedError(equation_weight=1e-7), both), output, rtol=1e-5)
    np.testing.assert_allclose(estimate(CombinedError(equation_weight=1 - 1e-9), both), equation, rtol=1e-4)
    known = InitialState(std={"alpha": 0.05, "q": 0.1})
    half = solve(Problem(short_period(), [record], free=["*"], cost=CombinedError(), noise=both, initial_state=known))
    residuals = half.residuals["m1"] / list(both.values())
    start = (half.states["m1"].nodes[0] - record.matrix(["alpha", "q"])[0]) / [0.05, 0.1]
    assert half.cost == pytest.approx(0.5 * (0.5 * (residuals**2).sum() + (start**2).sum()), rel=1e-12)


def test_what_cannot_be_formed_is_said():
    record = measured_derivatives().without("alpha")
    with pytest.raises(EstimationError, match="needs the channel 'alpha'"):
        solve(Problem(short_period(), [record], free=["*"], cost=EquationError()))
    with pytest.raises(InputError, match="did you mean 'qdot'"):
        solve(
            Problem(
                short_period(), [measured_derivatives()], free=["*"], cost=EquationError(), noise=WEIGHTS | {"qdt": 1.0}
            )
        )
    with pytest.raises(InputError, match="no 1-sigma of 'alphadot'"):
        solve(Problem(short_period(), [measured_derivatives()], free=["*"], cost=CombinedError(), noise=NOISE))
    with pytest.raises(EstimationError, match="inside"):
        CombinedError(equation_weight=1.0)


def test_ipopt_regresses_too():
    record = measured_derivatives()
    given = Problem(short_period(), [record], free=["*"], start=START, cost=EquationError(), noise=WEIGHTS)
    np.testing.assert_allclose(list(solve(given, solver=Ipopt()).values.values()), closed_form(record)[0], rtol=1e-8)
