"""Profile likelihood, bootstrap and noisy inputs. Truth: ordinary least squares, refits with the parameter fixed, the
scatter of many estimates, and derivatives of the estimate by finite differences."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight, short_period
from scipy.stats import chi2, t

from casid.analysis import bootstrap, collected, drawn_problem, profile, replica
from casid.analysis.relinearise import AtFit, relinearise
from casid.analysis.together import Together
from casid.errors import EstimationError, InputError
from casid.estimation import (
    EquationError,
    Fit,
    GaussNewton,
    InitialState,
    MultipleShooting,
    Problem,
    RangeWeights,
    SingleShooting,
    limit_parameter,
    solve,
)
from casid.estimation.transcriptions.steps import output_function, step_function
from casid.filtering.cost import FilterError
from casid.model.system import define_model
from casid.records.record import Record
from problems.studies.input_noise import _Caused, _gains, _groups, input_noise_errors, with_noisy_inputs


def line_model(**options):
    return define_model(
        "line",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 0.0, "b": 0.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": s.a * s.delta_e + s.b},
        **options,
    )


def line_record(count: int = 60) -> Record:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(count)
    channels = {"delta_e": u, "q": 2.0 * u - 0.5 + 0.3 * rng.standard_normal(count)}
    return Record(name="m1", t=0.1 * np.arange(count), channels=channels)


def all_gains(at: AtFit) -> list[np.ndarray]:
    """(N, inputs, f) of each record."""
    found, last = [[] for _ in at.fit.problem.records], np.zeros(0)
    for group in _groups(at):
        gains, last = _gains(at, group, last)
        found[group.record].append(gains)
    return [np.concatenate(parts) for parts in found]


def noisy_flight(seed: int = 1, **options) -> Record:
    return flight(noise=NOISE, rng=np.random.default_rng(seed), **options)


def test_a_line_with_known_noise_has_the_normal_interval():
    fit = solve(Problem(line_model(), [line_record()], free=["*"], noise={"q": 0.3}))
    for level, quantile in ((0.95, 1.959964), (0.6827, 1.0)):
        for name, found in profile(fit, ["a", "b"], level=level).items():
            half = quantile * fit[name].std
            assert found.lower == pytest.approx(fit[name].value - half, abs=0.006 * half)
            assert found.upper == pytest.approx(fit[name].value + half, abs=0.006 * half)


def test_a_line_with_unknown_noise_has_the_interval_of_the_likelihood_ratio():
    """N ln(1 + d^2/(N s^2 (X'X)^-1)) = quantile: closed form for a line, wider than the normal interval."""
    record = line_record(12)
    fit = solve(Problem(line_model(), [record], free=["*"]))
    count, quantile = len(record), chi2.ppf(0.95, 1)
    most_likely = fit["a"].std * np.sqrt((count - 2) / count)
    half = most_likely * np.sqrt(count * (np.exp(quantile / count) - 1.0))
    found = profile(fit, ["a"])["a"]
    assert found.upper - fit["a"].value == pytest.approx(half, rel=0.004)
    assert fit["a"].value - found.lower == pytest.approx(half, rel=0.004)
    # Student's interval is the exact one: the ratio is on the way from the normal interval to it
    student = t.ppf(0.975, count - 2) * fit["a"].std
    assert 1.96 * most_likely < half < student


@pytest.mark.parametrize("noise", [NOISE, None], ids=["given", "estimated"])
def test_points_of_the_profile_are_refits_with_the_parameter_fixed(noise):
    problem = Problem(short_period(), [noisy_flight()], free=["*"], noise=noise)
    fit = solve(problem)
    found = profile(fit, ["Mq"])["Mq"]
    assert found.status == "found" and found.lower < fit["Mq"].value < found.upper
    for end in (found.lower, found.upper):
        fixed = solve(replace(problem, fixed={"Mq": end}, start={k: v for k, v in fit.values.items() if k != "Mq"}))
        # with estimated noise the log likelihood is at the noise of highest likelihood
        gain = fit.log_likelihood - fixed.log_likelihood if noise is None else fixed.cost - fit.cost
        deviance = 2.0 * gain
        assert deviance == pytest.approx(chi2.ppf(0.95, 1), rel=0.01)
    # the model is nearly linear over one standard error: near the normal interval, and not the same on both sides
    assert found.upper - found.lower == pytest.approx(2 * 1.96 * fit["Mq"].std_cramer_rao, rel=0.03)


def test_a_parameter_that_enters_as_its_exponential_has_the_exponential_of_the_interval():
    """Likelihood intervals do not depend on how a parameter is written; standard errors do."""
    model = define_model(
        "log",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 0.5, "b": 0.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": ca.exp(s.a) * s.delta_e + s.b},
    )
    record = line_record()
    plain_fit = solve(Problem(line_model(), [record], free=["*"], noise={"q": 6.0}))
    plain = profile(plain_fit, ["a"])["a"]
    nonlinear_fit = solve(Problem(model, [record], free=["*"], noise={"q": 6.0}))
    nonlinear = profile(nonlinear_fit, ["a"])["a"]
    both_ends = np.exp([nonlinear.lower, nonlinear.upper])  # each found to half a per cent of a standard error
    np.testing.assert_allclose(both_ends, [plain.lower, plain.upper], atol=0.01 * plain_fit["a"].std)
    assert nonlinear_fit["a"].value - nonlinear.lower > 1.3 * (nonlinear.upper - nonlinear_fit["a"].value)


def test_a_side_without_an_end_is_infinite_and_a_limit_cuts_it_off():
    """q = exp(a) u: towards a = -inf the prediction is zero, which data of large noise never reject."""
    model = define_model(
        "log",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 0.5},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": ca.exp(s.a) * s.delta_e},
    )
    problem = Problem(model, [line_record()], free=["*"], noise={"q": 12.0})
    found = profile(solve(problem), ["a"])["a"]
    assert found.lower == -np.inf and np.isfinite(found.upper) and "no lower end" in found.status
    limited = replace(problem, constraints=[limit_parameter("a", lower=-1.0)])
    found = profile(solve(limited), ["a"])["a"]
    assert found.lower == -1.0 and "limit" in found.status


def test_profiles_refuse_what_is_no_likelihood():
    record = noisy_flight()
    model = short_period()
    fit = solve(Problem(model, [record], free=["*"]))
    with pytest.raises(EstimationError, match="no likelihood"):
        profile(solve(Problem(model, [record], free=["*"], noise=RangeWeights())), ["Mq"])
    with pytest.raises(EstimationError, match="no likelihood"):
        profile(solve(Problem(model, [record], free=["*"], cost=EquationError())), ["Mq"])
    with pytest.raises(EstimationError, match="soft"):
        profile(fit, ["Mq"], method=MultipleShooting(process_noise={"q": 0.1}))
    with pytest.raises(InputError, match="Mq"):
        profile(fit, ["Mqq"])
    with pytest.raises(InputError, match="level"):
        profile(fit, ["Mq"], level=95.0)


def test_bootstrap_scatter_is_the_covariance_under_white_noise():
    """Sums of squared Mahalanobis distances of the draws from their centre: chi-square."""
    fit = solve(Problem(short_period(), [noisy_flight()], free=["*"], noise=NOISE))
    runs = 80
    drawn = bootstrap(fit, runs, seed=5)
    assert drawn.failed == 0 and drawn.estimates.shape == (runs, 5)
    error = drawn.estimates - np.array(list(fit.values.values()))
    squared = float(np.einsum("ri,ij,rj->", error, np.linalg.inv(fit.covariance), error))
    low, high = chi2.ppf([0.001, 0.999], error.size)
    assert low < squared < high
    ends = drawn.interval("Mq")
    assert ends[0] < fit["Mq"].value < ends[1]
    assert drawn.std("Mq") == pytest.approx(drawn.estimates[:, list(TRUTH).index("Mq")].std(ddof=1))


def gap(record: Record) -> Record:
    return record.with_channels(q=np.where(np.arange(len(record)) % 7 == 3, np.nan, record["q"]))


@pytest.mark.parametrize(
    "asked",
    [
        {"noise": NOISE},
        {},
        {"per_record": ["Zde"]},
        {"initial_state": InitialState(value={"alpha": 0.01, "q": -0.02}, std={"alpha": 0.0, "q": 0.01})},
    ],
)
def test_runs_that_are_solved_together_are_those_of_solve(asked):
    """The truth is each run by itself: two records of different length with missing samples, noise that is given or
    estimated, a parameter of each record, initial states that are known."""
    records = [gap(noisy_flight(seed, name=f"m{seed}")) for seed in (3, 4)]
    records[1] = records[1].between(0.0, 6.0)
    fit = solve(Problem(short_period(), records, free=["*"], **asked))
    assert fit.converged and Together.takes(fit, MultipleShooting())
    together = bootstrap(fit, 4, seed=5)
    alone = collected(fit, [replica(fit, (5, run)) for run in range(4)])
    std = np.sqrt(np.diag(fit.covariance))
    np.testing.assert_allclose(together.estimates / std, alone.estimates / std, atol=1e-4)


@pytest.mark.parametrize("prior", [False, True])
def test_logarithms_that_are_solved_together_are_those_of_solve(prior):
    """The truth is each run by itself."""
    line = line_model(prior_std={"a": 0.5})
    model = replace(line, nominal={"a": 1.5, "b": 0.0})
    fit = solve(Problem(model, [line_record()], free=["*"], log=["a"], prior=prior))
    assert fit.converged and Together.takes(fit, MultipleShooting())
    together = bootstrap(fit, 4, seed=5)
    alone = collected(fit, [replica(fit, (5, run)) for run in range(4)])
    np.testing.assert_allclose(together.estimates, alone.estimates, atol=1e-4 * fit["a"].std)


def test_bootstrap_with_noisy_inputs_scatters_as_the_adjoint_says():
    """Two ways to the same covariance, draws and first-order propagation: chi-square; the plain bound is too small."""
    fit = solve(Problem(short_period(), [noisy_flight(hold="held")], free=["*"], noise=NOISE))
    sigma, runs = {"delta_e": 0.003}, 80
    drawn = bootstrap(fit, runs, seed=6, input_noise=sigma)
    error = drawn.estimates - drawn.estimates.mean(axis=0)
    low, high = chi2.ppf([0.001, 0.999], error.size - error.shape[1])
    covariances = fit.covariance, input_noise_errors(fit, sigma).covariance
    plain, known = (float(np.einsum("ri,ij,rj->", error, np.linalg.inv(c), error)) for c in covariances)
    assert low < known < high < plain


def test_a_draw_keeps_missing_samples_and_depends_on_its_seed_alone():
    record = noisy_flight()
    q = record["q"].copy()
    q[20:60] = np.nan
    fit = solve(Problem(short_period(), [record.with_channels(q=q)], free=["*"]))
    drawn = drawn_problem(fit, np.random.default_rng(0), {"delta_e": 0.01}).records[0]
    np.testing.assert_array_equal(np.isnan(drawn["q"]), np.isnan(q))
    assert np.std(drawn["delta_e"] - record["delta_e"]) == pytest.approx(0.01, rel=0.2)
    assert replica(fit, 3) == replica(fit, 3) != replica(fit, 4)
    both = collected(fit, [replica(fit, 3), None, replica(fit, 4)])
    assert both.failed == 1 and len(both.estimates) == 2
    with pytest.raises(EstimationError, match="needs 39 runs, 2 converged"):
        both.interval("Mq")
    with pytest.raises(EstimationError, match="too few"):
        collected(fit, [None, None])
    with pytest.raises(InputError, match="delta_e"):
        replica(fit, 3, {"delta_f": 0.1})


@pytest.mark.parametrize("hold", ["linear", "held"])
@pytest.mark.parametrize("interval", [25, 7])
def test_the_estimate_follows_a_sample_of_the_input_as_the_adjoint_says(hold, interval):
    """Central differences over re-estimation. Without residuals Gauss-Newton's information is the exact curvature."""
    record, model = flight(hold=hold, t=np.arange(0.0, 6.0, 0.04)), short_period()
    problem = Problem(model, [record], free=["*"], noise=NOISE, start=TRUTH)
    fit = solve(problem)
    # the record comes from matrix exponentials: the fit leaves the integration error, of 1e-6, as its residual
    at = relinearise(fit, MultipleShooting(interval=interval))
    np.testing.assert_allclose(at.inverse, fit.covariance, rtol=1e-6)
    gains = all_gains(at)[0]
    for sample in (0, 30, 24, 25, 56, 140, len(record) - 1):
        change = []
        for shift in (1e-3, -1e-3):
            u = record["delta_e"].copy()
            u[sample] += shift
            moved = solve(
                replace(problem, records=[record.with_channels(delta_e=u)]), solver=GaussNewton(tolerance=1e-9)
            )
            change.append(np.array(list(moved.values.values())))
        slope = (change[0] - change[1]) / 2e-3
        size = np.sqrt(np.diagonal(fit.covariance)) * 10
        np.testing.assert_allclose(-at.inverse @ gains[sample, 0] / size, slope / size, atol=2e-3)


def whole_slopes(problem: Problem, fit: Fit, r: int) -> tuple[np.ndarray, np.ndarray]:
    """Single shooting of a record in one piece: (N, o, n+f) derivatives of its outputs in (initial state, parameters)
    and (N, o, N) in the samples of its one input, by CasADi through the whole chain of steps."""
    model, record = problem.model, problem.records[r]
    step, h, count, o = step_function(model), output_function(model), len(record), len(model.outputs)
    x0, p, u = ca.MX.sym("x", len(model.states)), ca.MX.sym("p", len(model.parameters)), ca.MX.sym("u", count)
    x, rows = x0, []
    for i in range(count):
        rows.append(h(x, u[i], p))
        end = u[min(i + 1, count - 1)] if record.hold == "linear" else u[i]
        x = step(x, u[i], end, np.append(np.diff(record.t), 0.0)[i], p)
    y = ca.vertcat(*rows)
    at = fit.states[record.name].trajectory[0], list(fit.values.values()), record["delta_e"]
    found = ca.Function("slopes", [x0, p, u], [ca.jacobian(y, ca.vertcat(x0, p)), ca.jacobian(y, u)])(*at)
    return tuple(e.full().reshape(count, o, -1) for e in found)  # pyright: ignore[reportReturnType]


@pytest.mark.parametrize("hold", ["linear", "held"])
def test_groups_of_segments_give_what_the_whole_matrices_give(hold, monkeypatch):
    """cov = I^-1 (I + sum_j G_j' S G_j) I^-1 with the matrices of whole records: X their sensitivities with the initial
    state re-estimated, I = X'X, G = X'E with E the derivatives of the outputs in every sample of the input."""
    t, sigma = np.arange(0.0, 3.6, 0.04), 0.004
    records = [noisy_flight(seed, name=f"m{seed}", hold=hold, t=t) for seed in (1, 2)]
    problem = Problem(short_period(), records, free=["*"], noise=NOISE)
    fit = solve(problem, solver=GaussNewton(tolerance=1e-10))
    monkeypatch.setattr("problems.studies.input_noise._GROUP_SAMPLES", 30)  # groups of four segments, the last shorter
    method = MultipleShooting(interval=7)
    at, weights = relinearise(fit, method), 1.0 / np.array(list(NOISE.values()))
    scale = problem.initial_knowledge[1][0]
    information, driven, gains = np.zeros((5, 5)), np.zeros((5, 5)), all_gains(at)
    for r in range(2):
        by_unknown, by_input = whole_slopes(problem, fit, r)
        rows, inputs = ((e * weights[:, None]).reshape(-1, e.shape[2]) for e in (by_unknown, by_input))
        both = rows.T @ rows + np.diag(np.r_[1.0 / scale**2, np.zeros(5)])
        follows = np.linalg.solve(both[:2, :2], both[:2, 2:])
        x = rows[:, 2:] - rows[:, :2] @ follows
        information += both[2:, 2:] - both[2:, :2] @ follows
        driven += sigma**2 * (x.T @ inputs) @ (x.T @ inputs).T
        np.testing.assert_allclose(gains[r][:, 0], (x.T @ inputs).T, atol=1e-9 * np.abs(gains[r]).max())
        if hold == "held" and r == 0:
            caused = _Caused(at, np.array([sigma]))
            for group in _groups(at):
                if group.record == 0:
                    caused.add(group)
            expected = sum(sigma**2 * by_input[i] @ by_input[i - 3].T for i in range(3, len(t))) / (2 * len(t))
            np.testing.assert_allclose(caused.mean[3], expected, rtol=1e-9)
    inverse = np.linalg.inv(information)
    expected = inverse @ (information + driven) @ inverse
    found = input_noise_errors(fit, {"delta_e": sigma}, method)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


def test_noisy_surfaces_are_in_the_covariance_and_in_the_filter():
    """Scatter of estimates over flights with a noisy elevator: the bound forgets it, both others have it."""
    sigma, runs, model = {"delta_e": 0.005}, 60, short_period()
    noisy_model = with_noisy_inputs(model, "delta_e")
    clean = flight(hold="held")
    estimates, plain, honest = [], [], []
    for run in range(runs):
        rng = np.random.default_rng([11, run])
        drawn = {n: clean[n] + s * rng.standard_normal(len(clean)) for n, s in (NOISE | sigma).items()}
        record = clean.with_channels(**drawn)
        fit = solve(Problem(model, [record], free=["*"]))
        errors = input_noise_errors(fit, sigma)
        estimates.append(list(fit.values.values()))
        plain.append(fit.covariance)
        honest.append(errors.covariance)
    error = np.array(estimates) - np.array(list(TRUTH.values()))
    low, high = chi2.ppf([0.001, 0.999], error.size)
    distance = [float(np.einsum("ri,rij,rj->", error, np.linalg.inv(c), error)) for c in (plain, honest)]
    assert low < distance[1] < high < distance[0]
    assert errors.share["Mde"] > 0.5 and errors.std["Mde"] ** 2 == pytest.approx(errors.covariance[4, 4])
    filtered = solve(Problem(noisy_model, [record], free=["*"], cost=FilterError(process_noise={"noise_delta_e": 0.0})))
    assert filtered.converged
    assert filtered.process_noise["noise_delta_e"][0] == pytest.approx(sigma["delta_e"], rel=0.35)
    np.testing.assert_allclose([e.std for e in filtered.parameters.values()], list(errors.std.values()), rtol=0.5)


def test_residuals_that_the_inputs_do_not_explain_stay_measurement_noise():
    """Coloured residuals and a surface of hardly any noise: the errors stay those corrected for their colour."""
    record, rng = flight(), np.random.default_rng(2)
    slow = {n: np.convolve(rng.standard_normal(len(record) + 19), np.ones(20) / 20**0.5, "valid") for n in NOISE}
    record = record.with_channels(**{n: record[n] + NOISE[n] * slow[n] for n in NOISE})
    fit = solve(Problem(short_period(), [record], free=["*"]))
    errors = input_noise_errors(fit, {"delta_e": 1e-7})
    np.testing.assert_allclose(errors.covariance, fit.covariance_corrected, rtol=1e-4)
    assert all(errors.std[name] > 1.5 * fit[name].std_cramer_rao for name in errors.std)


def test_correlated_measurement_noise_is_whitened_for_noisy_inputs_too():
    """A covariance without correlation is noise by channel; one with it changes what the inputs do, not by much."""
    record, sigma = noisy_flight(), {"delta_e": 0.003}
    matrix = np.diag(np.square(list(NOISE.values())))
    plain, given = (
        input_noise_errors(solve(Problem(short_period(), [record], free=["*"], noise=noise)), sigma)
        for noise in (NOISE, matrix)
    )
    np.testing.assert_allclose(given.covariance, plain.covariance, rtol=1e-8)
    estimated, full = (
        input_noise_errors(solve(Problem(short_period(), [record], free=["*"], noise=noise)), sigma)
        for noise in (None, "full")
    )
    np.testing.assert_allclose(list(full.std.values()), list(estimated.std.values()), rtol=0.1)


def test_without_input_noise_nothing_is_added():
    record = noisy_flight()
    fit = solve(Problem(short_period(), [record], free=["*"], noise=NOISE), SingleShooting())
    errors = input_noise_errors(fit, {})
    np.testing.assert_allclose(errors.covariance, fit.covariance, rtol=1e-6)
    assert set(errors.share.values()) == {0.0}
    twice = [input_noise_errors(fit, {"delta_e": s}).covariance - fit.covariance for s in (0.002, 0.004)]
    np.testing.assert_allclose(twice[1], 4.0 * twice[0], rtol=1e-4)
    with pytest.raises(InputError, match="delta_e"):
        input_noise_errors(fit, {"delta_f": 0.1})
    with pytest.raises(InputError, match="1-sigma"):
        input_noise_errors(fit, {"delta_e": -0.1})
    with pytest.raises(EstimationError, match="EquationError"):
        input_noise_errors(solve(Problem(short_period(), [record], free=["*"], cost=EquationError())), {})
