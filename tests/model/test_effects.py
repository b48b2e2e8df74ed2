"""Truth: an effect at its null changes nothing and at a size changes something; formulas for what single ones do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from casid.model import operators
from casid.model.aircraft import EffectValue
from casid.model.causes.aerodynamics import configuration_change
from casid.model.causes.air import gust, wind_shear
from casid.model.causes.controls import effectiveness_change, feedback, washed_out
from casid.model.dynamics import aircraft_model
from casid.model.effect import Effect
from casid.model.effects import catalogue, effect_of
from casid.model.path import OUTPUTS, STATES, disturbance_names
from casid.model.system import Model
from casid.model.vocabulary import KINDS, check_effect
from casid.signals import SURFACES
from problems.do328 import do328

AIRCRAFT = replace(do328(), accelerometer=(1.0, 0.2, -0.3), alpha_vane=(6.0, 0.5, 0.2), beta_vane=(6.0, 0.0, -0.5))
CATALOGUE = (*catalogue(AIRCRAFT, OUTPUTS), configuration_change("CL+CD+Cm"))
SYMBOLIC = [e for e in CATALOGUE if e.change is not None]
SERIES = [e for e in CATALOGUE if e.series is not None]  # those with a state of their own are among both
OUTPUT = [e for e in CATALOGUE if e.output is not None]
MIXED = {
    "u": 140.0,
    "v": 3.0,
    "w": 6.0,
    "p": 0.2,
    "q": -0.1,
    "r": 0.15,
    "phi": 0.3,
    "theta": 0.1,
    "delta_e": 0.04,
    "delta_a": -0.03,
    "delta_r": 0.05,
    "thrust": 1.1e4,
    "rho": 0.9,
}


LAGGED = 0.02  # rad, flow angle behind a lag


def response(effects) -> tuple[ca.Function, np.ndarray, dict[str, int]]:
    """(p) -> [f; h] at one mixed flight point, nominal p, and where every parameter stands."""
    model = aircraft_model(AIRCRAFT, effects=effects)
    x, u = ([MIXED.get(name, LAGGED) for name in names] for names in (model.states, model.inputs))
    calm = np.zeros(len(model.disturbances))
    inner = ca.Function("inner", [model.x, model.u, model.p, model.w], [ca.vertcat(model.f, model.h)])
    outer = ca.Function("response", [model.p], [inner(x, u, model.p, calm)])
    return outer, model.nominal_vector(), {name: i for i, name in enumerate(model.parameters)}


def readings(t: np.ndarray) -> dict[str, np.ndarray]:
    """Something on every channel, recorded inputs included; surfaces of some fighter move at 140 deg/s."""
    rates = ("rate_p", "rate_q", "rate_r")
    names = (*OUTPUTS, "delta_e", "delta_a", "delta_r", "thrust", "alphadot", "betadot", *rates)
    size = {name: 1.0 if name in SURFACES else 0.2 for name in names}
    return {name: size[name] * np.sin((2.0 + 0.1 * i) * t + i) for i, name in enumerate(names)}


def null_values(effect: Effect) -> dict[str, float]:
    """Its value absent, its further parameters somewhere: a rate limit is absent when it is infinite."""
    absent = np.inf if effect.kind == "rate_limit" else 0.0
    further = {k: effect.further.grid[0][k] for k in effect.beside}
    return {"value": absent, **effect.further.defaults, **further} | ({"onset": 3.0} if effect.timed else {})


# -- the whole catalogue -----------------------------------------------------------------------------------------------


def test_the_catalogue_covers_the_vocabulary():
    """Every kind that diagnosis may name has a definition, and every effect a valid kind, target, term and unit."""
    kinds = {effect.kind for effect in CATALOGUE}
    of_rotors = {kind for kind, entry in KINDS.items() if entry.make.__module__.endswith(".rotors")}
    found_otherwise = {
        "turbulence",
        "table_increment",
        "moment_reference",
    }  # the last in the values, the first as noise
    stated = {kind for kind, entry in KINDS.items() if not list(entry.candidates(do328()))} - of_rotors
    assert kinds | found_otherwise | of_rotors | stated == set(KINDS)
    for effect in CATALOGUE:
        check_effect(effect.kind, effect.target, effect.term)
        ways = [effect.symbolic, effect.series is not None, effect.output is not None]
        assert sum(ways) == 1, effect.name
    assert len({effect.name for effect in CATALOGUE}) == len(CATALOGUE)


def test_symbolic_effects_change_nothing_at_their_null():
    plain, p, _ = response(())
    extended, at_null, _ = response(SYMBOLIC)
    own = sum(len(effect.states) for effect in SYMBOLIC)
    rates_and_outputs = np.delete(extended(at_null).full(), len(STATES) + np.arange(own), axis=0)
    np.testing.assert_allclose(rates_and_outputs, plain(p).full(), rtol=1e-12, atol=1e-14)


def test_every_symbolic_effect_changes_something_at_a_size():
    extended, at_null, index = response(SYMBOLIC)
    before = extended(at_null).full()[:, 0]
    for effect in SYMBOLIC:
        p = at_null.copy()
        p[index[effect.name]] = {"mass": 300.0, "inertia": 3e3, "aero_term": 100.0}.get(effect.kind, 0.1)
        after = extended(p).full()[:, 0]
        change = np.abs(after - before) / (np.abs(before) + 1e-3)
        assert change.max() > 1e-9, effect.name


def test_series_and_output_effects_change_nothing_at_their_null():
    t = np.arange(0.0, 10.0, 0.02)
    known = readings(t)
    for effect in SERIES:
        assert effect.series is not None
        for station, series in effect.series(t, known, null_values(effect)).items():
            np.testing.assert_allclose(series, 0.0, atol=1e-15, err_msg=effect.name)
            assert station in disturbance_names(AIRCRAFT)
    for effect in OUTPUT:
        assert effect.output is not None
        for channel, series in effect.output(t, known, null_values(effect)).items():
            np.testing.assert_allclose(series, known[channel], atol=1e-15, err_msg=effect.name)


def test_every_series_and_output_effect_changes_something_at_every_size_of_its_grid():
    t = np.arange(0.0, 10.0, 0.02)
    known = readings(t)
    for effect in (*SERIES, *OUTPUT):
        for further in effect.further.grid:
            values = null_values(effect) | ({"value": 0.05} if "value" not in further else {}) | dict(further)
            produce = effect.series or effect.output
            assert produce is not None
            for name, series in produce(t, known, values).items():
                reference = 0.0 if effect.series is not None else known[name]
                if effect.enters not in (None, name):
                    continue  # further coefficients have own sizes, zero here; further axes need an attitude
                assert np.abs(series - reference).max() > 1e-4, (effect.name, further)


def test_values_of_which_only_the_size_counts_are_even():
    """What is told without its sign acts the same with either sign."""
    t = np.arange(0.0, 10.0, 0.02)
    known = readings(t)
    unsigned = [e for e in CATALOGUE if e.further.unsigned]
    assert {e.name for e in unsigned} >= {"actuator_lag(delta_e)", "sensor_lag(q)", "unsteady_aero(Cm, lagged)"}
    for effect in unsigned:
        values = {"value": 0.05, **effect.further.grid[0]}
        mirrored = {name: -v if name in effect.further.unsigned else v for name, v in values.items()}
        produce = effect.series or effect.output
        assert produce is not None
        for name, series in produce(t, known, values).items():
            np.testing.assert_array_equal(produce(t, known, mirrored)[name], series, err_msg=effect.name)
        assert effect.in_words(mirrored) == values


def test_an_effect_in_the_aircraft_file_is_a_parameter_with_the_value_of_the_file():
    given = EffectValue(kind="cg_offset", target="x", value=0.12)
    model = aircraft_model(AIRCRAFT.with_effects([given]))
    assert model.nominal["cg_offset(x)"] == 0.12 and model.units["cg_offset(x)"] == "m"
    assert effect_of(given).name == "cg_offset(x)"


# -- what single effects do --------------------------------------------------------------------------------------------


def changed(name: str, value: float, effects=SYMBOLIC) -> tuple[dict[str, float], dict[str, float]]:
    """{state derivative or output: value} without and with one effect."""
    model = aircraft_model(AIRCRAFT, effects=effects)
    function, p, index = response(effects)
    names = (*(f"{s}dot/dt" for s in model.states), *model.outputs)
    before = function(p).full()[:, 0]
    p[index[name]] = value
    return dict(zip(names, before, strict=True)), dict(zip(names, function(p).full()[:, 0], strict=True))


def test_mass_divides_the_specific_force():
    chosen = [e for e in SYMBOLIC if e.name == "mass"]
    model = aircraft_model(do328(), effects=chosen)  # accelerometer in the centre of gravity
    f = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    x, u = ([MIXED[name] for name in names] for names in (model.states, model.inputs))
    calm = np.zeros(len(model.disturbances))
    rows = [model.outputs.index(a) for a in ("ax", "ay", "az")]
    before = f(x, u, model.nominal_vector(), calm).full()[rows, 0]
    after = f(x, u, model.nominal_vector({"mass": 500.0}), calm).full()[rows, 0]
    np.testing.assert_allclose(after, before * 10500.0 / 11000.0, rtol=1e-12)


def test_instrument_errors_change_their_own_channel_alone():
    before, after = changed("sensor_bias(alpha)", 0.01)
    assert {n for n in before if before[n] != after[n]} == {"alpha"}
    assert after["alpha"] - before["alpha"] == pytest.approx(0.01, rel=1e-12)
    before, after = changed("sensor_scale(q)", 0.1)
    assert {n for n in before if before[n] != after[n]} == {"q", "qdot"}
    assert after["qdot"] / before["qdot"] == pytest.approx(1.1, rel=1e-12)


def test_a_vane_further_forward_sees_more_upwash_of_the_pitch_rate():
    """alpha at x: atan((w + p y - q x)/(u + q z - r y)): forward of the c.g., nose-up motion reduces what it reads."""
    before, after = changed("vane_position(alpha)", 2.0)
    u, w = MIXED["u"] - 0.1 * 0.2 - 0.15 * 0.5, MIXED["w"] + 0.2 * 0.5
    assert before["alpha"] == pytest.approx(np.arctan2(w + 0.1 * 6.0, u), rel=1e-12)
    assert after["alpha"] == pytest.approx(np.arctan2(w + 0.1 * 8.0, u), rel=1e-12)


def test_moments_of_thrust_and_centre_of_gravity():
    """Thrust T acting dz lower: + T dz in pitch; y to the right: - T y in yaw; c.g. dx forward: - (-Z dx)."""
    before, after = changed("thrust_line", 0.2)
    assert (after["qdot"] - before["qdot"]) * 158e3 == pytest.approx(1.1e4 * 0.2, rel=1e-9)
    before, after = changed("thrust_asymmetry", 0.5)
    yaw = np.array([after[n] - before[n] for n in ("pdot", "rdot")])
    np.testing.assert_allclose(np.array([[103e3, -12.5e3], [-12.5e3, 240e3]]) @ yaw, [0.0, -1.1e4 * 0.5], atol=1e-6)
    chosen = [e for e in SYMBOLIC if e.name == "cg_offset(x)"]
    central = replace(AIRCRAFT, accelerometer=(0.0, 0.0, 0.0))
    model = aircraft_model(central, effects=chosen)
    h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    x, u = ([MIXED[name] for name in names] for names in (model.states, model.inputs))
    y0, y1 = (
        dict(zip(model.outputs, h(x, u, model.nominal_vector({"cg_offset(x)": s}), 0).full()[:, 0], strict=True))
        for s in (0.0, 0.1)
    )
    # moment about the new c.g. = old moment - r x F; r = (0.1, 0, 0), F = m a at the old c.g.
    assert (y1["qdot"] - y0["qdot"]) * 158e3 == pytest.approx(0.1 * 10500.0 * y0["az"], rel=1e-9)


def test_a_missing_term_adds_its_regressor_to_its_coefficient():
    before, after = changed("aero_term(Cm:alpha^2)", 3.0)
    V = np.linalg.norm([140.0, 3.0, 6.0])
    moment = 0.5 * 0.9 * V**2 * 40.0 * 2.04 * 3.0 * np.arctan2(6.0, 140.0) ** 2
    assert (after["qdot"] - before["qdot"]) * 158e3 == pytest.approx(moment, rel=1e-9)


def test_lagged_aerodynamics_follow_the_rate_of_the_lagged_angle():
    """Cm = value (alpha - alpha_lagged)/T c/V, and the lag itself moves at (alpha - alpha_lagged)/T, T = 0.1 s."""
    before, after = changed("unsteady_aero(Cm, lagged)", -8.0)
    V = np.linalg.norm([140.0, 3.0, 6.0])
    rate = (np.arctan2(6.0, 140.0) - LAGGED) / 0.1
    assert after["alpha_lagged_Cmdot/dt"] == before["alpha_lagged_Cmdot/dt"] == pytest.approx(rate, rel=1e-12)
    moment = 0.5 * 0.9 * V**2 * 40.0 * 2.04 * -8.0 * rate * AIRCRAFT.rate_length_pitch / V
    assert (after["qdot"] - before["qdot"]) * 158e3 == pytest.approx(moment, rel=1e-9)


def test_effectiveness_scales_the_surface_from_the_onset_on():
    t = np.arange(0.0, 10.0, 0.02)
    known = readings(t)
    effect = effectiveness_change("delta_e")
    assert effect.series is not None
    lost = effect.series(t, known, {"value": -0.3, "onset": 4.0})["d_delta_e"]
    assert not lost[t <= 4.0].any()
    np.testing.assert_allclose(lost[t > 4.03], -0.3 * known["delta_e"][t > 4.03])


# -- operators on series -----------------------------------------------------------------------------------------------

UNIFORM = np.arange(0.0, 10.0, 0.02)
JITTERED = np.cumsum(np.random.default_rng(8).uniform(0.01, 0.03, 500))


@pytest.mark.parametrize("t", [UNIFORM, JITTERED])
def test_lag_of_a_ramp_is_its_solution(t):
    """T ydot + y = t has y = t - T (1 - exp(-t/T)); the lag of a linear input is exact, for any sampling."""
    s = t - t[0]
    np.testing.assert_allclose(operators.lag(t, s, 0.3), s - 0.3 * (1.0 - np.exp(-s / 0.3)), atol=1e-12)


def test_delay_moves_a_series():
    moved = operators.delay(UNIFORM, np.sin(UNIFORM), 0.1)
    np.testing.assert_allclose(moved[5:], np.sin(UNIFORM[5:] - 0.1), atol=1e-12)


def test_rate_limit_dead_zone_and_backlash():
    square = np.where(UNIFORM > 1.0, 1.0, 0.0)
    limited = operators.rate_limit(UNIFORM, square, 0.5)
    np.testing.assert_allclose(limited, np.clip(0.5 * (UNIFORM - 1.0), 0.0, 1.0), atol=1e-9)
    wave = np.sin(UNIFORM)
    dead = operators.dead_zone(wave, 0.2, 0.0)
    assert not dead[np.abs(wave) < 0.2].any()
    np.testing.assert_allclose(dead[wave > 0.2], wave[wave > 0.2] - 0.2)
    played = operators.backlash(wave, 0.2)
    assert np.abs(played - wave).max() <= 0.2 + 1e-12
    past_peak = UNIFORM - np.pi / 2
    turned = (past_peak > 0.0) & (past_peak < np.arccos(0.6))  # the free play is taken up after the peak
    assert np.ptp(played[turned]) < 1e-3
    assert played.max() == pytest.approx(0.8, abs=1e-3)
    for rest in (-1.0, 0.5):
        begun = operators.backlash(wave, 0.2, rest)
        assert begun[0] == wave[0] + 0.2 * rest
        np.testing.assert_array_equal(begun[past_peak > 0.0], played[past_peak > 0.0])  # the stops forget where it was


def test_a_rate_limit_that_is_never_reached_changes_nothing():
    y = np.random.default_rng(3).standard_normal(len(UNIFORM))
    assert np.array_equal(operators.rate_limit(UNIFORM, y, 1e6), y)


def test_a_rate_limit_follows_what_lies_between_the_samples():
    """Truth: the same limit on the exact curve at 200 times the rate. Straight lines begin a movement early."""
    t = np.arange(0.0, 6.0, 0.04)
    fine = np.linspace(0.0, t[-1], 200 * (len(t) - 1) + 1)

    def curve(at: np.ndarray) -> np.ndarray:
        return 0.1 * np.sin(3.0 * (at - 1.0)) * np.clip(at - 1.0, 0.0, 1.0)

    exact = operators.rate_limit(fine, curve(fine), 0.2)[::200]
    by_curve = operators.rate_limit(t, curve(t), 0.2) - exact
    by_lines = operators.rate_limit(fine, np.interp(fine, t, curve(t)), 0.2)[::200] - exact
    assert np.std(exact - curve(t)) > 0.01  # it is limited
    assert np.std(by_curve) < 0.25 * np.std(by_lines)


def test_gust_is_one_minus_cosine():
    gust = operators.one_minus_cosine(UNIFORM, 2.0, 3.0)
    assert gust.max() == pytest.approx(1.0, abs=1e-9) and UNIFORM[np.argmax(gust)] == pytest.approx(3.5)
    assert not gust[(UNIFORM < 2.0) | (UNIFORM > 5.0)].any()


def test_structural_mode_has_the_gain_of_its_transfer_function():
    """w0^2 s/(s^2 + 2 d w0 s + w0^2) at s = j w, in steady state."""
    t, w, w0, d = np.arange(0.0, 40.0, 0.005), 2.0 * np.pi * 1.0, 2.0 * np.pi * 2.0, 0.03
    rate, derivative = operators.mode(t, np.sin(w * t), 2.0, d)
    last = t > 38.0
    expected = abs(w0**2 * 1j * w / (w0**2 - w**2 + 2j * d * w0 * w))
    assert np.abs(rate[last]).max() == pytest.approx(expected, rel=5e-3)
    assert np.abs(derivative[last]).max() == pytest.approx(w * expected, rel=5e-3)


def test_structural_mode_rings_alike_at_any_sampling_rate():
    """The truth is the mode integrated at 1 kHz: at 25 Hz a smooth pulse must ring as high, near 4 Hz and 6 samples a
    period, where straight lines between samples lose 9 %."""
    fine = np.arange(0.0, 10.0, 0.001)
    pulse = np.exp(-0.5 * ((fine - 2.0) / 0.06) ** 2)
    truth, coarse = (operators.mode(*x, 4.0, 0.03)[0] for x in ((fine, pulse), (fine[::40], pulse[::40])))
    truth = truth[::40]
    assert np.abs(coarse - truth).max() < 0.01 * np.abs(truth).max()


def test_heading_follows_from_bank_pitch_and_rates():
    """The truth is the Euler angles that the rates are made of: q and r of the 3-2-1 rotation."""
    t = np.arange(0.0, 10.0, 0.01)
    phi, theta, psi = 0.6 * np.sin(t), 0.2 * np.cos(0.7 * t), 0.9 * np.sin(0.3 * t)
    theta_rate, psi_rate = -0.14 * np.sin(0.7 * t), 0.27 * np.cos(0.3 * t)
    q = theta_rate * np.cos(phi) + psi_rate * np.cos(theta) * np.sin(phi)
    r = psi_rate * np.cos(theta) * np.cos(phi) - theta_rate * np.sin(phi)
    np.testing.assert_allclose(operators.turned(t, phi, theta, q, r), psi, atol=1e-5)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize(
    ("effect", "wind"),
    [
        (wind_shear, lambda t: np.clip(t - 2.0, 0.0, 4.0)),
        (gust, lambda t: np.where((t > 2.0) & (t < 6.0), 0.5 - 0.5 * np.cos(np.pi * (t - 2.0) / 2.0), 0.0)),
    ],
    ids=["wind_shear", "gust"],
)
def test_moving_air_keeps_its_direction_over_the_ground_while_the_aircraft_turns(effect, wind, axis):
    """The truth is the rotation of 3-2-1 Euler angles: turned back to the horizon, all of it is along one direction, of
    the horizon for a shear, and for a gust that of the body axis when it begins."""
    t = np.arange(0.0, 10.0, 0.1)
    phi, theta, psi = 0.6 * np.sin(t), 0.2 * np.cos(0.7 * t), 0.9 * np.sin(0.3 * t)
    series = effect(axis).series
    assert series is not None
    body = series(
        t, {"phi": phi, "theta": theta, "turned": psi}, {"value": 0.5, "onset": 2.0, "length": 4.0, "duration": 4.0}
    )
    from_body = Rotation.from_euler("ZYX", np.stack([psi, theta, phi], axis=1))
    level = from_body.apply(np.stack([body[f"wind_{b}"] for b in "xyz"], axis=1))
    direction = np.eye(3)["xyz".index(axis)]
    if effect is gust:
        direction = from_body[20].apply(direction)
    expected = 0.5 * wind(t)[:, None] * direction
    np.testing.assert_allclose(level, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "fed"),
    [
        (feedback("delta_a", "phi"), lambda x, own: x["phi"]),
        (washed_out("delta_r", "r"), lambda x, own: x["r"] - own),
        (washed_out("delta_e", "q"), lambda x, own: x["q"] - own),
    ],
)
def test_feedback_is_a_surface_that_also_follows_the_motion(effect: Effect, fed: Callable) -> None:
    """The rates of the aircraft are those of a surface moved by gain times what is fed back; a washout forgets it."""
    gain, memory, own = 0.4, 3.0, 0.02
    plain, looped = aircraft_model(AIRCRAFT, effects=()), aircraft_model(AIRCRAFT, effects=[effect])
    x = {name: 0.03 * (i + 1) for i, name in enumerate(plain.states)} | {"u": 60.0}
    u = {name: 0.01 * (i + 1) for i, name in enumerate(plain.inputs)} | {"rho": 1.0, "thrust": 3000.0}
    p = dict(looped.nominal) | {effect.name: gain, f"{effect.name}.time_constant": memory}
    moved = u | {effect.target: u[effect.target] + gain * fed(x, own)}

    def rates(model: Model, inputs: dict[str, float]) -> dict[str, float]:
        function = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        state = [x.get(name, own) for name in model.states]
        found = function(state, [inputs[n] for n in model.inputs], [p[n] for n in model.parameters], 0)
        return dict(zip(model.states, found.full()[:, 0].tolist(), strict=True))

    with_loop, by_hand = rates(looped, u), rates(plain, moved)
    assert {name: with_loop[name] for name in plain.states} == pytest.approx(by_hand, rel=1e-12)
    for name in set(with_loop) - set(by_hand):
        assert with_loop[name] == pytest.approx((x[str(effect.term)] - own) / memory)
