"""Flights of JSBSim aircraft: the simulator against its own files, and every fault against its law.

Truths: the derivatives in JSBSim's aircraft files, Newton's law and kinematics, and the definition of each fault in
`casid.model.vocabulary`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import signal

from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.records.readers import read_record
from problems.jsbsim.airframe import AIRFRAMES, airframe
from problems.jsbsim.apriori import Regression, coefficients, geometry, guessed, healthy_flights, regress
from problems.jsbsim.corpus import DIGITS, SIZES, cases, flights, rounded, truth
from problems.jsbsim.faults import Fault, instrument_fault
from problems.jsbsim.fdm import Log
from problems.jsbsim.flight import Flight, fly, log_of, record_of
from problems.jsbsim.manoeuvres import CARDS

pytest.importorskip("jsbsim", reason='no jsbsim: pip install "casid[jsbsim]"')

# Table values of JSBSim's aircraft files; those that a table makes depend on Mach or Reynolds number are left out.
FILE_VALUES = {
    "fokker50": {
        "Cl_p": -0.5138,
        "Cm_alpha": -1.8763,
        "Cm_q": -20.1341,
        "Cn_beta": 0.1809,
        "Cn_delta_r": -0.1102,
        "CL_delta_e": 0.2732,
        "Cn_delta_a": -0.0080,
    },
    "737": {
        "CL_alpha": 1.0 / 0.23,
        "CL_delta_e": 0.2,
        "Cl_beta": -0.09,
        "Cl_p": -0.4,
        "Cl_r": 0.09,
        "Cl_delta_r": 0.01,
        "Cm_q": -27.0,
        "Cn_r": -0.35,
        "Cn_delta_r": -0.20,
    },
}


@lru_cache
def regression(name: str) -> tuple[Aircraft, Regression]:
    """The aircraft without aerodynamics, and those of its healthy flights."""
    pairs = healthy_flights(name)
    bare = geometry(name, *pairs[0])
    return bare, regress(bare, [record for _, record in pairs])


@lru_cache
def flown(fault: Fault | None = None, seed: int = 5) -> Log:
    return log_of(flight(fault, seed))


def flight(fault: Fault | None = None, seed: int = 5) -> Flight:
    """Elevator 3-2-1-1 and aileron in 12 s, without noise."""
    return Flight(aircraft="fokker50", manoeuvre="pitch_roll_yaw", duration_s=12.0, fault=fault, noise={}, seed=seed)


def rudder_flight(fault: Fault | None) -> Log:
    """Rudder and aileron in 8 s."""
    return log_of(replace(flight(fault), manoeuvre="yaw_roll_thrust", duration_s=8.0))


def air_velocity(log: Log) -> np.ndarray:
    """Velocity [m/s] of the air in body axes, (N, 3), up to a constant: what kinematics without wind leaves over."""
    c = log.channels
    omega = np.stack([c["p"], c["q"], c["r"]], axis=1)
    velocity = np.stack([c["u"], c["v"], c["w"]], axis=1)
    down = np.stack(
        [-np.sin(c["theta"]), np.cos(c["theta"]) * np.sin(c["phi"]), np.cos(c["theta"]) * np.cos(c["phi"])], axis=1
    )
    force = np.stack([c["ax"], c["ay"], c["az"]], axis=1)
    rate = force + log.gravity * down - np.cross(omega, velocity)
    change = np.zeros_like(velocity)
    change[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(log.t)[:, None], axis=0)
    return change - (velocity - velocity[0])


@pytest.mark.parametrize("name", ["fokker50", pytest.param("737", marks=pytest.mark.slow)])
def test_regression_finds_what_the_file_says(name: str) -> None:
    """Noise-free accelerations give JSBSim's own derivatives within 2 % and leave less than 1 % of the variance."""
    _, found = regression(name)
    for derivative, value in FILE_VALUES[name].items():
        coefficient, term = derivative.split("_", 1)
        assert found.values[coefficient][term] == pytest.approx(value, rel=0.02), derivative
    assert min(found.R2.values()) > 0.99, found.R2


