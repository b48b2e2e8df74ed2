"""Diagnosis of multirotors in closed loop. Truth: RotorPy, which has no code of casid, and CrazyPAD's known damage."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

import casid as cs
from casid.report.page import Report
from problems.rotors.crazypad import flights

HERE = Path(__file__).resolve().parents[2]
FOLDERS = (HERE.parent / "shared" / "data" / "crazypad", Path(os.environ.get("CASID_DATA", "")) / "crazypad")
DATA = next((one for one in FOLDERS if one.is_dir()), None)


def flown(thrust: float, seed: int = 7) -> tuple[cs.Aircraft, cs.Record]:
    """A Crazyflie of RotorPy in closed loop, its fourth rotor with a part of its thrust."""
    from problems.rotors.flown import Hidden, aircraft_file, fly, usual_parameters
    from problems.rotors.sets import weaker

    known = usual_parameters("crazyflie_params", 0.03)
    hidden = None if thrust == 1.0 else Hidden(kind="", parameters=weaker(3, thrust=thrust))
    record = fly(known, hidden, seed, name="flight", size=0.8, breeze=0.4)
    return aircraft_file("quad", known), record


@pytest.mark.slow
def test_a_weak_rotor_is_named_with_its_size():
    pytest.importorskip("rotorpy")
    aircraft, record = flown(0.7)
    found = cs.diagnose(aircraft, [record])
    (named,) = found.causes
    assert (named.kind, named.target) == ("rotor_effectiveness", "m4")
    assert named.value == pytest.approx(-0.3, abs=0.04)
    assert f"m4 {100.0 * named.value:+.0f} per cent" in Report.of(found.document()).pictures["rotors"].alt


@pytest.mark.slow
def test_nothing_is_named_of_a_flight_without_a_fault():
    pytest.importorskip("rotorpy")
    aircraft, record = flown(1.0)
    found = cs.diagnose(aircraft, [record])
    assert found.verdict == "adequate" and not found.causes
    for name in ("m1", "m2", "m3", "m4"):
        assert found.flight[f"effectiveness_{name}"].value == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_a_reversed_gyro_is_a_fault_of_the_data_and_no_cause():
    """The check of an aeroplane's records is that of a multirotor's."""
    pytest.importorskip("rotorpy")
    aircraft, record = flown(1.0)
    found = cs.diagnose(aircraft, [record.with_channels(q=-record["q"])])
    assert [(one.kind, one.target, one.handled) for one in found.data] == [("data_sign", "q", "corrected")]
    assert found.verdict == "adequate" and not found.causes


@pytest.mark.slow
def test_the_lag_of_motors_that_a_simulator_lacks_is_named():
    pytest.importorskip("rotorpy")
    from problems.rotors.flown import Hidden, aircraft_file, fly, usual_parameters

    known = usual_parameters("hummingbird_params", 0.005)
    slow = Hidden(kind="", parameters=lambda parameters: parameters.__setitem__("tau_m", 0.072))
    record = fly(known, slow, 3, name="flight", size=1.6, breeze=0.4)
    found = cs.diagnose(aircraft_file("quad", known), [record])
    assert (found.causes[0].kind, found.causes[0].target) == ("rotor_lag", "rotors")
    assert found.causes[0].value == pytest.approx(0.067, abs=0.02)


@pytest.mark.slow
def test_what_the_file_says_of_a_rotor_is_not_found_again():
    """The extended file of one flight explains the next of the same aircraft: its effects are part of the model."""
    pytest.importorskip("rotorpy")
    aircraft, record = flown(0.7)
    weak = cs.EffectValue(kind="rotor_effectiveness", target="m4", value=-0.3, std=0.01)
    found = cs.diagnose(aircraft.with_effects([weak]), [record])
    assert found.verdict == "adequate" and not found.causes


@pytest.mark.slow
@pytest.mark.skipif(DATA is None, reason="CrazyPAD is not here; put it into CASID_DATA/crazypad")
def test_a_cut_blade_takes_thrust_of_its_rotor():
    """By weight and balance of moments in hover, which need no dynamics: M3 of E9 lost a sixth by 3 mm."""
    assert DATA is not None
    aircraft = cs.Aircraft.read(DATA / "crazyflie.toml")
    values = {}
    for name in ("normal_flight_E9_log00", "cut_propeller_M3_3mm_E9_log00"):
        flights_of_one = flights(DATA / f"motor_{name}.csv.gz")
        found = cs.diagnose(replace(aircraft, name=name), flights_of_one)
        values[name] = [found.flight[f"effectiveness_m{i}"].value for i in range(1, 5)]
    normal, cut = values.values()
    change = [after / before - 1.0 for before, after in zip(normal, cut, strict=True)]
    assert -0.22 < change[2] < -0.1
    assert max(abs(change[i]) for i in (0, 1, 3)) < 0.1
