"""Proof of match. Truth: flights simulated with a known actuator lag, which the given aircraft lacks."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.acceptance.conditions import lateral_trim
from casid.acceptance.flown import calibrated_airspeed
from casid.acceptance.tolerances import StandardTest, Tolerance
from casid.cli.options import DEMO
from casid.errors import InputError
from casid.model.flown_records import flown_records

LAG = cs.EffectValue(kind="actuator_lag", target="delta_e", value=0.25, unit="s")
NOISE = {"V": 0.25, "alpha": 2e-3, "q": 8e-4, "theta": 8e-4, "az": 0.07, "ax": 0.02, "altitude": 0.5}
RATE_HZ = 50.0


@pytest.fixture(scope="module")
def given() -> cs.Aircraft:
    return cs.Aircraft.read(DEMO / "aircraft.toml")


def steps(t: np.ndarray, *edges: float) -> np.ndarray:
    """1 and -1 in turn between the edges."""
    total = np.zeros(len(t))
    for sign, (first, after) in zip((1.0, -1.0) * len(edges), zip(edges[:-1], edges[1:], strict=True), strict=False):
        total += sign * ((t >= first) & (t < after))
    return total


def flown(
    truth: cs.Aircraft, duration: float, delta_e: tuple[float, ...], size: float = 0.06, noise: bool = True
) -> cs.Record:
    """A longitudinal flight of an aircraft from trim, with noise on what is measured."""
    level, rng = cs.trim(truth, V=95.0, altitude=2500.0), np.random.default_rng(3)
    t = np.arange(0.0, duration, 1.0 / RATE_HZ)
    channels = {name: np.full(len(t), value) for name, value in level.inputs.items()}
    channels["delta_e"] = channels["delta_e"] + size * steps(t, *delta_e)
    rest = {"V": level.V, "alpha": level.alpha, "theta": level.theta, "altitude": 2500.0}
    blank = {n: np.full(len(t), rest.get(n, 0.0)) for n in (*NOISE, "beta", "p", "r", "phi", "psi")}
    record = cs.Record(name="m", t=t, channels=channels | blank)
    applied = flown_records(truth, [record], "longitudinal", list(NOISE))
    model, ready = applied.model, applied.records[0]
    simulated = cs.simulate(model, ready, model.guess(ready)[0]).as_record("m")
    measured = {n: simulated[n] + noise * rng.normal(0.0, NOISE[n], len(t)) for n in NOISE}
    return record.with_channels(**measured)


@pytest.fixture(scope="module")
def proof(given: cs.Aircraft) -> cs.ProofOfMatch:
    """The given aircraft and the one with the lag, on a flight of the latter."""
    extended = replace(given.with_effects([LAG]), mass=1.0005 * given.mass)
    record = flown(given.with_effects([LAG]), 12.0, (3.0, 4.0, 5.0))
    return cs.proof_of_match(given, record, extended=extended, axes="longitudinal")


def test_the_extended_aircraft_passes_what_the_given_one_fails(proof: cs.ProofOfMatch) -> None:
    (one,) = proof.tests
    assert one.test.id == "2.c.10"
    assert one.sides["as given"].passed is False and one.sides["extended"].passed is True
    assert proof.passed
    assert all(check.used < 0.2 for check in one.sides["extended"].checks)


def test_the_lag_costs_the_tolerances_and_the_mass_none(proof: cs.ProofOfMatch) -> None:
    costs = {cost.part: cost for cost in proof.tests[0].costs}
    assert set(costs) == {"elevator: actuator lag", "mass"}
    assert costs["elevator: actuator lag"].fails and "az" in costs["elevator: actuator lag"].lost
    assert not costs["mass"].lost and not costs["mass"].fails
    without = {c.tolerance.name: c.used for c in proof.tests[0].sides["as given"].checks}
    assert costs["elevator: actuator lag"].used == pytest.approx(without, rel=0.05)


def test_the_manoeuvre_is_where_the_elevator_moves(proof: cs.ProofOfMatch) -> None:
    window = proof.tests[0].window
    assert window.begin == pytest.approx(3.0, abs=0.06)
    assert window.start == pytest.approx(2.0, abs=0.06)


def test_the_result_says_the_paragraph_and_is_json(proof: cs.ProofOfMatch) -> None:
    told = json.loads(json.dumps(proof.to_dict(), allow_nan=False))
    assert told["schema"] == "casid.match/1" and told["passed"] is True and told["closed_loop"] is False
    (test,) = told["tests"]
    assert "2.c.10" in test["paragraph"]
    assert {row["name"] for row in test["sides"]["extended"]["rows"]} == {"theta", "q", "az"}
    assert {one["test"] for one in told["left_out"]} | {"2.c.10"} == set(proof.standard.tests)
    assert "elevator: actuator lag" in str(proof) and "2.c.10" in str(proof)


def test_flight_without_noise_is_matched_to_rounding(given: cs.Aircraft) -> None:
    """Truth: the simulation that made the flight, from the same state."""
    record = flown(given, 12.0, (3.0, 4.0, 5.0), noise=False)
    found = cs.proof_of_match(given, record, axes="longitudinal").tests[0].sides["as given"]
    assert max(check.used for check in found.checks) < 1e-3


def test_a_phugoid_is_measured_and_compared(given: cs.Aircraft) -> None:
    """Drag is twice that of the file in flight: the period stays, the damping does not."""
    draggy = given.with_derivatives({"CD_0": 2.0 * given.derivatives["CD_0"]})
    record = flown(draggy, 150.0, (3.0, 5.0), size=0.03)
    both = cs.proof_of_match(given, record, extended=draggy, axes="longitudinal", tests=["2.c.9"])
    (one,) = both.tests
    by_name = {label: {c.tolerance.quantity: c for c in side.checks} for label, side in one.sides.items()}
    assert by_name["as given"]["period"].passed is True
    assert by_name["as given"]["damping"].passed is False and by_name["as given"]["time_to_half"].passed is False
    assert one.sides["as given"].passed is False and one.sides["extended"].passed is True
    costs = {cost.part: cost for cost in one.costs}
    assert costs["numbers of CD"].fails


def test_closed_loop_corrections_are_small_and_bring_the_attitude_nearer(given: cs.Aircraft) -> None:
    record = flown(given.with_effects([LAG]), 12.0, (3.0, 4.0, 5.0))
    left = {}
    for closed in (False, True):
        side = cs.proof_of_match(given, record, axes="longitudinal", closed_loop=closed).tests[0].sides["as given"]
        left[closed] = side.checks[0].used
        assert bool(side.flown.corrections) is closed
    assert 0.0 < np.abs(side.flown.corrections["delta_e"]).max() <= np.radians(1.0) + 1e-12
    assert left[True] < left[False]


def test_of_two_identical_aircraft_closed_loop_corrects_nothing(given: cs.Aircraft) -> None:
    record = flown(given, 12.0, (3.0, 4.0, 5.0), noise=False)
    side = cs.proof_of_match(given, record, axes="longitudinal", closed_loop=True).tests[0].sides["as given"]
    assert np.abs(side.flown.corrections["delta_e"]).max() < 1e-5


def test_a_time_that_is_given_is_where_it_is_compared(given: cs.Aircraft) -> None:
    record = flown(given, 12.0, (3.0, 4.0, 5.0))
    (one,) = cs.proof_of_match(given, record, axes="longitudinal", tests={"2.c.4": (2.0, 9.0)}).tests
    assert (one.window.start, one.window.end) == (2.0, 9.0)
    assert {"calibrated_airspeed", "altitude", "theta"} == set(one.flight.curves)
    assert one.passed is True
    assert any("20 s" in said for said in one.shortfalls)  # 5 s before the change and 15 s after it


@pytest.mark.parametrize(
    ("tests", "named"),
    [
        (["2.c.99"], "2.c.9"),
        (["2.d.2"], "aileron input"),
        ({"2.c.4": (2.0, 90.0)}, "90"),
        ({"2.c.4": (-0.5, 9.0)}, "not in the record"),
        ({"2.c.4": (2.0, 12.1)}, "not in the record"),
        ({"2.c.4": (9.0, 2.0)}, "not in the record"),
        ({"2.c.4": (4.0, 4.0)}, "not in the record"),
        ({"2.c.4": (1.0, 2.0, 3.0)}, "start, end"),
        (["2.c.4"], "give its time"),
        ("2.c.10", "list"),
        ({"2.c.4": 3.0}, "start, end"),
    ],
)
def test_what_cannot_be_compared_is_said(given: cs.Aircraft, tests: object, named: str) -> None:
    record = flown(given, 12.0, (3.0, 4.0, 5.0))
    with pytest.raises(InputError) as caught:
        cs.proof_of_match(given, record, axes="longitudinal", tests=tests)  # pyright: ignore
    assert named in str(caught.value) and "\n" not in str(caught.value)


def test_calibrated_airspeed() -> None:
    """Truth: true airspeed at sea level; equivalent airspeed at low Mach numbers; 271.0 kt at Mach 0.8, 35 000 ft (by
    hand from the isentropic formula with p = 23 842 Pa, T = 218.8 K)."""
    one = np.ones(1)
    assert calibrated_airspeed(100.0 * one, 1.225 * one, 0.0 * one)[0] == pytest.approx(100.0, rel=1e-6)
    assert calibrated_airspeed(30.0 * one, 0.9 * one, 3000.0 * one)[0] == pytest.approx(
        30.0 * np.sqrt(0.9 / 1.225), rel=1e-3
    )
    pressure, temperature = 23842.0, 218.808
    V, rho = 0.8 * np.sqrt(1.4 * 287.05287 * temperature), pressure / (287.05287 * temperature)
    found = calibrated_airspeed(V * one, rho * one, 10668.0 * one)[0]
    impact = pressure * ((1.0 + 0.2 * 0.64) ** 3.5 - 1.0)
    by_hand = 340.294 * np.sqrt(5.0 * ((impact / 101325.0 + 1.0) ** (2.0 / 7.0) - 1.0))
    assert found == pytest.approx(by_hand, rel=1e-3)
    assert found * 3600.0 / 1852.0 == pytest.approx(271.0, abs=1.0)


def lateral_flight(truth: cs.Aircraft, duration: float) -> cs.Record:
    """A rudder doublet from 2 to 4 s and what follows, without noise."""
    level, t = cs.trim(truth, V=95.0, altitude=2500.0), np.arange(0.0, duration, 1.0 / RATE_HZ)
    channels = {name: np.full(len(t), value) for name, value in level.inputs.items()}
    channels["delta_r"] = 0.05 * steps(t, 2.0, 3.0, 4.0)
    model = cs.aircraft_model(truth)
    return cs.simulate(model, cs.Record(name="d", t=t, channels=channels), level.state).as_record("d")


def test_a_dutch_roll_is_measured_and_compared(given: cs.Aircraft) -> None:
    """Less damping in yaw in flight than in the file, and more weathercock stability: damping and period fail."""
    truth = given.with_derivatives(
        {"Cn_beta": 1.5 * given.derivatives["Cn_beta"], "Cn_r": 0.2 * given.derivatives["Cn_r"]}
    )
    found = cs.proof_of_match(given, lateral_flight(truth, 60.0), extended=truth, tests=["2.d.7"])
    (one,) = found.tests
    checks = {c.tolerance.quantity: c for c in one.sides["as given"].checks}
    assert checks["period"].flight is not None and checks["period"].flight.cycles > 6.0
    assert checks["period"].passed is False and checks["damping"].passed is False
    assert one.sides["extended"].passed is True
    assert {cost.part: cost.fails for cost in one.costs} == {"numbers of Cn": True}


def test_a_short_dutch_roll_is_not_judged(given: cs.Aircraft) -> None:
    proof = cs.proof_of_match(given, lateral_flight(given, 15.0), tests=["2.d.7"])
    assert proof.tests[0].passed is None and "6" in proof.tests[0].sides["as given"].checks[0].why
    assert not proof.passed  # nor is it proved


def test_an_effect_of_another_size_goes_back_to_that(given: cs.Aircraft) -> None:
    """Truth: the given aircraft, flown by itself."""
    short, long = (given.with_effects([replace(LAG, value=value)]) for value in (0.1, 0.25))
    (one,) = cs.proof_of_match(short, flown(long, 12.0, (3.0, 4.0, 5.0)), extended=long, axes="longitudinal").tests
    (cost,) = one.costs
    assert cost.used == pytest.approx({c.tolerance.name: c.used for c in one.sides["as given"].checks})


def test_axes_without_aerodynamics_are_as_measured(given: cs.Aircraft) -> None:
    pitch_only = replace(
        given,
        derivatives={n: v for n, v in given.derivatives.items() if n[:2] in ("CL", "CD", "Cm")},
        terms={"CD": {"alpha^2": given.terms["CD"]["alpha^2"]}},
    )
    record = flown(given, 12.0, (3.0, 4.0, 5.0))
    assert cs.proof_of_match(pitch_only, record).tests[0].axes == "longitudinal"
    assert cs.proof_of_match(given, record).tests[0].axes == "full"


def test_heading_goes_on_past_a_full_turn(given: cs.Aircraft) -> None:
    """A record whose heading jumps from pi to -pi is the same flight."""
    row = Tolerance(channel="psi", absolute=0.1, unit="rad")
    heading = StandardTest(id="H", title="", manoeuvre="rudder input", paragraph="1", tolerances=(row,))
    table = cs.Standard(name="", edition="", source="", tests={"H": heading})
    record = lateral_flight(given, 15.0)
    record = record.with_channels(psi=3.1 + 0.1 * np.sin(record.t))
    jumps = record.with_channels(psi=np.angle(np.exp(1j * record["psi"])))
    assert np.abs(np.diff(jumps["psi"])).max() > 6.0
    checks = [
        cs.proof_of_match(given, one, tolerances=table).tests[0].sides["as given"].checks[0] for one in (record, jumps)
    ]
    assert checks[1].used == pytest.approx(checks[0].used, rel=1e-6)


@pytest.mark.slow
def test_the_demo_passes_once_its_lag_is_known() -> None:
    """The embedded flight, whose lag is found from three records, on the fourth."""
    aircraft = cs.Aircraft.read(DEMO / "aircraft.toml")
    records = [cs.read_record(DEMO / f"m{i}.csv") for i in (1, 2, 3, 4)]
    found = cs.diagnose(aircraft, records[:3], hold_out=records[3:])
    assert isinstance(found, cs.Diagnosis)
    proof = cs.proof_of_match(aircraft, records[3], extended=found.extended_aircraft)
    short_period = [one for one in proof.tests if one.test.id == "2.c.10"]
    assert short_period and all(one.sides["as given"].passed is False for one in short_period)
    assert all(one.sides["extended"].passed is True for one in proof.tests)
    assert any("actuator lag" in cost.part and cost.fails for one in short_period for cost in one.costs)


def rows_of(one: cs.MatchedTest) -> dict[str, bool | None]:
    return {condition.name: condition.met for condition in one.conditions}


@pytest.mark.parametrize(("name", "met"), [("X, approach", False), ("X, cruise", True), ("X", None)])
def test_a_file_of_another_configuration_proves_nothing(given: cs.Aircraft, name: str, met: bool | None) -> None:
    """The short period is flown in cruise (table A2A, 2.c.10); the flight is the simulation's own, within tolerance."""
    own = replace(given, name=name)
    proof = cs.proof_of_match(own, flown(given, 12.0, (3.0, 4.0, 5.0), noise=False), axes="longitudinal")
    assert rows_of(proof.tests[0])["configuration"] is met
    assert proof.passed is (met is not False)


