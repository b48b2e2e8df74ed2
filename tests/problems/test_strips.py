"""Aircraft of strips. Truths: mirror symmetry, sums over strips by formula, rest at trim, the way of the downwash,
Dryden's r.m.s. values, and the definition of each hidden effect."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.diagnosis.diagnose import diagnose
from problems.blind import strips
from problems.blind.sets import cases_of, set_name
from problems.blind.strips import aircraft_of, records_of
from problems.independent.motion import angles_of
from problems.strips import flights
from problems.strips.effects import ONE, RECORDS, Effect, Linkage
from problems.strips.forces import Flow, aerodynamics
from problems.strips.motion import STEP_S, Task, fly, trim
from problems.strips.planes import JET, PLANES, TRAINER, Plane

STILL = np.zeros((301, 3, len(RECORDS)))


def quiet(way: str = "open", **other: object) -> Task:
    """Three seconds without any input, in calm air."""
    nothing = {"inputs": STILL, "throttle": STILL[:, 0], "air": STILL, "gradient": STILL, "delayed": False}
    return Task(**{**nothing, "way": way, "seed": 1, **other})


def test_flying_loads_nothing_of_casid() -> None:
    code = "import sys, problems.strips.flights; print([m for m in sys.modules if m[:5] == 'casid'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("plane", PLANES, ids=lambda plane: plane.name)
def test_trim_stays_where_it_is(plane: Plane) -> None:
    level = trim(plane)
    log = fly(plane, level, quiet(), ())
    assert np.abs(log["turning"]).max() < 1e-6
    assert np.ptp(log["V"]) < 1e-6 * plane.V
    assert np.abs(angles_of(np.moveaxis(log["x"][:, 6:10], 1, 0))[1] - level.alpha).max() < 1e-7


def test_a_mirrored_flow_gives_mirrored_forces() -> None:
    """A jet has no torque or swirl, so what is to the left and what is to the right may be exchanged."""
    rng = np.random.default_rng(3)
    velocity, omega, surface = rng.normal(size=(3, 3, 5)) * np.array([12.0, 0.3, 0.1])[:, None, None]
    velocity[0] += 150.0
    thrust, rho = np.full(5, 5e3), np.full(5, 0.7)
    odd_vector, odd_turn = np.array([[1.0], [-1.0], [1.0]]), np.array([[-1.0], [1.0], [-1.0]])
    one = Flow(velocity=velocity, omega=omega, surface=surface, thrust=thrust, rho=rho)
    other = replace(one, velocity=velocity * odd_vector, omega=omega * odd_turn, surface=surface * [[1], [-1], [-1]])
    (force, moment, _), (mirrored, turned, _) = aerodynamics(JET, one), aerodynamics(JET, other)
    np.testing.assert_allclose(mirrored, force * odd_vector, atol=1e-7 * np.abs(force).max())
    np.testing.assert_allclose(turned, moment * odd_turn, atol=1e-7 * np.abs(moment).max())


def test_roll_damping_is_the_sum_over_the_wing() -> None:
    """-2 / (S b^2) times the sum of slope, area and squared distance, for a rate times half the span over V."""
    s, (span, _, *_), level = JET.strips, JET.wing, trim(JET)
    out = np.where(s.normal[:, 2] > 0.5, s.at[:, 1], s.at[:, 2])
    expected = -2.0 / (JET.area * span**2) * np.sum(s.slope * s.area * out**2)
    assert flights.linearised(JET, level)["Cl_p"] == pytest.approx(expected, rel=0.03)


def test_wing_and_tail_stall() -> None:
    level = trim(JET)
    lift = [flights.coefficients(JET, level, {"alpha": a})["CL"] for a in np.radians([0.0, 3.0, 6.0, 20.0])]
    assert lift[1] - lift[0] == pytest.approx(lift[2] - lift[1], rel=0.15)
    assert lift[3] < lift[2]


def test_the_downwash_arrives_when_the_air_does() -> None:
    """A step of lift of the wing alone reaches the tail after the way from wing to tail at V."""
    plane, level = JET, trim(JET)
    step = Effect(
        kind="configuration_change",
        value=0.05,
        onset_s=dict.fromkeys(RECORDS, 1.0),
        parameters={"ramp": 1e-3},
    )
    log = fly(plane, level, quiet(), (step,))
    moment = log["coefficients"][:, 4, 0]
    way = round((plane.wing[2] - plane.tail[2]) / plane.V / STEP_S)
    assert np.ptp(moment[: 100 + way - 1]) < 1e-3  # the wing of the jet is at the centre of gravity
    assert np.diff(moment)[100 + way - 1 : 100 + way + 1].max() > 0.01  # the tail is blown down


def test_turbulence_has_the_spectra_of_dryden() -> None:
    air, gradient = flights._weather(TRAINER, "with gradients", 60_000, 5)
    assert np.std(air, axis=0)[0] == pytest.approx(np.std(air, axis=0)[2], rel=0.35)
    ratio = np.std(gradient[:, 2], axis=0) / np.std(air[:, 2], axis=0)
    expected = np.sqrt(0.8 / (533.0 * 10.4) * (np.pi * 533.0 / (4.0 * 10.4)) ** (1 / 3) * np.pi / 8.0)
    assert ratio == pytest.approx(expected, rel=0.3)
    assert not flights._weather(TRAINER, "uniform", 100, 5)[1].any()


def test_an_autopilot_holds_the_attitude_in_turbulence() -> None:
    level = trim(TRAINER)
    air, gradient = flights._weather(TRAINER, "with gradients", 1001, 4)
    empty = np.zeros((1001, 3, len(RECORDS)))
    roll = {}
    for way in ("open", "autopilot"):
        task = quiet(way, inputs=empty, throttle=empty[:, 0], air=air, gradient=gradient, delayed=True)
        log = fly(TRAINER, level, task, ())
        roll[way] = np.std(angles_of(np.moveaxis(log["x"][:, 6:10], 1, 0))[0])
    assert roll["autopilot"] < 0.3 * roll["open"]


def moved(effect: Effect, servo: np.ndarray) -> np.ndarray:
    """Deflections of the first record behind a linkage, for servo positions (N,) of the effect's surface."""
    at_rest = np.zeros((3, len(RECORDS)))
    linkage, found = Linkage((effect,), at_rest, STEP_S), []
    index = ("delta_e", "delta_a", "delta_r").index(effect.target)
    for k, x in enumerate(servo):
        now = at_rest.copy()
        now[index] = x
        found.append(linkage.moved((k + 1) * STEP_S, now, {"r": np.full(len(RECORDS), 0.5)})[index, 0])
    return np.array(found)