def test_flight_obeys_newton_and_kinematics() -> None:
    """In calm air velocity, rates, attitude and specific force agree to 0.02 m/s over a manoeuvre; the inertia tensor
    turns JSBSim's moments into its angular accelerations (Euler's equation)."""
    log = flown()
    assert np.abs(air_velocity(log)).max() < 0.02
    c = log.channels
    omega = np.stack([c["p"], c["q"], c["r"]], axis=1)
    omega_dot = np.stack([c["pdot"], c["qdot"], c["rdot"]], axis=1)
    moments = omega_dot @ log.inertia.T + np.cross(omega, omega @ log.inertia.T)
    given = np.stack([c["L"], c["M"], c["N"]], axis=1)
    assert np.abs(moments - given).max() < 1e-6 * np.abs(given).max()


def test_servo_without_fault_follows_its_command() -> None:
    log = flown()
    for surface in ("delta_e", "delta_a", "delta_r"):
        np.testing.assert_allclose(log.channels[f"seen_{surface}"], log.channels[surface], atol=1e-12)


def test_actuator_lag_is_of_first_order() -> None:
    log = flown(Fault(kind="actuator_lag", target="delta_e", size=0.1))
    command = log.channels["delta_e"]
    _, lagged, _ = signal.lsim(([1.0], [0.1, 1.0]), command - command[0], log.t)
    error = log.channels["seen_delta_e"] - command[0] - lagged
    assert np.abs(error).max() < 1e-3 * np.ptp(command)


def test_input_delay_shifts_the_surface() -> None:
    log = flown(Fault(kind="input_delay", target="delta_e", size=0.06))
    shifted = np.interp(log.t - 0.06, log.t, log.channels["delta_e"])
    np.testing.assert_allclose(log.channels["seen_delta_e"], shifted, atol=1e-9)


def test_rate_limit_is_reached_and_kept() -> None:
    log = flown(Fault(kind="rate_limit", target="delta_e", size=0.2))
    rate = np.abs(np.diff(log.channels["seen_delta_e"])) / np.diff(log.t)
    assert rate.max() == pytest.approx(0.2, rel=1e-6)
    assert np.abs(np.diff(log.channels["delta_e"])).max() / 0.005 > 0.4


def test_dead_zone_and_backlash_by_their_half_widths() -> None:
    log = rudder_flight(Fault(kind="dead_zone", target="delta_r", size=0.01))
    command = log.channels["delta_r"] - log.channels["delta_r"][0]
    moved = log.channels["seen_delta_r"] - log.channels["seen_delta_r"][0]
    np.testing.assert_allclose(moved, np.sign(command) * np.clip(np.abs(command) - 0.01, 0.0, None), atol=1e-9)
    log = flown(Fault(kind="backlash", target="delta_e", size=0.007))
    play = np.abs(log.channels["seen_delta_e"] - log.channels["delta_e"])
    assert play.max() == pytest.approx(0.007, rel=1e-6)


def test_effectiveness_changes_at_its_onset() -> None:
    log = rudder_flight(Fault(kind="effectiveness_change", target="delta_r", size=-0.3, onset_s=2.5))
    share = log.channels["seen_delta_r"] / log.channels["delta_r"]
    np.testing.assert_allclose(share[log.t < 2.5 - 1e-9], 1.0, atol=1e-9)
    np.testing.assert_allclose(share[log.t > 2.5 + 1e-9], 0.7, atol=1e-9)


def test_mass_properties_change_by_what_the_fault_says() -> None:
    healthy = flown()
    heavy = flown(Fault(kind="mass", size=1160.0))
    assert heavy.mass - healthy.mass == pytest.approx(1160.0, rel=1e-5)
    np.testing.assert_allclose(heavy.cg, healthy.cg, atol=1e-5)
    forward = flown(Fault(kind="cg_offset", target="x", size=0.25))
    np.testing.assert_allclose(forward.cg - healthy.cg, (-0.25, 0.0, 0.0), atol=1e-6)  # structural x points aft
    turned = flown(Fault(kind="inertia", target="Ixz", size=9600.0))
    expected = [[0.0, 0.0, -9600.0], [0.0, 0.0, 0.0], [-9600.0, 0.0, 0.0]]
    np.testing.assert_allclose(turned.inertia - healthy.inertia, expected, atol=0.1)


