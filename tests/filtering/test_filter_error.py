"""Truth: simulated flights with known process noise, differences of the likelihood, output error as the limit, and the
published lift slope of the HFB-320."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight

import casid as cs
from casid.errors import EstimationError, InputError
from casid.estimation import (
    Collocation,
    Fit,
    Ipopt,
    MultipleShooting,
    Noise,
    Problem,
    SingleShooting,
    limit_parameter,
    limit_trajectory,
    solve,
)
from casid.estimation.solvers.own import OwnObjective
from casid.estimation.solvers.point import NoiseState, ObjectiveValue, Point
from casid.filtering.cost import FilterError
from casid.filtering.likelihood import FilterLikelihood
from casid.filtering.noise_score import unit_variances, variance_score
from casid.model.simulate import simulate
from casid.model.system import Model, define_model
from casid.records.record import Record
from problems.real import hfb320

DT, SAMPLES = 0.04, 600
WHITE = {"w_alpha": 0.05, "w_q": 0.3}
GUST, TIME = 0.01, 0.8


def gusty(nominal=TRUTH):
    """Short period with white disturbances of both equations and a gust angle that the vane sees too."""
    return define_model(
        "gusty",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters=nominal,
        outputs=("alpha", "q"),
        disturbances=("w_alpha", "w_q", "gust"),
        dynamics=lambda s: {
            "alpha": s.Za * (s.alpha + s.gust) + s.q + s.Zde * s.delta_e + s.w_alpha,
            "q": s.Ma * (s.alpha + s.gust) + s.Mq * s.q + s.Mde * s.delta_e + s.w_q,
        },
        output=lambda s: {"alpha": s.alpha + s.gust, "q": s.q},
    )


def flown(seed: int, white: dict[str, float], gust: float = 0.0, samples: int = SAMPLES, name: str = "m1") -> Record:
    """A flight with repeated elevator inputs, disturbances held per sample, and measurement noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(samples)
    record = flight(name, t=t, hold="held")
    repeated = np.interp(t % 8.0, record.t, record["delta_e"])
    series = {n: s * rng.standard_normal(samples) for n, s in white.items()}
    phi, draw = np.exp(-DT / TIME), rng.standard_normal(samples)
    history = np.zeros(samples)
    history[0] = gust * draw[0]
    for k in range(samples - 1):
        history[k + 1] = phi * history[k] + gust * np.sqrt(1.0 - phi**2) * draw[k + 1]
    clean = simulate(
        gusty(),
        record.with_channels(delta_e=repeated),
        np.zeros(2),
        disturbances={**series, "gust": history},
        substeps=2,
    )
    noisy = {n: clean.output(n) + NOISE[n] * rng.standard_normal(samples) for n in ("alpha", "q")}
    return clean.as_record().with_channels(**noisy)


def far(problem_nominal: float = 0.7) -> dict[str, float]:
    return {name: problem_nominal * value for name, value in TRUTH.items()}


def filtered(problem: Problem, process_noise: dict[str, float]) -> Fit:
    """The fit of a problem by filter error."""
    return solve(replace(problem, cost=FilterError(process_noise=process_noise)))


def one_step(problem: Problem, values: Mapping[str, float], noise: Mapping[str, float], white: Mapping[str, float]):
    """The prediction of a problem's records from sample to sample, everything given."""
    cost = FilterError(process_noise=dict.fromkeys(white, 0.0), sigma=white)
    return solve(Problem(problem.model, problem.records, fixed=values, noise=noise, cost=cost))


def squared_distance(fit) -> float:
    """Chi-square of the estimates against the truth."""
    error = np.array([fit.values[n] - TRUTH[n] for n in TRUTH])
    return float(error @ np.linalg.solve(fit.covariance, error))


def test_parameters_and_all_noises_are_recovered():
    """White process noise; estimates within the 0.999 chi-square bound, noises within four standard errors."""
    problem = Problem(gusty(far()), [flown(1, WHITE), flown(2, WHITE, name="m2")], free=["*"])
    fit = filtered(problem, {"w_alpha": 0.0, "w_q": 0.0})
    assert fit.converged, fit.status
    assert squared_distance(fit) < 20.5
    for name, sigma in WHITE.items():
        assert fit.process_noise[name][0] == pytest.approx(sigma, rel=0.15), name
    for name, sigma in NOISE.items():
        assert fit.noise[name] == pytest.approx(sigma, rel=0.15), name
    white = np.concatenate(list(fit.innovations.values()))
    for i in range(2):
        e = white[:, i]
        assert abs(float(e[1:] @ e[:-1] / (e @ e))) < 4.0 / np.sqrt(len(e))
    # output error on the same records is far outside its own bound
    plain = solve(problem, MultipleShooting())
    error = np.array([plain[n].value - TRUTH[n] for n in TRUTH])
    assert float(error @ np.linalg.solve(plain.covariance, error)) > 50.0


