"""Output error in the frequency domain against exact motions, differences, and output error in time."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import START, TRUTH, short_period
from frequency_cases import BAND, T, flown, noisy, smooth_input
from small_flight import aircraft_file

import casid as cs
from casid.errors import EstimationError
from casid.model.system import define_model

COST = cs.FourierOutputError(band=BAND)
NOISE = {"alpha": 0.002, "q": 0.004}
UNSTABLE = TRUTH | {"Ma": 3.0}

MODEL = short_period(START)


def problem(*records: cs.Record, **options) -> cs.Problem:
    return cs.Problem(MODEL, records, **({"free": ["*"], "cost": COST} | options))


@pytest.mark.parametrize("hold", ["linear", "held"])
@pytest.mark.parametrize("values", [TRUTH, UNSTABLE], ids=["stable", "unstable"])
def test_an_exact_motion_gives_its_parameters(hold: str, values: dict[str, float]) -> None:
    """Truth: matrix exponentials, from a start that is not at rest, with biases on what is measured."""
    t = T if values is TRUTH else T[:300]
    record = flown(values, hold=hold, t=t)
    fit = cs.solve(problem(record.with_channels(q=record["q"] + 0.1)))
    assert fit.converged
    assert fit.values == pytest.approx(values, rel=1e-8)


def test_gaps_divide_a_record_and_change_nothing_of_an_exact_motion() -> None:
    missing = flown()["q"].copy()
    missing[300:380] = np.nan
    fit = cs.solve(problem(flown().with_channels(q=missing)))
    assert fit.values == pytest.approx(TRUTH, rel=1e-8)


def test_an_output_that_is_not_measured_is_left_out() -> None:
    fit = cs.solve(problem(flown().without("alpha")))
    assert list(fit.channels) == ["q"]
    a = np.array([[fit.values["Za"], 1.0], [fit.values["Ma"], fit.values["Mq"]]])
    truth = np.array([[TRUTH["Za"], 1.0], [TRUTH["Ma"], TRUTH["Mq"]]])
    assert np.poly(a) == pytest.approx(np.poly(truth), rel=1e-6)


def test_derivatives_are_those_of_differences() -> None:
    posed = problem(noisy(flown(), NOISE, np.random.default_rng(1)))
    part, p = COST.equations(posed), posed.start_parameters
    ((_, slopes),) = part.slabs(p, 0)
    for i in range(p.shape[1]):
        moved = np.zeros_like(p)
        moved[0, i] = 1e-5
        difference = (part.value(p + moved).residuals[0] - part.value(p - moved).residuals[0]) / 2e-5
        assert slopes[:, :, i] == pytest.approx(difference, abs=1e-7 * np.abs(slopes).max())


def test_a_nonlinear_aircraft_in_small_motion_is_its_linear_one() -> None:
    """The error of small motion about trim falls with the size of the motion."""
    aircraft = aircraft_file()
    model = cs.aircraft_model(aircraft, axes="longitudinal")
    names = ["Cm_alpha", "Cm_q", "Cm_delta_e", "CL_alpha"]
    level = cs.trim(aircraft, V=120.0, altitude=3000.0)
    error = []
    for size in (1.0, 0.25):
        channels = {name: np.full(len(T), value) for name, value in level.inputs.items()}
        channels["delta_e"] = channels["delta_e"] + 0.3 * size * smooth_input(T)
        whole = cs.simulate(cs.aircraft_model(aircraft), cs.Record(name="m", t=T, channels=channels), level.state)
        record = cs.flight_inputs(aircraft, whole.as_record("m"), "longitudinal")
        fit = cs.solve(
            cs.Problem(model, [record], free=names, start={n: 1.2 * model.nominal[n] for n in names}, cost=COST)
        )
        error.append(max(abs(fit.values[n] / model.nominal[n] - 1.0) for n in names))
    assert error[0] < 0.02
    assert error[1] < 0.5 * error[0]


def test_what_it_cannot_take_is_an_error() -> None:
    timed = define_model(
        "drifting",
        states=("x",),
        inputs=("t",),
        parameters={"a": -1.0, "b": 0.5},
        outputs=("x",),
        dynamics=lambda s: {"x": s.a * s.x + s.t},
        output=lambda s: {"x": s.x + s.b},
    )
    record = cs.Record(name="m", t=T, channels={"x": np.sin(T)})
    with pytest.raises(EstimationError, match="depends on time"):
        cs.solve(cs.Problem(timed, [record], free=["a"], cost=COST))
    biased = define_model(
        "biased",
        states=("x",),
        inputs=("u",),
        parameters={"a": -1.0, "b": 0.5},
        outputs=("x",),
        dynamics=lambda s: {"x": s.a * s.x + s.u},
        output=lambda s: {"x": s.x + s.b},
    )
    with pytest.raises(EstimationError, match=r"fixed=\{'b': 0.5\}"):
        cs.solve(cs.Problem(biased, [record.with_channels(u=np.cos(T))], free=["*"], cost=COST))


@pytest.mark.slow
def test_time_and_frequency_domain_are_equivalent_on_white_noise() -> None:
    """300 runs: the scatter of both is the same but for the noise outside the band, their estimates agree within the
    stated deviations, and 93 to 97 % of all intervals of 95 % hold the truth, for outputs and for equations."""
    rng, clean, model = np.random.default_rng(7), flown(), short_period(TRUTH)
    costs = {
        "output": cs.OutputError(),
        "band output": COST,
        "equation": cs.EquationError(),
        "band equation": cs.FourierEquationError(band=BAND),
    }
    values, hits = {name: [] for name in costs}, {name: [] for name in costs}
    truth = np.array(list(TRUTH.values()))
    for _ in range(300):
        outputs = noisy(clean, NOISE, rng)
        equations = noisy(clean, {"alphadot": 0.01, "qdot": 0.02}, rng)
        for name, cost in costs.items():
            record = equations if name.endswith("equation") else outputs
            fit = cs.solve(cs.Problem(model, [record], free=["*"], cost=cost))
            found = np.array(list(fit.values.values()))
            values[name].append(found)
            hits[name].append(np.abs(found - truth) < 1.96 * np.sqrt(np.diagonal(fit.covariance)))
    for domain in ("output", "equation"):
        here, there = (np.array(values[name]) for name in (domain, f"band {domain}"))
        ratio = there.std(axis=0) / here.std(axis=0)
        assert ratio == pytest.approx(np.ones(len(truth)), abs=0.08)
        assert ((there - here).std(axis=0) < 0.5 * here.std(axis=0)).all()  # independent ones would differ by 1.4
        assert (np.abs((there - here).mean(axis=0)) < 3.0 * (there - here).std(axis=0) / np.sqrt(300)).all()
        covered = np.mean(hits[f"band {domain}"])
        assert 0.93 < covered < 0.97


@pytest.mark.parametrize("cost", [COST, cs.FourierEquationError(band=BAND)], ids=["outputs", "equations"])
def test_a_fit_is_drawn_over_frequency_and_kept(cost, tmp_path) -> None:
    """The amplitude that is drawn is that of the discrete Fourier transform, in units of the noise of a sample."""
    record = noisy(flown(), NOISE, np.random.default_rng(9))
    fit = cs.solve(problem(record, cost=cost))
    measured = fit.plot().axes[0].get_lines()[0]
    name = next(iter(fit.channels))
    bins = 2.0 * np.pi * np.arange(len(T) // 2 + 1) / (len(T) * record.dt)
    inside = (bins >= BAND[0]) & (bins <= BAND[1])
    amplitude = np.abs(np.fft.rfft(record[name]))[inside] * np.sqrt(2.0 / len(T))
    factor = np.degrees(1.0) if name == "alpha" else 1.0  # alpha is known to be an angle, and drawn in degrees
    assert measured.get_xdata() == pytest.approx(bins[inside])
    assert measured.get_ydata() == pytest.approx(factor * amplitude, rel=1e-6)
    fit.save(tmp_path / "fit.casid")
    again = cs.load(tmp_path / "fit.casid")
    assert again.values == fit.values
    assert np.allclose(again.covariance, fit.covariance)


def test_a_model_without_derivatives_at_the_mean_motion_is_an_error() -> None:
    root = define_model(
        "root",
        states=("x",),
        inputs=("u",),
        parameters={"a": -1.0},
        outputs=("x",),
        dynamics=lambda s: {"x": s.a * np.sqrt(s.x) + s.u},
        output=lambda s: {"x": s.x},
    )
    record = cs.Record(name="m", t=T, channels={"x": -1.0 - 0.1 * np.sin(T), "u": np.cos(T)})
    with pytest.raises(EstimationError, match="mean motion of record 'm'"):
        cs.solve(cs.Problem(root, [record], free=["a"], cost=COST))