def test_conditions_of_the_flight_are_looked_at(given: cs.Aircraft) -> None:
    """Rudder 2 deg off its trim, a roll rate before the input, an airspeed that the file is not of."""
    record = flown(given, 12.0, (3.0, 4.0, 5.0), noise=False)
    assert cs.proof_of_match(given, record, axes="longitudinal").passed
    ones = np.ones(len(record))
    rudder = record.with_channels(delta_r=np.radians(2.0) * ones)
    rolling = record.with_channels(p=np.radians(5.0) * ones)
    slower = replace(given, trim={**given.trim, "V": 60.0})
    for aircraft, flight, said in (
        (given, rudder, "rudder before the input"),
        (given, rolling, "steady flight before the input"),
        (slower, record, "airspeed"),
    ):
        proof = cs.proof_of_match(aircraft, flight, axes="longitudinal")
        assert [one.name for one in proof.tests[0].unmet] == [said]
        assert not proof.passed and said in str(proof)


def test_controls_are_compared_with_the_trim_of_the_file(given: cs.Aircraft) -> None:
    """Truth: the two equations of roll and yaw, put back."""
    uneven = given.with_derivatives({"Cl_0": 1e-3, "Cn_0": -2e-3})
    trim = lateral_trim(uneven)
    for row in ("Cl", "Cn"):
        left = sum(uneven.derivatives[f"{row}_{name}"] * trim[name] for name in trim) + uneven.derivatives[f"{row}_0"]
        assert left == pytest.approx(0.0, abs=1e-12)