@pytest.mark.parametrize("factor", (0.1, 0.3, 1.0, 10.0))
def test_states_without_a_channel_and_parameters_from_far_away(factor: float):
    """Truth: the parameters of the simulation, and one optimum from all starts. An oscillator whose states are no
    channels, driven by white noise; the likelihood of the far starts is lower by tens."""
    truth = {"stiffness": 9.0, "damping": 0.4, "gain": 1.0}
    model = define_model(
        "oscillator",
        states=["x", "v"],
        inputs=["u"],
        parameters=truth,
        outputs=["y"],
        disturbances=["w_v"],
        dynamics=lambda s: {"x": s.v, "v": s.gain * s.u - s.stiffness * s.x - s.damping * s.v + s.w_v},
        output=lambda s: {"y": s.x},
    )
    t, rng = 0.05 * np.arange(400), np.random.default_rng(1)
    square = Record(name="square", t=t, channels={"u": np.sign(np.sin(t))})
    clean = simulate(model, square, [0.0, 0.0], truth, {"w_v": rng.standard_normal(len(t))}).as_record("m1")
    record = clean.with_channels(y=clean["y"] + 0.02 * rng.standard_normal(len(t)))

    start = {name: factor * value for name, value in truth.items()}
    problem = Problem(model=model, records=[record], free=["*"], start=start)
    found = filtered(problem, {"w_v": 0.0})

    assert found.status == "converged"
    for name, value in truth.items():
        assert abs(found.values[name] - value) < 3.0 * found[name].std_cramer_rao
    begun = one_step(problem, start, found.noise, {"w_v": found.process_noise["w_v"][0]})
    assert begun.log_likelihood < found.log_likelihood - (20.0 if factor != 1.0 else 0.0)


def lagging(moved: float = 1.0) -> tuple[Model, Record]:
    """A lag of 0.4 s behind a square wave times `moved`, with white process noise."""
    lag = define_model(
        "lag",
        states=["x"],
        inputs=["u"],
        parameters={"T": 0.5, "gain": 1.0},
        outputs=["y"],
        disturbances=["w_x"],
        dynamics=lambda s: {"x": (s.gain * s.u - s.x) / s.T + s.w_x},
        output=lambda s: {"y": s.x},
    )
    t, rng = 0.05 * np.arange(200), np.random.default_rng(1)
    square = Record(name="square", t=t, channels={"u": moved * np.sign(np.sin(t))})
    driven = {"w_x": 0.5 * rng.standard_normal(len(t))}
    clean = simulate(lag, square, [0.0], {"T": 0.4}, driven).as_record("m1")
    return lag, clean.with_channels(y=clean["y"] + 0.02 * rng.standard_normal(len(t)))


@pytest.mark.parametrize("factor", (-0.25, -1.0, -10.0))
def test_a_lag_of_the_wrong_sign_comes_to_the_solution_from_near(factor: float):
    """Its time constant runs off to minus infinity, where the lag is none. The truth is the fit from 0.4 s."""
    model, record = lagging()
    near, far = (
        filtered(Problem(model, [record], free=["T"], start={"T": 0.4 * f}), {"w_x": 0.0}) for f in (1.0, factor)
    )
    assert near.converged and far.converged
    assert far.values["T"] == pytest.approx(near.values["T"], abs=0.01 * near["T"].std_cramer_rao)
    assert far["T"].std_cramer_rao == pytest.approx(near["T"].std_cramer_rao, rel=1e-3)


def test_what_the_data_say_nothing_of_is_no_estimate():
    """The gain of an input that stands still."""
    model, record = lagging(moved=0.0)
    fit = filtered(Problem(model, [record], free=["T", "gain"]), {"w_x": 0.0})
    assert fit.status.startswith("not identifiable") and "gain" in fit.status
    assert np.isnan(fit["gain"].std_cramer_rao)


def test_a_gust_is_told_from_noise_of_the_vane():
    """A Gauss-Markov gust that the vane sees: its r.m.s. and the vane's own noise."""
    problem = Problem(gusty(far()), [flown(s, {}, GUST, name=f"m{s}") for s in (3, 4)], free=["*"])
    fit = filtered(problem, {"gust": TIME})
    assert fit.converged, fit.status
    sigma, tau = fit.process_noise["gust"]
    assert tau == TIME and sigma == pytest.approx(GUST, rel=0.25)
    assert fit.noise["alpha"] == pytest.approx(NOISE["alpha"], rel=0.2)
    assert squared_distance(fit) < 20.5