def test_linkages_are_what_they_are_called() -> None:
    t = (np.arange(400) + 1) * STEP_S
    sine = np.sin(2.0 * t)

    def of(kind: str, value: float, **other: object) -> np.ndarray:
        return moved(Effect(kind=kind, target="delta_e", value=value, **other), sine)

    np.testing.assert_allclose(of("input_delay", 0.105)[100:], np.sin(2.0 * (t[100:] - 0.105)), atol=1e-4)
    late = 0.2 * 2.0
    np.testing.assert_allclose(
        of("actuator_lag", 0.2)[200:], (np.sin(2.0 * t - np.arctan(late)) / np.hypot(1.0, late))[200:], atol=0.02
    )
    assert np.abs(np.diff(of("rate_limit", 0.7))).max() == pytest.approx(0.7 * STEP_S)
    np.testing.assert_allclose(of("dead_zone", 0.3), np.sign(sine) * np.maximum(np.abs(sine) - 0.3, 0.0), atol=1e-12)
    assert np.abs(of("backlash", 0.1) - sine).max() == pytest.approx(0.1, abs=1e-3)
    np.testing.assert_allclose(of("feedback", 0.4, term="r"), sine + 0.2)
    lost = of("effectiveness_change", -0.3, onset_s={"m1": 2.005})
    np.testing.assert_allclose(lost, sine * np.where(t > 2.005, 0.7, 1.0))
    held = of("stuck", 1.0, onset_s={"m1": 1.005})
    assert np.ptp(held[100:]) == 0.0 and np.ptp(held[:100]) > 0.5


def test_every_case_has_its_answer_and_the_names_are_sealed() -> None:
    names = {set_name("strips", case, 1) for case in cases_of("strips")}
    assert len(names) == len(cases_of("strips")) == 42
    assert len(ONE) == 24


def test_air_data_come_between_empty_cells_and_all_readings_in_steps() -> None:
    flown = flights.fly_set("one-14", 2)
    every = round(50.0 / flown.conditions["air_data_hz"])
    for record in flown.records.values():
        for name in flights.AIR_DATA:
            assert np.isfinite(record[name][::every]).all()
            assert np.isnan(np.delete(record[name], np.s_[::every])).all()
        for name in ("p", "theta", "ax"):
            steps = record[name] / flown.plane.steps[name]
            np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


@pytest.mark.slow
def test_a_late_vane_of_an_aircraft_of_strips_is_named() -> None:
    flown = flights.fly_set("one-14", 2)
    causes = diagnose(aircraft_of(flown), list(records_of(flown))).causes
    told = {(one.kind, one.target) for cause in causes for one in (cause, *cause.indistinguishable_from)}
    assert ("sensor_delay", "alpha") in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "name", "beside"),
    [
        ("one-5", "dead_zone(delta_a)", ("aero_term", "Cl")),  # its cubic leaves a third, and is refused
        ("one-17", "accelerometer_position(x)", ("data_sign", "ay")),  # in turbulence, where the force nearly vanishes
    ],
)
def test_what_hides_is_named_with_what_it_looks_like(case: str, name: str, beside: tuple[str, str]) -> None:
    records, aircraft, answer = strips.flight(case, 5004)
    found = cs.diagnose(aircraft, records)
    cause = next(one for one in found.causes if one.name == name)
    hidden = answer.hidden[0].value
    assert abs(cause.value - hidden) < 3.0 * cause.std and abs(hidden) > 3.0 * cause.std
    assert beside in [(one["kind"], one["target"]) for one in cause.indistinguishable_from]
