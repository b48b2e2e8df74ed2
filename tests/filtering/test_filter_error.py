"""Truth: simulated flights with known process noise, differences of the likelihood, output error as the limit, and the
published lift slope of the HFB-320."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight

from casid.errors import EstimationError, InputError
from casid.estimation import CombinedError, MultipleShooting, Noise, Problem, limit_parameter, solve
from casid.filtering.filter_error import filter_error, predict
from casid.filtering.innovations import NoiseModel, PointFunctions, make_batch
from casid.filtering.kalman import kalman_filter, residual_column
from casid.filtering.noise_score import unit_variances, variance_score
from casid.filtering.system import FilterSystem, evaluate_step
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


def squared_distance(fit) -> float:
    """Chi-square of the estimates against the truth."""
    error = np.array([fit.values[n] - TRUTH[n] for n in TRUTH])
    return float(error @ np.linalg.solve(fit.covariance, error))


def test_parameters_and_all_noises_are_recovered():
    """White process noise; estimates within the 0.999 chi-square bound, noises within four standard errors."""
    problem = Problem(gusty(far()), [flown(1, WHITE), flown(2, WHITE, name="m2")], free=["*"])
    fit = filter_error(problem, {"w_alpha": 0.0, "w_q": 0.0})
    assert fit.converged, fit.status
    assert squared_distance(fit) < 20.5
    for name, sigma in WHITE.items():
        assert fit.noise.white[name] == pytest.approx(sigma, rel=0.15), name
    for name, sigma in NOISE.items():
        assert fit.noise.measurement[name] == pytest.approx(sigma, rel=0.15), name
    white = np.concatenate(list(fit.innovations.white.values()))
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
    found = filter_error(problem, {"w_v": 0.0})

    assert found.status == "converged"
    for name, value in truth.items():
        assert abs(found.values[name] - value) < 3.0 * found.std[name]
    begun = predict(problem, start, found.noise)
    assert begun.log_likelihood < found.innovations.log_likelihood - (20.0 if factor != 1.0 else 0.0)


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
        filter_error(Problem(model, [record], free=["T"], start={"T": 0.4 * f}), {"w_x": 0.0}) for f in (1.0, factor)
    )
    assert near.converged and far.converged
    assert far.values["T"] == pytest.approx(near.values["T"], abs=0.01 * near.std["T"])
    assert far.std["T"] == pytest.approx(near.std["T"], rel=1e-3)


def test_what_the_data_say_nothing_of_is_no_estimate():
    """The gain of an input that stands still."""
    model, record = lagging(moved=0.0)
    fit = filter_error(Problem(model, [record], free=["T", "gain"]), {"w_x": 0.0})
    assert fit.status.startswith("not identifiable") and "gain" in fit.status
    assert np.isnan(fit.std["gain"])


def test_a_gust_is_told_from_noise_of_the_vane():
    """A Gauss-Markov gust that the vane sees: its r.m.s. and the vane's own noise."""
    problem = Problem(gusty(far()), [flown(s, {}, GUST, name=f"m{s}") for s in (3, 4)], free=["*"])
    fit = filter_error(problem, {"gust": TIME})
    assert fit.converged, fit.status
    sigma, tau = fit.noise.coloured["gust"]
    assert tau == TIME and sigma == pytest.approx(GUST, rel=0.25)
    assert fit.noise.measurement["alpha"] == pytest.approx(NOISE["alpha"], rel=0.2)
    assert squared_distance(fit) < 20.5


def test_without_process_noise_it_is_output_error():
    record = flown(5, {})
    problem = Problem(gusty(far()), [record], free=["*"])
    ours, theirs = filter_error(problem, {}), solve(problem, MultipleShooting())
    assert ours.converged
    for name in TRUTH:
        # the priors of the initial state differ: five scales here, one there
        assert abs(ours.values[name] - theirs[name].value) < 0.02 * theirs[name].std_cramer_rao
        assert ours.std[name] == pytest.approx(theirs[name].std_cramer_rao, rel=0.01)
    for name in NOISE:
        assert ours.noise.measurement[name] == pytest.approx(theirs.noise[name], rel=5e-3)