def test_without_process_noise_it_is_output_error():
    record = flown(5, {})
    problem = Problem(gusty(far()), [record], free=["*"])
    ours, theirs = filtered(problem, {}), solve(problem, MultipleShooting())
    assert ours.converged
    for name in TRUTH:
        # the priors of the initial state differ: five scales here, one there
        assert abs(ours.values[name] - theirs[name].value) < 0.02 * theirs[name].std_cramer_rao
        assert ours[name].std_cramer_rao == pytest.approx(theirs[name].std_cramer_rao, rel=0.01)
    for name in NOISE:
        assert ours.noise[name] == pytest.approx(theirs.noise[name], rel=5e-3)


def test_given_noise_is_kept():
    problem = Problem(gusty(far()), [flown(6, WHITE)], free=["*"], noise=NOISE)
    fit = filtered(problem, {"w_alpha": 0.0, "w_q": 0.0})
    assert dict(fit.noise) == NOISE and fit.converged
    intensities = {name: sigma * np.sqrt(DT) for name, (sigma, _) in fit.process_noise.items()}
    again = solve(problem, MultipleShooting(interval=1, process_noise=intensities))
    # soft defects with this noise give the same, but for the slope of the determinant: within a standard error
    for name in TRUTH:
        assert abs(again[name].value - fit.values[name]) < 1.0 * again[name].std
        assert again[name].std == pytest.approx(fit[name].std_cramer_rao, rel=0.1)


def at_truth(records, gust: bool = False) -> tuple[OwnObjective, Point, ObjectiveValue]:
    """The likelihood at the true parameters and noise, about the readings."""
    times = dict.fromkeys(WHITE, 0.0) | ({"gust": TIME} if gust else {})
    problem = Problem(gusty(), records, free=["*"], cost=FilterError(process_noise=times))
    objective = OwnObjective(problem)
    process = np.log([*WHITE.values(), *([GUST] if gust else [])])
    levels = replace(objective.noise.levels, sigma=np.array(list(NOISE.values())))
    point = replace(objective.start(), theta=np.array(list(TRUTH.values())))
    return objective, point, objective.value(point, NoiseState(levels=levels, process=process))


def test_score_of_the_variances_is_the_slope_of_the_likelihood():
    """Central differences of -2 ln L in every variance, white and coloured, two records, a gap."""
    record = flown(7, WHITE, GUST, samples=150)
    hidden = record["q"].copy()
    hidden[40:60] = np.nan
    records = [record.with_channels(q=hidden), flown(8, WHITE, GUST, samples=150, name="m2")]
    objective, point, value = at_truth(records, gust=True)
    likelihood = objective.own
    assert isinstance(likelihood, FilterLikelihood)
    log_sigma = np.log([*NOISE.values(), *WHITE.values(), GUST])

    def deviance(trial: np.ndarray) -> float:
        levels = replace(value.noise.levels, sigma=np.exp(trial[:2]))
        return 2.0 * objective.misfit(objective.value(point, NoiseState(levels=levels, process=trial[2:])))

    here = value.own.kept
    units = unit_variances(here.linear, likelihood.noise_model(value.noise), measurement=True)
    white = -value.own.residual.reshape(here.linear.residual.shape)
    slope = variance_score(here.filter, white, units) * 2.0 * np.exp(2.0 * log_sigma)
    for i, name in enumerate((*NOISE, *WHITE, "gust")):
        step = 1e-4 * np.eye(len(log_sigma))[i]
        expected = (deviance(log_sigma + step) - deviance(log_sigma - step)) / 2e-4
        assert slope[i] == pytest.approx(expected, rel=1e-5, abs=1e-5), name


def test_the_gradient_is_the_difference_quotient_of_the_likelihood():
    """Sensitivities of the innovations and the slope through their covariance, against central differences; the system
    is linear, so that the likelihood does not depend on the motion it is linearised about."""
    objective, point, value = at_truth([flown(9, WHITE, samples=200)])
    linear = objective.linearise(point, objective.bent(value))
    std = np.sqrt(np.diag(np.linalg.inv(linear.hessian)))
    for i in range(len(std)):
        shift = 0.02 * std[i] * np.eye(len(std))[i]
        sides = [
            objective.misfit(objective.value(replace(point, theta=point.theta + s * shift), value.noise))
            for s in (1, -1)
        ]
        assert linear.gradient[i] * std[i] == pytest.approx((sides[0] - sides[1]) / 0.04, rel=1e-2, abs=1e-2)


