"""Truth: what the effects of an aircraft file do to a simulated flight, as operators and other flights have it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from casid.errors import InputError
from casid.estimation import EquationError, MultipleShooting, Problem, solve
from casid.model import operators
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.dynamics import aircraft_model
from casid.model.flown_records import FlownRecords, axes_of, flown_records, with_estimates
from casid.model.in_force import slope_input
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.model.with_effects import unseen_by_equations
from casid.records.record import Record
from problems.do328 import do328

T = np.arange(0.0, 12.0, 0.02)
START = trim(do328(), V=144.0, thrust=10e3)
NOISE = {"alpha": 1e-3, "q": 1e-3, "az": 0.05}  # known: a level that is estimated falls to nothing where there is none


def inputs(name: str = "m1") -> Record:
    """Three-axis excitation about the trim of the Do 328."""
    channels = {n: np.full(len(T), v) for n, v in START.inputs.items()}
    for i, surface in enumerate(("delta_e", "delta_a", "delta_r")):
        channels[surface] = channels[surface] + 0.02 * np.sin(1.5 * T + i) * np.exp(-0.1 * T)
    return Record(name=name, t=T, channels=channels)


def fly(aircraft: Aircraft, record: Record | None = None) -> Record:
    """A measured record of this aircraft with its effects, as its instruments read it, without noise."""
    applied = flown_records(aircraft, [record or plain_flight()])
    model, ready = applied.model, applied.records[0]
    start = np.concatenate([START.state, model.guess(ready)[0, len(START.state) :]])
    flown = simulate(model, ready, start)
    return ready.with_channels(**{name: flown.outputs[:, i] for i, name in enumerate(model.outputs)})


def plain_flight(name: str = "m1") -> Record:
    return simulate(aircraft_model(do328()), inputs(name), START.state).as_record()


def refly(applied: FlownRecords) -> np.ndarray:
    """(N, outputs) of the applied model on its first record from its own first guess."""
    return simulate(applied.model, applied.records[0], applied.model.guess(applied.records[0])[0]).outputs


def test_without_effects_nothing_changes():
    plain = plain_flight()
    applied = flown_records(do328(), [plain])
    np.testing.assert_array_equal(refly(applied), plain.matrix(applied.model.outputs))


def test_a_lagged_surface_is_a_known_history():
    """The same flight as with the lagged surface in the record."""
    lagged = do328().with_effects([EffectValue(kind="actuator_lag", target="delta_e", value=0.2)])
    record = inputs()
    moved = record.with_channels(delta_e=operators.lag(T, record["delta_e"], 0.2))
    expected = simulate(aircraft_model(do328()), moved, START.state)
    np.testing.assert_allclose(fly(lagged)["q"], expected.output("q"), atol=1e-12)
    plain = plain_flight()
    assert np.abs(expected.output("q") - plain["q"]).max() > 1e-3


def test_an_event_acts_in_its_record_from_its_onset_on():
    change = EffectValue(
        kind="configuration_change", target="CL+CD", value=0.05, parameters={"CD": 0.01}, onset_s={"m1": (4.9, 5.1)}
    )
    applied = flown_records(do328().with_effects([change]), [plain_flight(), plain_flight("m2")])
    one, other = applied.records
    name = "configuration_change(CL+CD)"
    acting = {station: one[station] + 0.0 for station in ("dCL", "dCD")}
    for station in acting:
        for parameter in (p for p in applied.model.parameters if p.startswith(name)):
            slope = slope_input(station, parameter)
            acting[station] += applied.model.nominal[parameter] * one[slope]
            assert not other[slope].any()
    np.testing.assert_allclose(acting["dCD"], 0.01 * (T > 5.01), atol=1e-12)
    assert acting["dCL"].max() == pytest.approx(0.05) and not other["dCL"].any()


def test_a_symbolic_effect_of_some_records_acts_in_those_alone():
    heavy = do328().with_effects([EffectValue(kind="mass", value=800.0, records=("m2",))])
    applied = flown_records(heavy, [plain_flight("m1"), plain_flight("m2")])
    model = applied.model
    h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    calm, row = np.zeros(len(model.disturbances)), model.outputs.index("az")
    u = [[record[name][0] for name in model.inputs] for record in applied.records]
    az = [float(h(START.state, one, model.nominal_vector(), calm)[row]) for one in u]
    assert az[1] / az[0] == pytest.approx(10500.0 / 11300.0, rel=1e-12)


def test_a_lag_of_the_aerodynamics_vanishes_with_its_time_constant():
    """The memory of a lag far shorter than the motion is the rate itself: the alpha-dot derivative without one."""
    flown = {}
    for name, further in (("memory", {"time_constant": 0.02}), ("long", {"time_constant": 0.3}), ("none", {})):
        effect = EffectValue(kind="unsteady_aero", target="Cm", value=-15.0, parameters=further)
        flown[name] = fly(do328().with_effects([effect]))["q"]
    plain = plain_flight()["q"]
    change = np.abs(flown["none"] - plain).max()
    assert change > 1e-3
    assert np.abs(flown["memory"] - flown["none"]).max() < 0.1 * change
    assert np.abs(flown["long"] - flown["none"]).max() > 0.3 * change


def test_a_lag_of_the_aerodynamics_can_be_estimated_and_written(tmp_path):
    """Size and time constant from half and double their true values, derivatives known."""
    truth = EffectValue(kind="unsteady_aero", target="Cm", value=-15.0, parameters={"time_constant": 0.3})
    guess = replace(truth, value=-7.0, parameters={"time_constant": 0.6})
    read = fly(do328().with_effects([truth]))
    guessed = do328().with_effects([guess])
    applied = flown_records(guessed, [read], outputs=tuple(NOISE))
    assert unseen_by_equations(applied.model) == ("unsteady_aero(Cm, lagged)",)
    assert applied.model.units["unsteady_aero(Cm, lagged).time_constant"] == "s"
    fit = solve(Problem(applied.model, applied.records, free=["unsteady_aero*"], noise=NOISE), MultipleShooting())
    assert fit.converged, fit.status
    written = with_estimates(guessed, fit.values, {n: e.std for n, e in fit.parameters.items()})
    written.write(tmp_path / "extended.toml")
    (effect,) = Aircraft.read(tmp_path / "extended.toml").effects
    assert effect.value == pytest.approx(-15.0, rel=1e-2)
    assert effect.parameters["time_constant"] == pytest.approx(0.3, rel=1e-2)


def test_heading_and_altitude_are_states_where_an_effect_is_about_them():
    """psi and altitude integrate (q sin phi + r cos phi)/cos theta and the vertical velocity; a scale acts on what is
    read of them."""
    scaled = do328().with_effects([EffectValue(kind="sensor_scale", target="psi", value=0.1)])
    start = plain_flight().with_channels(psi=np.full(len(T), 0.5), altitude=np.full(len(T), 3000.0))
    plain, read = fly(do328(), start), fly(scaled, start)
    rate = (plain["q"] * np.sin(plain["phi"]) + plain["r"] * np.cos(plain["phi"])) / np.cos(plain["theta"])
    psi = 0.5 + cumulative_simpson(rate, x=T, initial=0.0)
    np.testing.assert_allclose(read["psi"], 1.1 * psi, atol=1e-6)
    assert np.ptp(psi) > 0.01
    delayed = do328().with_effects([EffectValue(kind="sensor_delay", target="altitude", value=0.2)])
    climb = plain["V"] * np.sin(plain["theta"] - plain["alpha"])  # wings nearly level: the flight path angle
    lost = np.interp(T - 0.2, T, cumulative_simpson(climb, x=T, initial=0.0))
    assert np.abs(fly(delayed, start)["altitude"] - 3000.0 - lost).max() < 0.05 * np.ptp(lost)
    assert np.array_equal(plain["psi"], start["psi"]), "heading is no output where nothing asks for it"


@pytest.mark.parametrize("kind, value", [("sensor_delay", 0.1), ("sensor_lag", 0.15)])
def test_slow_instruments_read_what_was_before(kind, value):
    """What a delayed or lagged instrument reads is the perfect reading behind the operator."""
    slow = do328().with_effects([EffectValue(kind=kind, target="alpha", value=value)])
    plain, read = plain_flight(), fly(slow)
    operate = operators.delay if kind == "sensor_delay" else operators.lag
    np.testing.assert_allclose(read["alpha"], operate(T, plain["alpha"], value), atol=2e-6)
    assert np.abs(read["alpha"] - plain["alpha"]).max() > 1e-3


def test_an_instrument_may_lag_in_some_records_only():
    """The truth is the operator itself in the record that has the lag, and the perfect reading in the other."""
    lag = EffectValue(kind="sensor_lag", target="alpha", value=0.15, records=("slow",))
    plain = plain_flight()
    slow, quick = (replace(plain, name=name) for name in ("slow", "quick"))
    applied = flown_records(do328().with_effects([lag]), [slow, quick])
    i = applied.model.outputs.index("alpha")
    expected = {"slow": operators.lag(T, plain["alpha"], 0.15), "quick": plain["alpha"]}
    for ready in applied.records:
        flown = simulate(applied.model, ready, np.r_[START.state, plain["alpha"][:1]])
        np.testing.assert_allclose(flown.outputs[:, i], expected[ready.name], atol=2e-5)
    assert np.abs(expected["slow"] - expected["quick"]).max() > 1e-3


def test_a_ringing_instrument_adds_its_oscillation():
    ringing = EffectValue(kind="structural_mode", target="q", value=0.05, parameters={"frequency_hz": 3.0})
    plain, read = plain_flight(), fly(do328().with_effects([ringing]))
    expected = 0.05 * operators.mode(T, plain["delta_e"], 3.0, 0.03)[0]
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(read["q"] - plain["q"], expected, atol=1e-12)


def test_what_no_record_has_is_left_alone():
    """Slow or ringing instruments of channels that were not recorded: the rest of the flight stays as it was."""
    values = [
        EffectValue(kind="structural_mode", target="ay", value=0.5, parameters={"frequency_hz": 3.0}),
        EffectValue(kind="sensor_delay", target="beta", value=0.1),
    ]
    plain = plain_flight().without("ay", "beta")
    applied = flown_records(do328().with_effects(values), [plain])
    np.testing.assert_array_equal(applied.records[0]["q"], plain["q"])
    assert set(applied.model.outputs).isdisjoint(("ay", "beta"))


def test_a_lag_of_an_instrument_can_be_estimated():
    """From 0.1 s to the true 0.2 s, derivatives known."""
    read = fly(do328().with_effects([EffectValue(kind="sensor_lag", target="alpha", value=0.2)]))
    guessed = do328().with_effects([EffectValue(kind="sensor_lag", target="alpha", value=0.1)])
    applied = flown_records(guessed, [read], outputs=tuple(NOISE))
    problem = Problem(applied.model, applied.records, free=["sensor_lag*"], noise=NOISE)
    fit = solve(problem, MultipleShooting())
    assert fit.converged, fit.status
    assert fit["sensor_lag(alpha)"].value == pytest.approx(0.2, rel=1e-3)
    written = with_estimates(guessed, fit.values, {n: e.std for n, e in fit.parameters.items()})
    assert written.effects[0].value == fit["sensor_lag(alpha)"].value


def test_known_histories_act_in_the_equation_error_form_too():
    """Equation error on a flight with a lagged elevator finds the true effectiveness only with the lag in the file."""
    lag = EffectValue(kind="actuator_lag", target="delta_e", value=0.2)
    record = fly(do328().with_effects([lag]))
    errors = []
    for aircraft in (do328(), do328().with_effects([lag])):
        applied = flown_records(aircraft, [record])
        fit = solve(Problem(applied.model, applied.records, free=["Cm_*"], cost=EquationError()))
        errors.append(abs(fit["Cm_delta_e"].value / -1.93 - 1.0))
    assert errors[1] < 1e-6 and errors[0] > 0.01


def test_what_cannot_act_is_said():
    plain = plain_flight()
    twice = do328().with_effects([EffectValue(kind="mass", value=v) for v in (100.0, 200.0)])
    with pytest.raises(InputError, match="stands twice"):
        flown_records(twice, [plain])
    instant = {"time_constant": 0.0}
    no_lag = do328().with_effects([EffectValue(kind="unsteady_aero", target="Cm", value=1.0, parameters=instant)])
    with pytest.raises(InputError, match="'time_constant' must be positive, got 0.0"):
        flown_records(no_lag, [plain])
    backwards = do328().with_effects([EffectValue(kind="sensor_lag", target="q", value=-0.1)])
    with pytest.raises(InputError, match="positive time constant"):
        flown_records(backwards, [plain])
    vane = do328().with_effects([EffectValue(kind="vane_position", target="alpha", value=1.0)])
    assert unseen_by_equations(flown_records(vane, [plain]).model) == ("vane_position(alpha)",)
    with pytest.raises(InputError, match="delta_e, delta_a are missing; expected delta_e"):
        axes_of([plain.without("delta_e", "delta_a")])
    mute = do328().with_effects([EffectValue(kind="gust", target="z", value=2.0, onset_s={"m1": (3.0, 3.0)})])
    with pytest.raises(InputError, match="'length' is missing"):
        flown_records(mute, [plain])
    with pytest.raises(InputError, match="nothing to compare"):
        flown_records(replace(do328(), trim={**do328().trim, "alpha": 0.006}), [inputs()])


def test_axes_follow_from_the_surfaces():
    plain = plain_flight()
    assert axes_of([plain]) == "full"
    assert axes_of([plain, plain.without("delta_a")]) == "longitudinal"
    assert axes_of([plain.without("delta_e")]) == "lateral"


def test_a_record_of_rotors_alone_is_told_as_one_of_a_multirotor() -> None:
    t = 0.02 * np.arange(200)
    bare = {"q": np.sin(t), "m1": np.cos(t), "m2": np.cos(t)}
    with pytest.raises(InputError, match="rotors, m1, m2, and no surfaces, as of a multirotor.*casid diagnose"):
        axes_of([Record(name="hover", t=t, channels=bare)])
    with pytest.raises(InputError, match="delta_e, delta_a, delta_r are missing"):
        axes_of([Record(name="vtol", t=t, channels={**bare, "delta_e_command": np.sin(t)})])