def test_given_noise_is_kept():
    problem = Problem(gusty(far()), [flown(6, WHITE)], free=["*"], noise=NOISE)
    fit = filter_error(problem, {"w_alpha": 0.0, "w_q": 0.0})
    assert dict(fit.noise.measurement) == NOISE and fit.converged
    again = solve(problem, MultipleShooting(interval=1, process_noise=fit.intensities))
    # soft defects with this noise give the same, but for the slope of the determinant: within a standard error
    for name in TRUTH:
        assert abs(again[name].value - fit.values[name]) < 1.0 * again[name].std
        assert again[name].std == pytest.approx(fit.std[name], rel=0.1)


def system_at_truth(records, noise: NoiseModel) -> tuple[FilterSystem, np.ndarray, np.ndarray]:
    problem = Problem(gusty(), records, free=["*"])
    taus = dict.fromkeys(noise.white, 0.0) | {n: tau for n, (_, tau) in noise.coloured.items()}
    batch = make_batch(problem.model, records)
    system = FilterSystem(
        problem=problem,
        batch=batch,
        functions=PointFunctions(problem.model, problem.shared),
        correlation_time=taus,
        measurement=None,
    )
    X = np.stack([problem.model.guess(r) for r in records], axis=1)
    return system, np.array(list(TRUTH.values())), X


def test_score_of_the_variances_is_the_slope_of_the_likelihood():
    """Central differences of -2 ln L in every variance, white and coloured, two records, a gap."""
    record = flown(7, WHITE, GUST, samples=150)
    hidden = record["q"].copy()
    hidden[40:60] = np.nan
    records = [record.with_channels(q=hidden), flown(8, WHITE, GUST, samples=150, name="m2")]
    noise = NoiseModel(measurement=NOISE, white=WHITE, coloured={"gust": (GUST, TIME)})
    system, theta, X = system_at_truth(records, noise)
    linear = system.linearise(theta, X)
    log_sigma = np.log([*NOISE.values(), *WHITE.values(), GUST])

    def deviance(trial: np.ndarray) -> float:
        return evaluate_step(system, theta, linear, system.noise(trial), np.zeros(len(theta))).deviance

    kalman = kalman_filter(linear, system.noise(log_sigma))
    white = kalman.whiten(linear.residual[..., None], -linear.defect[..., None])[..., 0]
    slope = (
        variance_score(kalman, white, unit_variances(linear, noise, measurement=True)) * 2.0 * np.exp(2.0 * log_sigma)
    )
    for i, name in enumerate((*NOISE, *WHITE, "gust")):
        step = 1e-4 * np.eye(len(log_sigma))[i]
        expected = (deviance(log_sigma + step) - deviance(log_sigma - step)) / 2e-4
        assert slope[i] == pytest.approx(expected, rel=1e-5, abs=1e-5), name


def test_slopes_together_are_the_difference_quotient_of_the_likelihood():
    """Sensitivities of the innovations and the slope through their covariance, against central differences; the system
    is linear, so that the likelihood does not depend on the trajectory it is linearised about."""
    noise = NoiseModel(measurement=NOISE, white=WHITE)
    system, theta, X = system_at_truth([flown(9, WHITE, samples=200)], noise)
    linear = system.linearise(theta, X)
    linear = system.linearise(theta, X + kalman_filter(linear, noise).smooth(*residual_column(linear))[0][..., :2])
    none = np.zeros(len(theta))
    step = evaluate_step(system, theta, linear, noise, none)
    std = np.sqrt(np.diag(step.covariance))
    slope = system.covariance_slope(theta, linear, noise) - 2.0 * np.linalg.solve(step.covariance, step.change)
    for i in range(len(theta)):
        shift = 0.02 * std[i] * np.eye(len(theta))[i]
        sides = [
            evaluate_step(system, theta + s * shift, system.linearise(theta + s * shift, X), noise, none).deviance
            for s in (1, -1)
        ]
        assert slope[i] * std[i] == pytest.approx((sides[0] - sides[1]) / 0.04, rel=1e-2, abs=1e-2)


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
    fit = filter_error(problem, {"w_q": 0.0})
    for name, truth in {"bias_q[m1]": 0.0, "bias_q[m2]": 0.05}.items():
        assert abs(fit.values[name] - truth) < 4.0 * fit.std[name] < 0.02
    unseen = replace(problem, records=[one])
    assert (
        predict(unseen, fit.values, fit.noise).log_likelihood
        > predict(unseen, {**fit.values, "bias_q[m1]": 0.05}, fit.noise).log_likelihood
    )