def test_the_motion_that_follows_a_step_is_the_most_likely_one_there():
    """Truth: the smoothed motion at the parameters after the step. Both are the same for a system that is linear in
    states and parameters together, as a lag with a known time constant is in its gain."""
    model, record = lagging()
    cost = FilterError(process_noise={"w_x": 0.0})
    objective = OwnObjective(Problem(model, [record], free=["gain"], fixed={"T": 0.4}, cost=cost))
    point = objective.start()
    value = objective.value(point)
    still = objective.step(point, value, objective.linearise(point, value), 0.0)
    for change in (0.0, 0.3):
        step = objective.with_motion(value, replace(still, theta=np.array([change])))
        there = replace(point, theta=point.theta + step.theta)
        smoothed = objective.told(objective.value(there)).states["m1"].trajectory
        assert point.nodes + step.nodes == pytest.approx(smoothed, abs=1e-9), change
    assert np.ptp(smoothed - point.nodes) > 0.01


def test_per_record_parameters_have_their_own_value():
    """A bias of 0.05 rad/s in one record and none in the other."""
    model = define_model(
        "biased",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters={**TRUTH, "bias_q": 0.0},
        outputs=("alpha", "q"),
        disturbances=("w_q",),
        dynamics=lambda s: {
            "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
            "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e + s.w_q,
        },
        output=lambda s: {"alpha": s.alpha, "q": s.q + s.bias_q},
    )
    one, other = flown(10, {"w_q": 0.1}), flown(11, {"w_q": 0.1}, name="m2")
    problem = Problem(model, [one, other.with_channels(q=other["q"] + 0.05)], free=["M*"], per_record=["bias_q"])
    fit = filtered(problem, {"w_q": 0.0})
    for name, truth in {"bias_q[m1]": 0.0, "bias_q[m2]": 0.05}.items():
        assert abs(fit.values[name] - truth) < 4.0 * fit[name].std_cramer_rao < 0.02
    white = {"w_q": fit.process_noise["w_q"][0]}
    values = {**{name: fit.values[name] for name in problem.shared}, "bias_q": fit.values["bias_q[m1]"]}
    unseen = replace(problem, records=[one], per_record=())
    right, wrong = (one_step(unseen, values | bias, fit.noise, white) for bias in ({}, {"bias_q": 0.05}))
    assert right.log_likelihood > wrong.log_likelihood


def test_prediction_on_unseen_records_prefers_the_truth():
    unseen = Problem(gusty(), [flown(12, WHITE)])
    right = one_step(unseen, TRUTH, NOISE, WHITE)
    assert np.nanmean(np.concatenate(list(right.innovations.values()))[20:] ** 2) == pytest.approx(1.0, abs=0.1)
    for wrong in ({**TRUTH, "Ma": -3.0}, {**TRUTH, "Mq": -1.2}):
        assert one_step(unseen, wrong, NOISE, WHITE).log_likelihood < right.log_likelihood
    assert one_step(unseen, TRUTH, NOISE, {}).log_likelihood < right.log_likelihood


def test_a_limit_holds():
    """Truth: the free estimate where the limit does not act; at a limit beyond it the limit itself, with the other
    parameters at their optimum for it, which is the fit with that value fixed."""
    problem = Problem(gusty(), [flown(14, WHITE)], free=["*"])
    noise = dict.fromkeys(WHITE, 0.0)
    free = filtered(problem, noise)
    loose = filtered(replace(problem, constraints=[limit_parameter("Mq", upper=0.0)]), noise)
    assert loose.values["Mq"] == pytest.approx(free.values["Mq"], abs=0.02 * free["Mq"].std)
    limit = free.values["Mq"] - 2.0 * free["Mq"].std
    held = filtered(replace(problem, constraints=[limit_parameter("Mq", upper=limit)]), noise)
    fixed = filtered(replace(problem, fixed={"Mq": limit}), noise)
    assert held.converged and held.values["Mq"] == pytest.approx(limit, rel=1e-9)
    assert held.log_likelihood == pytest.approx(fixed.log_likelihood, abs=0.01)
    for name in fixed.values:
        assert held.values[name] == pytest.approx(fixed.values[name], abs=0.05 * fixed[name].std), name
    assert held["Mq"].interval[1] == pytest.approx(limit, abs=1e-6 * abs(limit))


