"""Moving air in the diagnosis: events that move as a whole, fits in turbulence, turbulence that is none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from diagnosis_flights import NOISE, flights, rough_file
from scipy import signal

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.onsets import at_peak
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit, Work, evaluate, gauss_newton_step
from casid.diagnosis.flight.fit import fit, relaxed
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.motion import Motion
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.given.contradicted import flight_values
from casid.diagnosis.kinematics.check import without_turbulence
from casid.diagnosis.kinematics.kinematics import reconstruct
from casid.diagnosis.kinematics.turbulence import gusts, in_other_air, in_turbulence, still_air, turbulence
from casid.model.causes.aerodynamics import unsteady_aero
from casid.model.causes.air import gust, wind_shear
from casid.model.causes.instruments import sensor_bias, sensor_lag, sensor_scale
from casid.model.dynamics import aircraft_model
from casid.model.effect import Effect
from casid.records.record import Record
from problems.blind import flown
from problems.do328 import STABLE, V_TRIM, do328

_T = np.arange(0.0, 20.0, 1.0 / 25.0)


def test_onsets_and_length_of_a_gust_are_found_together() -> None:
    """Begun 0.4 s early and 0.8 s too long, about the right middle, so that no onset can be moved alone."""
    flown = Attached(effect=gust("z"), values={"value": 4.0, "length": 1.5}, onsets={"m1": 12.6, "m2": 6.3})
    flight = prepare(do328(), flights([flown], seed=8, count=2))
    begun = replace(
        flown, values={"value": 3.5, "length": 2.3}, onsets={r: onset - 0.4 for r, onset in flown.onsets.items()}
    )
    start = fit(flight, [begun], flight.noise(), extent=(1, 0.5))
    found, intervals = at_peak(weigh(fit(flight, [begun], flight.noise())))
    event = found.fit.attached[0]
    assert start.deviance > found.fit.deviance + 300.0
    assert abs(event.values["length"] - 1.5) < 0.1
    for record, onset in flown.onsets.items():
        assert abs(event.onsets[record] - onset) < 0.05
        assert intervals[record][0] < onset < intervals[record][1]


ENDED = Attached(effect=wind_shear("x"), values={"value": 0.8, "duration": 6.0}, onsets={"m1": 6.0, "m2": 9.0})


def test_a_shear_that_ends_is_fitted_with_its_end() -> None:
    """Truth: wind that grows for 6 s and stays. A shear that goes on leaves a part that a gust would explain."""
    flight = prepare(do328(), flights([ENDED], seed=4, count=2))
    begun, endless = (replace(ENDED, values={"value": 0.5, "duration": s}) for s in (4.0, 1e3))
    found = fit(flight, [begun], flight.noise())
    assert dict(found.attached[0].values) == pytest.approx(ENDED.values, rel=0.1)
    without, goes_on = (fit(flight, some, flight.noise(), extent=(15, 0.5)) for some in ([], [endless]))
    assert goes_on.deviance - found.deviance > 0.2 * (without.deviance - found.deviance)


@pytest.mark.slow
def test_a_shear_that_ends_is_one_shear() -> None:
    (cause,) = diagnose(do328(), flights([ENDED], seed=4, count=3)).causes
    assert (cause.kind, cause.target) == ("wind_shear", "x")
    assert cause.value == pytest.approx(0.8, rel=0.1) and cause.parameters["duration"] == pytest.approx(6.0, rel=0.1)


def test_small_offsets_of_all_instruments_are_no_turbulence() -> None:
    """Truth: calm air, and in every channel an offset of half of what matters. Without offsets in the model, moving air
    explains them all at once."""
    rng, found = np.random.default_rng(6), flights(seed=6, count=3, rate_hz=50.0, duration_s=30.0)
    offsets = {o: rng.choice([-1.0, 1.0]) * 0.5 * matters(sensor_bias(o)) for o in NOISE}
    flight = prepare(do328(), [r.with_channels(**{o: r[o] + x for o, x in offsets.items()}) for r in found])
    calm = reconstruct(flight)
    felt = calm.deviance - reconstruct(flight, (), gusts(flight, 0.4), calm).deviance
    judged = turbulence(flight, calm)
    assert felt > 150.0 and not judged.named and judged.gain < 0.1 * felt


def test_coloured_noise_of_air_data_is_no_turbulence() -> None:
    """Truth: calm air, and noise in V, alpha and beta that a filter of 3 Hz makes slow enough for a process of moving
    air. Unknown histories of the air follow all of turbulence, and not half of that."""
    rng, low_pass = np.random.default_rng(1), signal.butter(2, 3.0, fs=50.0, output="sos")

    def noisy(record: Record) -> Record:
        slow = {o: signal.sosfilt(low_pass, rng.standard_normal(len(record))) for o in ("V", "alpha", "beta")}
        return record.with_channels(**{o: record[o] + 2.0 * NOISE[o] * x / np.std(x) for o, x in slow.items()})

    flight = prepare(do328(), [noisy(r) for r in flights(seed=6, count=3, rate_hz=50.0)])
    judged = turbulence(flight, reconstruct(flight))
    assert judged.gain > 1e4 and judged.sigma > 1.0 and not judged.named
    assert judged.as_histories < 0.5 * judged.gain
    moving = _in_turbulence()
    true = turbulence(moving, reconstruct(moving))
    assert true.named and true.as_histories > 0.95 * true.gain


def matters(effect: Effect) -> float:
    return effect.smallest_that_matters(do328()) or 0.0


@cache
def _in_turbulence() -> Subject:
    air = flown.turbulence(np.random.default_rng(7), _T, 1.0, V_TRIM, 20.98)
    return prepare(rough_file(), flights(seed=7, count=3, disturbance=air))


def test_fits_in_turbulence_converge_and_an_absent_cause_gains_little() -> None:
    """Dryden turbulence taken for a process of first order, moments 30 % off at the start: a fit converges, the filter
    of its own values changes little, and a cause that is not there gains no more than a rough model of the air leaves
    to it, and never loses. With the filter of every step its own, fits stopped where they began, and a cause gained
    hundreds with a value of zero."""
    flight = _in_turbulence()
    noise = flight.noise(gusts(flight, 1.0, {"dCl": 1.0}))
    rough = fit(flight, [], noise)
    base = relaxed(rough)
    assert rough.converged and base.converged
    moved = (fit(flight, [], noise, base, anew=True).values - base.values) / np.sqrt(np.diag(base.covariance))
    assert np.abs(moved).max() < 1.0
    absent = Attached(effect=unsteady_aero("CY"), values={"value": 0.0})
    beside = fit(flight, [absent], noise, base, extent="settled")
    assert beside.converged
    still = fit(flight, [], flight.noise())
    assert -0.5 < base.deviance - beside.deviance < 0.002 * (still.deviance - base.deviance)


@cache
def _fitted_in_turbulence() -> FlightFit:
    flight = _in_turbulence()
    air = replace(still_air(flight), sigma=1.0, length=533.0)
    return in_turbulence(flight, air, fit(flight, [], flight.noise()))


def test_in_turbulence_what_is_absent_has_the_statistic_of_chance() -> None:
    """Truth: chi-square of one degree of freedom, mean 1 and 90 % below 2.7, for all terms of a linear aircraft. Along
    the most likely motion, which later samples determine too, the mean was 2.3, and a late lift had 134."""
    found = _fitted_in_turbulence()
    evidence = weigh(found)
    judge = Screen(evidence)
    absent = [e for e in found.flight.effects if e.quasi_steady or e.target == "CL" and "dot" in (e.regressor or "")]
    everywhere = np.ones((1, len(found.batch.names)))
    statistics = [judge.score([one], everywhere)[0] for one in fingerprints(evidence, absent)]
    shown = [one for one in statistics if one > 0.0]
    assert len(shown) > 300
    assert np.mean(shown) < 1.5
    assert np.quantile(shown, 0.9) < 3.5
    assert max(shown) < 30.0


def test_derivatives_in_turbulence_come_out_as_flown() -> None:
    """Dryden turbulence of 1 m/s, whose pitching and yawing are the gradient of its velocity. Without that in a model
    derivatives take it up; calm air leaves them where gusts pull them."""
    flight = _in_turbulence()
    names = ("Cm_alpha", "Cm_q", "Cm_delta_e", "Cl_p", "Cl_delta_a", "Cn_beta", "Cn_r", "Cn_delta_r")
    calm, found = fit(flight, [], flight.noise()), _fitted_in_turbulence()

    def furthest(fitted) -> float:
        return max(abs(fitted.derivatives[name] / STABLE[name] - 1.0) for name in names)

    assert found.flight.turning == {"q": -1.0, "r": 1.0}
    assert furthest(found) < 0.08 < furthest(calm), (furthest(found), furthest(calm))


def test_in_turbulence_the_gradient_is_that_of_the_prediction_errors() -> None:
    """Truth: differences of their sum of squares by each value, and by the motion about which the model is linearised,
    which must change nothing to first order. Of a scale of the airspeed, which the wind imitates, the slope along the
    most likely motion had a third of the size, and a fit of it ran away."""
    flight = _in_turbulence()
    noise = flight.noise(gusts(flight, 1.0, {"dCl": 1.0}))
    base = relaxed(fit(flight, [], noise))
    with_scale = fit(flight, [Attached(effect=sensor_scale("V"), values={"value": 0.0})], noise, base, extent=(1, 0.5))
    work = Work(flight, with_scale.attached, noise, "all")
    work.reference, work.filter = with_scale.reference, with_scale.filter_of_another

    def squares(values: np.ndarray, motion: Motion) -> float:
        attached = (with_scale.attached[0].with_values({"value": float(values[-1])}),)
        return float(np.sum(evaluate(work, attached, values, motion).white ** 2))

    here, change = squares(with_scale.values, with_scale.motion), np.sqrt(np.diag(with_scale.covariance))
    data = with_scale.gradient + with_scale.prior_pull
    _, moved = gauss_newton_step(with_scale)
    largest = np.abs(2.0 * data * change).max()
    for i, size in enumerate(change):
        moves = 0.01 * size * np.eye(len(change))[i]
        by_value = squares(with_scale.values + moves, with_scale.motion) - squares(
            with_scale.values - moves, with_scale.motion
        )
        assert by_value / 0.02 == pytest.approx(-2.0 * data[i] * size, abs=0.05 * largest), with_scale.slots[i].name
    by_motion = (squares(with_scale.values, with_scale.motion.moved(moved, 0.01)) - here) / 0.01
    assert abs(by_motion) < 0.05 * float(with_scale.gradient @ with_scale.covariance @ with_scale.gradient)


def test_values_in_turbulence_are_those_that_predict() -> None:
    """Uniform Dryden turbulence of 1 m/s, a rough vane every 0.08 s. Of the air and the values together the maximum is
    at larger values, since less air explains the same motion: CY_beta is 6 deviations off there. The model of the air
    is approximate, and what it leaves is in the intervals."""
    air = flown.turbulence(np.random.default_rng(7), _T, 1.0, V_TRIM, 20.98)
    uniform = {name: x for name, x in air.items() if name.startswith("wind")}
    rough = NOISE | {"alpha": 0.0052, "beta": 0.0052}
    seldom = np.where(np.arange(len(_T)) % 2, np.nan, 1.0)
    records = [
        r.with_channels(alpha=seldom * r["alpha"], beta=seldom * r["beta"])
        for r in flights(seed=7, count=3, disturbance=uniform, noise=rough)
    ]
    flight = prepare(do328(), records)
    moving = flight.changed(turning={})
    found = relaxed(fit(moving, [], moving.noise(gusts(flight, 1.0, {}, 533.0))))
    values = flight_values(weigh(found), found)
    for name in ("CL_alpha", "Cm_alpha", "CY_beta", "Cn_beta", "Cl_delta_a"):
        assert abs(found[name] - STABLE[name]) < 3.0 * found.std(name), name
        assert abs(values[name].value - STABLE[name]) < 2.0 * values[name].std, name


@pytest.mark.parametrize("seed", [7, 8])
def test_noise_in_turbulence_is_that_of_the_instruments(seed: int) -> None:
    """Truth: the noise that was added, and air of which the model is exact. What the air does above the band of the
    motion is in the noise that was measured there: the accelerometer has 1.8 times its own."""
    rng, length = np.random.default_rng(seed), 533.0
    left = np.exp(-(_T[1] - _T[0]) * V_TRIM / length)
    news = np.sqrt(1.0 - left**2) * rng.standard_normal((3, 5000 + len(_T)))
    air = {
        f"wind_{axis}": signal.lfilter([1.0], [1.0, -left], one)[5000:] for axis, one in zip("xyz", news, strict=True)
    }
    flight = prepare(do328(), flights(seed=seed, count=3, disturbance=air))
    found = in_turbulence(flight, replace(still_air(flight), sigma=1.4, length=length), fit(flight, [], flight.noise()))
    assert flight.sigma["az"] > 1.7 * NOISE["az"]
    for name in ("V", "alpha", "beta", "ax", "ay", "az"):
        assert 1.0 / 1.5 < found.noise.measurement[name] / NOISE[name] < 1.5, name
    assert all(1.0 / 1.5 < found.noise.coloured[name][0] < 1.5 for name in air)
    for name in ("CL_alpha", "Cm_alpha", "CY_beta", "Cn_beta", "Cl_p"):
        assert abs(found[name] - STABLE[name]) < 3.0 * found.std(name), name


def test_air_that_moves_as_a_whole_is_a_form_of_turbulence() -> None:
    """Dryden turbulence of 1 m/s that is uniform over the aircraft. With its gradients in the model derivatives take
    them up; the deviations of a fit in one form hold what the other form says."""
    air = flown.turbulence(np.random.default_rng(7), _T, 1.0, V_TRIM, 20.98)
    uniform = {name: x for name, x in air.items() if name.startswith("wind")}
    flight = prepare(rough_file(), flights(seed=7, count=3, disturbance=uniform))
    found = in_turbulence(flight, replace(still_air(flight), sigma=1.0, length=533.0), fit(flight, [], flight.noise()))
    assert not found.flight.turning and "dCl" not in found.noise.coloured
    turned = in_other_air(found)
    assert turned.flight.turning and turned.deviance > found.deviance + 50.0
    values, wrong = flight_values(weigh(turned), found), 0.0
    for name in ("Cm_alpha", "Cm_q", "Cm_delta_e", "Cl_p", "Cl_delta_a", "Cn_beta", "Cn_r", "Cn_delta_r"):
        naive = abs(turned[name] - STABLE[name]) / turned.std(name)
        wrong = max(wrong, naive)
        assert abs(values[name].value - STABLE[name]) < 3.0 * values[name].std, name
    assert wrong > 3.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_gradient_of_moving_air_turns_the_aircraft(sign: float) -> None:
    """In air whose w grows by 2 m/s in a second, and that was w - 2 T a span's part T = 4 b / (pi V) ago, the motion is
    that in air that pitches by 2 / V (MIL-F-8785C, 3.7.5)."""
    turned, plain = aircraft_model(do328(), turning={"q": sign}), aircraft_model(do328())
    assert turned.states == (*plain.states, "air_w")
    x = plain.guess(flights(seed=1, count=1)[0])[40]
    u = np.zeros(len(plain.inputs))
    u[list(plain.inputs).index("rho")] = 1.0
    at = 8.0 * do328().rate_length_lateral / (np.pi * x[plain.states.index("u")])
    w = {"wind_z": 3.0}
    pitching = {"wind_z": 3.0, "gust_q": sign * 2.0 / x[plain.states.index("u")]}

    def rate(model, x, air) -> np.ndarray:
        disturbance = [air.get(name, 0.0) for name in model.disturbances]
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        return f(x, u, model.nominal_vector(), disturbance).full().ravel()

    moved = rate(turned, [*x, 3.0 - 2.0 * at], w)
    assert moved[-1] == pytest.approx(2.0)
    assert moved[:-1] == pytest.approx(rate(plain, x, pitching), rel=1e-12, abs=1e-14)


def test_moving_air_is_taken_back_beside_the_faults_that_imitate_it() -> None:
    """A slow gyroscope and a gust look like turbulence until they are found."""
    slow = Attached(effect=sensor_lag("q"), values={"value": 0.17}, records=("m1", "m3"))
    sudden = Attached(effect=gust("x"), values={"value": -4.0, "length": 1.0}, onsets={"m1": 5.8, "m2": 14.0})
    flight = prepare(do328(), flights([slow, sudden], seed=2, count=3))
    imitated = turbulence(flight, reconstruct(flight))
    assert imitated.gain > 150.0
    calm = without_turbulence(flight, [], [slow, sudden], imitated)
    assert calm is not None
    evidence, ranked = calm
    assert evidence.fit.attached == ()
    assert {one.name for one in ranked[:3]} & {slow.name, sudden.name}


def test_true_turbulence_stays_beside_a_fault() -> None:
    biased = Attached(effect=sensor_bias("q"), values={"value": 0.001})
    flight = _in_turbulence()
    true = turbulence(flight, reconstruct(flight))
    assert without_turbulence(flight, [], [biased], true) is None
    assert without_turbulence(flight, [], [], true) is None
