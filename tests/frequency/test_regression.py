"""Fourier-domain equation error against exact motions, least squares as textbooks write it, and real flights."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import START, TRUTH, short_period
from frequency_cases import BAND, T, flown, noisy

import casid as cs
from casid.errors import EstimationError, InputError
from casid.model.system import define_model, define_regression
from casid.records.record import Record

COST = cs.FourierEquationError(band=BAND)
MEASURED = {"alphadot": 0.01, "qdot": 0.02}

MODEL = short_period(START)


def problem(*records: Record, **options) -> cs.Problem:
    return cs.Problem(MODEL, records, **({"free": ["*"], "cost": COST} | options))


def test_an_exact_motion_gives_its_derivatives_whatever_constants_are_added() -> None:
    biased = flown().with_channels(qdot=flown()["qdot"] + 0.3, alpha=flown()["alpha"] + 0.05)
    fit = cs.solve(problem(biased))
    assert fit.converged
    assert fit.values == pytest.approx(TRUTH, rel=1e-9)


def test_estimates_and_deviations_are_those_of_complex_least_squares() -> None:
    """theta = Re(X'X)^-1 Re(X'z), covariance s^2 Re(X'X)^-1 with the sum of squares of 2 M - p real numbers."""
    record = noisy(flown(), MEASURED, np.random.default_rng(3))
    fit = cs.solve(problem(record, free=["M*"]))
    bins = np.arange(1, len(T) // 2) * 2.0 * np.pi / (len(T) * record.dt)
    inside = (bins >= BAND[0]) & (bins <= BAND[1])
    transform = np.fft.fft(record.matrix(["alpha", "q", "delta_e", "qdot"]), axis=0)[1 : len(T) // 2][inside]
    x, z = transform[:, :3], transform[:, 3]
    information = (x.conj().T @ x).real
    theta = np.linalg.solve(information, (x.conj().T @ z).real)
    variance = np.sum(np.abs(z - x @ theta) ** 2) / (2 * len(z) - 3)
    assert list(fit.values.values()) == pytest.approx(theta, rel=1e-7)
    assert fit.covariance == pytest.approx(variance * np.linalg.inv(information), rel=0.02)  # one variance per channel


def test_the_noise_is_in_units_of_the_samples() -> None:
    found = [cs.solve(problem(noisy(flown(), MEASURED, np.random.default_rng(seed)))).noise for seed in range(20)]
    mean = {name: np.sqrt(np.mean([one[name] ** 2 for one in found])) for name in MEASURED}
    assert mean == pytest.approx(MEASURED, rel=0.05)  # 1-sigma of such a mean: 0.025


def test_a_derivative_that_is_not_recorded_is_j_omega_times_the_transform() -> None:
    """Exact where the state is a straight line and sines of the stretch's own period, whose derivatives are known."""
    w = 2.0 * np.pi / (len(T) * 0.02)
    x = 0.3 * T + np.sin(3 * w * T) + 0.5 * np.cos(8 * w * T)
    slope = 0.3 + 3 * w * np.cos(3 * w * T) - 4.0 * w * np.sin(8 * w * T)
    model = define_model(
        "first order",
        states=("x",),
        inputs=("u",),
        parameters={"a": -1.0, "b": 1.0},
        outputs=("x",),
        dynamics=lambda s: {"x": s.a * s.x + s.b * s.u},
        output=lambda s: {"x": s.x},
    )
    record = Record(name="m", t=T, channels={"x": x, "u": (slope + 2.0 * x) / 5.0})
    fit = cs.solve(cs.Problem(model, [record], free=["*"], cost=cs.FourierEquationError(band=(0.5, 5.0))))
    assert fit.values == pytest.approx({"a": -2.0, "b": 5.0}, rel=1e-9)


def test_it_is_nearer_than_smoothed_differences() -> None:
    record = flown().without("alphadot", "qdot")
    error = {
        type(cost).__name__: max(abs(cs.solve(problem(record, cost=cost)).values[n] / TRUTH[n] - 1.0) for n in TRUTH)
        for cost in (COST, cs.EquationError())
    }
    assert error["FourierEquationError"] < 1e-3
    assert error["FourierEquationError"] < 0.1 * error["EquationError"]


def test_gaps_divide_a_record_and_change_nothing_of_an_exact_motion() -> None:
    record = flown()
    missing = record["alpha"].copy()
    missing[400:480] = np.nan
    fit = cs.solve(problem(record.with_channels(alpha=missing)))
    assert fit.values == pytest.approx(TRUTH, rel=1e-9)
    assert fit.channels["qdot"].samples < cs.solve(problem(record)).channels["qdot"].samples


def test_records_may_have_parameters_of_their_own_and_priors_count() -> None:
    other = flown(TRUTH | {"Mde": -9.0}, name="m2", seed=5)
    fit = cs.solve(problem(flown(), other, free=["Z*", "Ma", "Mq"], per_record=["Mde"]))
    assert fit.values == pytest.approx(
        {n: TRUTH[n] for n in ("Za", "Zde", "Ma", "Mq")} | {"Mde[m1]": -6.0, "Mde[m2]": -9.0}, rel=1e-9
    )
    held = short_period(START, prior_std={"Ma": 1e-9})
    fit = cs.solve(cs.Problem(held, [flown()], free=["M*"], cost=COST, prior=True, noise={"alphadot": 1, "qdot": 1}))
    assert fit["Ma"].value == pytest.approx(START["Ma"], rel=1e-6)


def test_a_model_without_states_is_a_regression() -> None:
    model = define_regression(
        "lift",
        inputs=("alpha", "q"),
        parameters={"CL_alpha": 1.0, "CL_q": 0.0},
        outputs=("CL",),
        output=lambda s: {"CL": s.CL_alpha * s.alpha + s.CL_q * s.q},
    )
    record = flown().with_channels(CL=5.0 * flown()["alpha"] + 0.7 * flown()["q"] + 0.4)
    fit = cs.solve(cs.Problem(model, [record], free=["*"], cost=COST))
    assert fit.values == pytest.approx({"CL_alpha": 5.0, "CL_q": 0.7}, rel=1e-9)


def test_what_has_no_part_in_a_band_is_an_error() -> None:
    model = define_regression(
        "lift",
        inputs=("alpha",),
        parameters={"CL_0": 0.2, "CL_alpha": 1.0},
        outputs=("q",),
        output=lambda s: {"q": s.CL_0 + s.CL_alpha * s.alpha},
    )
    with pytest.raises(EstimationError, match=r"fixed=\{'CL_0': 0.2\}"):
        cs.solve(cs.Problem(model, [flown()], free=["*"], cost=COST))
    with pytest.raises(EstimationError, match="'m1' has no stretch"):
        cs.solve(problem(flown(), cost=cs.FourierEquationError(band=(0.01, 0.02))))
    for band in ((3.0, 1.0), 2.0, (1.0, np.inf)):
        with pytest.raises(InputError, match="band"):
            cs.FourierEquationError(band=band)  # pyright: ignore[reportArgumentType]
    with pytest.raises(EstimationError, match="Ipopt"):
        cs.solve(problem(flown()), solver=cs.Ipopt())


def test_a_real_flight_agrees_with_equation_and_output_error_in_time(known_faults_data) -> None:
    """Twin Otter. Standard errors in the band are as large as those that count the colour of the residuals in time."""
    aircraft = cs.Aircraft.read(known_faults_data / "totter_f1_014.toml")
    records = [
        cs.flight_inputs(aircraft, cs.read_record(known_faults_data / f"totter_f1_{n}.csv"), "lateral")
        for n in ("014", "017")
    ]
    model = cs.aircraft_model(aircraft, axes="lateral")
    side = ["CY_beta", "CY_r", "CY_delta_r", "Cn_beta", "Cn_p", "Cn_r", "Cn_delta_a", "Cn_delta_r"]
    free = [*side, "Cl_beta", "Cl_p", "Cl_r", "Cl_delta_a", "Cl_delta_r"]
    levels = ["CY_0", "Cl_0", "Cn_0"]
    band = cs.solve(cs.Problem(model, records, free=free, cost=cs.FourierEquationError(band=(0.6, 9.0))))
    equation = cs.solve(cs.Problem(model, records, free=free, per_record=levels, cost=cs.EquationError()))
    output = cs.solve(cs.Problem(model, records, free=free, per_record=[*levels, "bias_p", "bias_r", "bias_ay"]))
    for name in free:
        other = equation[name] if name in side else output[name]  # differences of p in time lose some of its roll
        apart = abs(band[name].value - other.value) / np.hypot(band[name].std, other.std_corrected)
        assert apart < 3.0, name
    ratio = {
        name: (band[name].std / equation[name].std_corrected, band[name].std / equation[name].std_cramer_rao)
        for name in side
    }
    assert 0.5 < np.median([coloured for coloured, _ in ratio.values()]) < 1.5
    assert min(white for _, white in ratio.values()) > 2.0