def test_a_fit_is_one_like_any_other(tmp_path):
    """It is saved and read, tabled, predicted and drawn; its residuals are those of one step, white at the truth."""
    record = flown(15, WHITE)
    fit = filtered(Problem(gusty(), [record], free=["*"]), dict.fromkeys(WHITE, 0.0))
    fit.save(tmp_path / "fit.casid")
    back = cs.load(tmp_path / "fit.casid")
    assert back.values == fit.values and back.process_noise == fit.process_noise
    np.testing.assert_array_equal(back.innovations["m1"], fit.innovations["m1"])
    assert list(fit.to_frame().index) == list(fit.values)
    assert fit.to_dict()["process_noise"]["w_q"]["correlation_time_s"] == 0.0
    np.testing.assert_allclose(fit.predictions["m1"] + fit.residuals["m1"], record.matrix(["alpha", "q"]))
    open_loop = fit.predict(record)
    assert np.std(record["q"] - open_loop.output("q")) > np.std(fit.residuals["m1"][:, 1])
    assert fit.plot() is not None
    told = cs.identifiability(fit)
    expected = np.sqrt(np.diagonal(np.linalg.inv(fit.covariance)) * np.diagonal(fit.covariance))
    np.testing.assert_allclose(list(told.inflation.values()), expected, rtol=0.01)
    with pytest.raises(EstimationError, match="FilterError cannot be drawn"):
        cs.bootstrap(fit, 2, 0)
    profiled = cs.profile(fit, ["Mq"])["Mq"]
    assert profiled.upper - profiled.lower == pytest.approx(2.0 * 1.96 * fit["Mq"].std_cramer_rao, rel=0.1)


def test_what_it_does_not_do_is_said():
    noise = {"w_q": 0.0}
    problem = Problem(gusty(), [flown(13, {}, samples=100)], free=["*"], cost=FilterError(process_noise=noise))
    with pytest.raises(InputError, match="did you mean 'w_q'"):
        replace(problem, cost=FilterError(process_noise={"w_qq": 0.0}))
    with pytest.raises(InputError, match="correlation time"):
        FilterError(process_noise={"w_q": -1.0})
    with pytest.raises(InputError, match="did you mean 'w_q'"):
        FilterError(process_noise=noise, sigma={"w_qq": 1.0})
    formulas: dict[str, float | str | Noise] = {name: Noise(sigma=lambda at: 0.01) for name in NOISE}
    with pytest.raises(EstimationError, match="noise by formula"):
        replace(problem, noise=formulas)
    with pytest.raises(EstimationError, match="limits of states"):
        replace(problem, constraints=[limit_trajectory("alpha", upper=1.0)])
    for method in (SingleShooting(), Collocation(), MultipleShooting(substeps=2)):
        with pytest.raises(EstimationError, match="a state at every sample"):
            solve(problem, method)
    with pytest.raises(EstimationError, match="no form as a nonlinear programme"):
        solve(problem, solver=Ipopt())


def test_hfb320_lift_slope_with_process_noise_is_the_published_one(flight_data):
    """Output error 3.1, filter error 4.3 to 4.5 per rad (Jategaonkar, Flight Vehicle System Identification, ch. 5)."""
    problem = hfb320.problem(hfb320.record_from(flight_data / "hfb320_1_10.asc"))
    fit = filtered(problem, {"w_V": 0.0, "w_alpha": 0.0})
    assert fit.converged, fit.status
    assert 4.3 < fit.values["CL_alpha"] < 4.5
    assert fit.log_likelihood > filtered(problem, {}).log_likelihood + 1000.0


@pytest.mark.parametrize("output", ["x", "y"])
@pytest.mark.parametrize("unit", [1e-6, 1e5])
def test_an_estimate_is_the_same_in_any_unit_of_the_states(output, unit):
    """x' = -k x + w from 1 in other units, read under the state's name or another one."""
    t = np.linspace(0.0, 10.0, 41)
    y = np.exp(-0.3 * t) + 0.05 * np.random.default_rng(0).standard_normal(41)
    model = define_model(
        "decay",
        states=("x",),
        inputs=(),
        parameters={"k": 0.2},
        outputs=(output,),
        disturbances=("w",),
        dynamics=lambda s: {"x": -s.k * s.x + s.w},
        output=lambda s: {output: s.x},
    )
    found = [
        filtered(Problem(model, [Record(name="r", t=t, channels={output: size * y})], free=["k"]), {})
        for size in (1.0, unit)
    ]
    assert all(fit.converged for fit in found)
    assert abs(found[1].values["k"] - found[0].values["k"]) < 1e-4 * found[0]["k"].std_cramer_rao
    assert found[1]["k"].std_cramer_rao == pytest.approx(found[0]["k"].std_cramer_rao, rel=1e-4)
    assert found[1].noise[output] == pytest.approx(unit * found[0].noise[output], rel=1e-4)