def test_aero_term_adds_to_its_coefficient_only() -> None:
    """Cm from Euler's equation, less the healthy regression, is 6 alpha^2."""
    log = flown(Fault(kind="aero_term", target="Cm", term="alpha^2", size=6.0))
    record = record_of(flight(), log)
    pairs = [(log, record)]
    bare = geometry("fokker50", *pairs[0])
    terms = {
        "alpha": record["alpha"],
        "q": record["q"] * bare.rate_length_pitch / record["V"],
        "delta_e": record["delta_e"],
        "0": np.ones(len(record)),
    }
    healthy = sum(value * terms[term] for term, value in regression("fokker50")[1].values["Cm"].items())
    extra = coefficients(bare, record)["Cm"] - healthy
    assert np.polyfit(record["alpha"] ** 2, extra, 1)[0] == pytest.approx(6.0, rel=0.02)


def test_gust_and_shear_move_the_air() -> None:
    """Kinematics show a 1-cosine gust of 4 m/s, over after 2 s, and a wind that grows by 0.35 m/s2 for 2 s."""
    log = flown(Fault(kind="gust", target="z", size=4.0, onset_s=6.0, duration_s=2.0))
    wind = air_velocity(log)[:, 2]
    at = {s: int(np.searchsorted(log.t, s)) for s in (5.9, 6.5, 7.0, 8.1)}
    assert abs(wind[at[5.9]]) < 0.02 and abs(wind[at[8.1]]) < 0.05
    assert wind[at[7.0]] == pytest.approx(4.0, rel=0.02)
    assert wind[at[6.5]] == pytest.approx(2.0, rel=0.05)
    log = flown(Fault(kind="wind_shear", target="x", size=0.35, onset_s=8.0, duration_s=2.0))
    assert air_velocity(log)[-1, 0] == pytest.approx(0.35 * 2.0, rel=0.03), "it stays when the ramp has ended"


def test_turbulence_comes_from_the_seed() -> None:
    severe = Fault(kind="turbulence", size=3.0)
    first, again = flown(severe, 6).channels["turb_z"], log_of(flight(severe, 6)).channels["turb_z"]
    np.testing.assert_array_equal(first, again)
    assert np.std(first) > 0.5
    assert np.corrcoef(first, flown(severe, 5).channels["turb_z"])[0, 1] < 0.9


@pytest.mark.parametrize(
    ("fault", "channel", "law"),
    [
        (Fault(kind="sensor_bias", target="q", size=0.01), "q", lambda t: np.sin(t) + 0.01),
        (Fault(kind="sensor_bias", target="q", size=0.01), "qdot", np.cos),
        (Fault(kind="sensor_scale", target="q", size=0.1), "qdot", lambda t: 1.1 * np.cos(t)),
        (Fault(kind="sensor_delay", target="inertial", size=0.08), "az", lambda t: np.sin(np.clip(t - 0.08, 0, None))),
        (Fault(kind="sensor_delay", target="inertial", size=0.08), "alpha", np.sin),
    ],
)
def test_instrument_faults_by_definition(fault: Fault, channel: str, law: Callable) -> None:
    t = np.arange(0.0, 5.0, 0.005)
    channels = {"q": np.sin(t), "qdot": np.cos(t), "az": np.sin(t), "alpha": np.sin(t)}
    np.testing.assert_allclose(instrument_fault(fault, t, channels)[channel], law(t), atol=1e-5)


def test_vane_ahead_of_the_centre_of_gravity_sees_the_pitch_rate() -> None:
    """alpha at the vane = atan((w - q x) / u), x forward positive."""
    log, x = flown(), 9.0
    reading = record_of(flight(Fault(kind="vane_position", target="alpha", size=x)), log)
    c = {name: values[::4] for name, values in log.channels.items()}
    np.testing.assert_allclose(reading["alpha"], np.arctan2(c["w"] - c["q"] * x, c["u"]), atol=1e-12)