def diagnosed(folder, extended: cs.Aircraft, fitted: str, held_out: str) -> None:
    """A folder as `casid diagnose` writes it."""
    folder.mkdir()
    extended.write(folder / "extended.toml")
    sentence = "The elevator follows its command with a lag of 0.25 s."
    cause = {"name": "actuator_lag(delta_e)", "sentence": sentence, "probability": 0.97, "records": [fitted]}
    gain = {"held_out": {"records": [held_out], "rms_ratio": {"q": 0.2, "theta": 0.1}}}
    told = {"schema": "casid.diagnosis/3", "causes": [cause], "gain": gain, "notes": {fitted: []}}
    (folder / "diagnosis.json").write_text(json.dumps(told))


def test_a_test_out_of_tolerance_has_its_rationale(given: cs.Aircraft, tmp_path) -> None:
    """Cause, change, the same test, records that no fit used, and every other test again."""
    truth = given.with_effects([LAG])
    diagnosed(tmp_path / "out", truth, "other", "m")
    record = flown(truth, 12.0, (3.0, 4.0, 5.0))
    proof = cs.proof_of_match(given, record, diagnosis=tmp_path / "out", axes="longitudinal")
    (one,) = proof.tests
    assert one.fitted is False
    rationale = proof.to_dict()["tests"][0]["rationale"]
    assert rationale["accepted"] is True and len(rationale["differs"]) >= 1
    assert "lag of 0.25 s" in " ".join(rationale["why"]) and "0.25" in " ".join(rationale["changed"])
    assert "No fit used this record" in rationale["proof"][0] and "theta 0.10" in rationale["proof"][1]