def test_prediction_on_unseen_records_prefers_the_truth():
    unseen = Problem(gusty(), [flown(12, WHITE)], free=["*"])
    noise = NoiseModel(measurement=NOISE, white=WHITE)
    right = predict(unseen, TRUTH, noise)
    assert np.nanmean(np.concatenate(list(right.white.values()))[20:] ** 2) == pytest.approx(1.0, abs=0.1)
    for wrong in ({**TRUTH, "Ma": -3.0}, {**TRUTH, "Mq": -1.2}):
        assert predict(unseen, wrong, noise).log_likelihood < right.log_likelihood
    assert predict(unseen, TRUTH, NoiseModel(measurement=NOISE)).log_likelihood < right.log_likelihood


def test_what_it_does_not_do_is_said():
    problem = Problem(gusty(), [flown(13, {}, samples=100)], free=["*"])
    with pytest.raises(InputError, match="did you mean 'w_q'"):
        filter_error(problem, {"w_qq": 0.0})
    with pytest.raises(EstimationError, match="correlation time"):
        filter_error(problem, {"w_q": -1.0})
    with pytest.raises(EstimationError, match="takes OutputError"):
        filter_error(replace(problem, cost=CombinedError()), {"w_q": 0.0})
    formulas: dict[str, float | str | Noise] = {name: Noise(sigma=lambda at: 0.01) for name in NOISE}
    with pytest.raises(EstimationError, match="a channel or a formula"):
        filter_error(replace(problem, noise=formulas), {"w_q": 0.0})
    with pytest.raises(EstimationError, match="no constraints"):
        filter_error(replace(problem, constraints=[limit_parameter("Mq", upper=0.0)]), {"w_q": 0.0})
    with pytest.raises(InputError, match="unknown value 'Ma'"):
        predict(problem, {n: v for n, v in TRUTH.items() if n != "Ma"}, NoiseModel(measurement=NOISE))


def test_hfb320_lift_slope_with_process_noise_is_the_published_one(flight_data):
    """Output error 3.1, filter error 4.3 to 4.5 per rad (Jategaonkar, Flight Vehicle System Identification, ch. 5)."""
    problem = hfb320.problem(hfb320.record_from(flight_data / "hfb320_1_10.asc"))
    fit = filter_error(problem, {"w_V": 0.0, "w_alpha": 0.0})
    assert fit.converged, fit.status
    assert 4.3 < fit.values["CL_alpha"] < 4.5
    assert fit.innovations.log_likelihood > filter_error(problem, {}).innovations.log_likelihood + 1000.0


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
        filter_error(Problem(model, [Record(name="r", t=t, channels={output: size * y})], free=["k"]), {})
        for size in (1.0, unit)
    ]
    assert all(fit.converged for fit in found)
    assert abs(found[1].values["k"] - found[0].values["k"]) < 1e-4 * found[0].std["k"]
    assert found[1].std["k"] == pytest.approx(found[0].std["k"], rel=1e-4)
    assert found[1].noise.measurement[output] == pytest.approx(unit * found[0].noise.measurement[output], rel=1e-4)