def test_noise_is_that_of_the_table_and_repeats() -> None:
    log = flown()
    noisy = replace(flight(), noise={"q": 0.001, "thrust": 0.01})
    first, clean = record_of(noisy, log), record_of(flight(), log)
    assert np.std(first["q"] - clean["q"]) == pytest.approx(0.001, rel=4 / math.sqrt(2 * len(clean)))
    assert np.std(first["thrust"] / clean["thrust"].mean()) > 0.009
    np.testing.assert_array_equal(first["q"], record_of(noisy, log)["q"])
    np.testing.assert_array_equal(first["V"], clean["V"])


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Flight(aircraft="fokker5", manoeuvre="pitch_roll_yaw", seed=1), "did you mean 'fokker50'"),
        (lambda: Flight(aircraft="737", manoeuvre="pitch", seed=1), "unknown manoeuvre 'pitch'"),
        (lambda: Flight(aircraft="737", manoeuvre="pitch_roll_yaw", seed=1, dt=0.003), "multiple of 0.005 s"),
        (lambda: Fault(kind="gust", target="z", size=4.0), "needs onset_s"),
        (lambda: Fault(kind="mass", size=4.0, onset_s=1.0), "has no onset_s"),
        (lambda: Fault(kind="actuator_lagg", target="delta_e", size=4.0), "did you mean 'actuator_lag'"),
    ],
)
def test_bad_input_is_named(build: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build()


def test_a_trim_point_out_of_reach_is_refused() -> None:
    with pytest.raises(InputError, match="does not settle"):
        fly(replace(flight(), speed_mps=250.0))


def test_every_case_of_the_corpus_is_distinct() -> None:
    """Names and seeds are unique, and the fault is in the records that the case names."""
    seeds = set()
    for name in SIZES:
        table = cases(name)
        assert len({case.name for case in table}) == len(table)
        for case in table:
            flown_now = flights(name, case)
            seeds |= {f.seed for f in flown_now.values()}
            affected = {record for record, f in flown_now.items() if f.fault is not None}
            assert affected == ((set(case.onsets) or set(case.records)) if case.fault else set())
    assert len(seeds) == sum(len(cases(name)) for name in SIZES) * len(CARDS)
    assert set(SIZES) == set(AIRFRAMES)


def test_truth_speaks_the_vocabulary() -> None:
    """Unit and sign of the vocabulary; turbulence by the r.m.s. of the air's velocity; clean when nothing is hidden."""
    by_name = {case.name: case for case in cases("fokker50")}
    told = truth(airframe("fokker50"), by_name["actuator_lag_delta_e"], {"m1": flown()})
    assert (told["kind"], told["target"], told["size"], told["unit"]) == ("actuator_lag", "delta_e", 0.1, "s")
    log = flown(Fault(kind="turbulence", size=3.0), 6)
    told = truth(airframe("fokker50"), by_name["turbulence"], {"m1": log})
    square = sum(np.mean(log.channels[f"turb_{axis}"] ** 2) for axis in "xyz")
    assert told["size"] == pytest.approx(math.sqrt(square / 3.0))
    assert truth(airframe("fokker50"), by_name["clean_1"], {"m1": flown()})["kind"] == "clean"


def test_apriori_values_are_near_the_truth_but_not_it() -> None:
    """The aircraft file's derivatives are 10 to 20 % off what JSBSim's file gives (rounding: 1 % more)."""
    bare, found = regression("fokker50")
    guess = guessed(bare, found, seed=3)
    for derivative, value in FILE_VALUES["fokker50"].items():
        coefficient, term = derivative.split("_", 1)
        exact = found.values[coefficient][term]
        assert 0.09 < abs(guess.derivatives[derivative] / exact - 1.0) < 0.21, (derivative, value)


def test_demonstration_records_are_what_the_script_flies(repo: Path, load_script: Callable[[str], ModuleType]) -> None:
    """A record flown again equals the embedded one within its last digit, and nothing in the folder names the hidden
    effect."""
    script, demo = load_script("make_demo_records"), repo / "casid" / "cli" / "demo"
    embedded = read_record(demo / "m2.csv")
    again = rounded(fly(script.demo_flight("m2")))
    assert set(again.channels) == set(embedded.channels)
    for name, values in embedded.channels.items():
        unit = 10.0 ** -DIGITS.get(name, 5)  # another processor may round a last digit the other way
        np.testing.assert_allclose(values, again[name], rtol=0.0, atol=1.01 * unit, err_msg=name)
    aircraft = Aircraft.read(demo / "aircraft.toml")
    assert not aircraft.effects
    assert sum(file.stat().st_size for file in demo.iterdir()) < 2_000_000
    for file in demo.iterdir():
        text = file.read_text(encoding="utf-8").lower()
        assert not any(word in text for word in ("lag", "fault", "hidden", script.HIDDEN.kind))