@pytest.mark.parametrize("fitted", [True, False])
def test_a_proof_says_of_how_many_records_the_diagnosis_was_fitted(given: cs.Aircraft, tmp_path, fitted: bool) -> None:
    names = ("m", "other") if fitted else ("other", "m")
    diagnosed(tmp_path / "out", given.with_effects([LAG]), *names)
    proof = cs.proof_of_match(
        given, flown(given, 12.0, (3.0, 4.0, 5.0)), diagnosis=tmp_path / "out", axes="longitudinal"
    )
    assert ("1 test was flown in records that the diagnosis fitted" in proof.sentence) is fitted
    assert ("that the diagnosis fitted" in proof.sentence) is fitted


def test_a_change_that_loses_another_test_is_not_accepted(given: cs.Aircraft) -> None:
    """The lag is right and brings one flight into tolerance; a flight without lag was in tolerance, and is lost."""
    truth = given.with_effects([LAG])
    lagging, prompt = (replace_name(flown(one, 12.0, (3.0, 4.0, 5.0)), n) for one, n in ((truth, "a"), (given, "b")))
    proof = cs.proof_of_match(given, [lagging, prompt], extended=truth, axes="longitudinal")
    assert [one.record.name for one in proof.lost] == ["b"] and not proof.passed
    rationale = proof.to_dict()["tests"][0]["rationale"]
    assert rationale["accepted"] is False and "b" in rationale["proof"][2]


def replace_name(record: cs.Record, name: str) -> cs.Record:
    return cs.Record(name=name, t=record.t, channels=dict(record.channels), hold=record.hold)


def test_a_folder_without_a_diagnosis_is_refused(given: cs.Aircraft, tmp_path) -> None:
    with pytest.raises(InputError, match=r"diagnosis\.json"):
        cs.proof_of_match(given, flown(given, 12.0, (3.0, 4.0, 5.0)), diagnosis=tmp_path)
