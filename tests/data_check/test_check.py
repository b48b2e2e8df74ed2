"""The check of flight data. Truth: the fault that was put into flights of the Do 328 with noise, and real flights that
have none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import permutations, product

import numpy as np
import pytest
from scipy import signal

import casid as cs
from casid.data_check.reading import Finding
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.airframe import INERTIAS, Inertia
from casid.records.readers import read_records
from casid.records.record import Record
from casid.signals import SURFACES, unit_of
from problems.blind.sets import fly_set
from problems.every_problem import DEMO
from problems.faults.fault import DataFault, with_fault
from problems.faults.flights import REAL, real_flight
from problems.faults.score import score

DEG = float(np.pi / 180.0)
BOTH = ("m1", "m2")


clean = cache(fly_set)


@pytest.fixture(scope="module")
def flown() -> tuple[Aircraft, tuple[Record, ...]]:
    one = clean("do328", "clean-1", 1)
    return one.aircraft, one.records[:2]


def hold(*starts: float, seconds: float = 0.5) -> dict[str, tuple[tuple[float, float], ...]]:
    return {"m1": tuple((start, start + seconds) for start in starts)}


FAULTS = [
    DataFault(kind="data_sign", target="q", records=("m1",)),
    DataFault(kind="data_sign", target="az", records=BOTH),
    DataFault(kind="data_gravity", target="az", records=BOTH),
    DataFault(kind="data_gravity", target="az", records=("m2",)),
    DataFault(kind="data_unit", target="V", records=BOTH, value=1852.0 / 3600.0),
    DataFault(kind="data_unit", target="p+q+r", records=BOTH, value=DEG),
    DataFault(kind="data_unit", target="delta_e", records=BOTH, value=DEG),
    DataFault(kind="data_unit", target="t", records=BOTH, value=5.0),
    DataFault(kind="data_swap", target="alpha+beta", records=BOTH),
    DataFault(kind="data_swap", target="delta_a+delta_r", records=BOTH),
    DataFault(kind="data_stuck", target="beta", records=("m1",), intervals={"m1": ((-1.0, 99.0),)}),
    DataFault(kind="data_dropout", target="V+alpha+beta", records=("m1",), intervals=hold(3.0, 8.0, 12.0, 19.0)),
    DataFault(kind="data_clipped", target="q", records=("m1",), value=0.5),
    DataFault(kind="data_spikes", target="az", records=("m1",), value=0.01),
]
MORE_FAULTS = [  # a campaign
    DataFault(kind="data_sign", target="ay", records=BOTH),
    DataFault(kind="data_sign", target="delta_e", records=("m1",)),
    DataFault(kind="data_unit", target="V", records=BOTH, value=0.3048),
    DataFault(kind="data_unit", target="q", records=BOTH, value=DEG),
    DataFault(kind="data_unit", target="ax+ay+az", records=BOTH, value=9.80665),
    DataFault(kind="data_unit", target="rho", records=BOTH, value=515.3788184),
    DataFault(kind="data_unit", target="thrust", records=BOTH, value=1000.0),
    DataFault(kind="data_unit", target="t", records=BOTH, value=1e-3),
    DataFault(kind="data_swap", target="p+r", records=("m2",)),
    DataFault(kind="data_spikes", target="ax", records=("m1",), value=0.003, term="code"),
]
EVERY_FAULT = [*FAULTS, *(pytest.param(fault, marks=pytest.mark.slow) for fault in MORE_FAULTS)]


@pytest.mark.parametrize("fault", EVERY_FAULT, ids=lambda f: f"{f.kind}-{f.target}-{f.value}-{len(f.records)}")
def test_every_fault_is_found_and_mended(fault: DataFault, flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """Named, in the right records, and nothing else; what was corrected is what was flown."""
    aircraft, records = flown
    checked = cs.check(with_fault(fault, records, seed=3), aircraft)
    assert score(fault, checked.findings) == "found", checked
    if fault.kind in ("data_sign", "data_gravity", "data_unit", "data_swap"):
        for mended, healthy in zip(checked.records, records, strict=True):
            for name in ("t", *healthy.channels):
                assert np.allclose(mended[name], healthy[name], rtol=0.11 if fault.target == "t" else 1e-9, atol=1e-9)


ANGLES, RATES = ("alpha", "beta", "phi", "theta"), ("p", "q", "r")
DRAWN = (("jsbsim", "clean-2", 6), ("independent", "clean-1", 5), ("strips", "clean-1", 5))  # a campaign


@pytest.mark.parametrize(
    ("flight", "channel"),
    [
        *product([("do328", "clean-1", 1)], (*ANGLES, *RATES)),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in product(DRAWN, (*ANGLES, "psi", *RATES))),
    ],
    ids=str,
)
def test_one_channel_in_degrees_beside_others_in_radians(flight: tuple[str, str, int], channel: str) -> None:
    """Also where an exchange with another channel explains much of an angle that is 57 times too large. The header
    states radians; or degrees, from which the angles were converted twice, so that no aircraft has them."""
    healthy = clean(*flight)
    for stated in (unit_of(channel), *(("deg",) if channel in ("alpha", "beta", "theta") else ())):
        turned = [
            replace(r, channels={**r.channels, channel: r[channel] / DEG}, stated={channel: stated})
            for r in healthy.records[:2]
        ]
        (found,) = cs.check(turned, healthy.aircraft).findings
        assert (found.kind, found.target, found.handled) == ("data_unit", channel, "corrected")


def test_an_exchange_that_leaves_an_angle_no_aircraft_has_is_none(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """An angle of attack of 115 deg is no sideslip angle either."""
    aircraft, records = flown
    turned = [r.with_channels(alpha=np.where(r.t < 5.0, 2.0, r["beta"]), beta=r["alpha"]) for r in records]
    assert ("data_swap", "alpha+beta") not in kinds(cs.check(turned, aircraft).findings)


def test_a_surface_against_one_derivative_of_the_file_is_told_with_its_rival(
    flown: tuple[Aircraft, tuple[Record, ...]],
) -> None:
    """When the aileron is reversed in every record, and the file knows what it does from one derivative alone, record
    and file are as likely to be wrong: nothing is changed."""
    aircraft, records = flown
    alone = aircraft.with_derivatives({"Cn_delta_a": 0.0, "CY_delta_a": 0.0})
    fault = DataFault(kind="data_sign", target="delta_a", records=BOTH)
    checked = cs.check(with_fault(fault, records, seed=3), alone)
    (finding,) = checked.findings
    assert finding.handled == "reported"
    told = [(finding.kind, finding.target), *((r["kind"], r["target"]) for r in finding.indistinguishable_from)]
    assert ("data_sign", "delta_a") in told and ("file_sign", "Cl_delta_a") in told
    assert np.array_equal(checked.records[0]["delta_a"], -records[0]["delta_a"])


def test_undone_the_records_stay_as_they_are(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    aircraft, records = flown
    given = with_fault(DataFault(kind="data_sign", target="q", records=BOTH), records, seed=3)
    checked = cs.check(given, aircraft, undo=True)
    assert [one.handled for one in checked.findings] == ["reported"]
    assert all(a is b for a, b in zip(checked.records, given, strict=True))


def test_clean_flights_keep_quiet(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    aircraft, records = flown
    checked = cs.check(records, aircraft)
    assert checked.clean and "No fault" in str(checked)
    assert set(checked.to_dict()["channels"]) >= {"V", "alpha", "delta_e"}


@pytest.mark.parametrize("lacks", ["beta", "alpha"])
def test_motion_that_is_not_measured_is_no_surface_reversed(lacks: str) -> None:
    """The demonstration, whose rudder makes sideslip and whose elevator incidence: without that channel what it does
    would be taken for the surface's, and the rudder of m1 for reversed. A surface of the other axis is found all the
    same."""
    aircraft = Aircraft.read(DEMO / "aircraft.toml")
    records = [one.without(lacks) for one in read_records([DEMO / "m[12].csv"])]
    assert not cs.check(records, aircraft).findings
    other = "delta_e" if lacks == "beta" else "delta_a"
    reversed_ = [records[0].with_channels(**{other: -records[0][other]}), *records[1:]]
    assert [(f.kind, f.target, f.records) for f in cs.check(reversed_, aircraft).findings] == [
        ("data_sign", other, ("m1",))
    ]


@pytest.mark.parametrize("slope", [-0.2, 0.2])
def test_a_vane_that_reads_a_part_of_the_other_angle_reverses_no_surface(slope: float) -> None:
    """Where the elevator hardly moves, the incidence that sideslip adds to the reading made pitching moments that the
    elevator, reversed, explained better, in two of four records."""
    pytest.importorskip("jsbsim")
    flight = clean("jsbsim", "clean-2", 1801)
    read = [one.with_channels(alpha=one["alpha"] + slope * one["beta"]) for one in flight.records]
    assert not cs.check(read, flight.aircraft).findings


def in_axes(record: Record, turn: np.ndarray, euler: Sequence[float] | None = None) -> Record:
    """The record of an inertial unit whose axes are the rows of `turn`, with attitude of that body in NWU."""
    triads = (("p", "q", "r"), ("ax", "ay", "az"), ("pdot", "qdot", "rdot"))
    there = [names for names in triads if set(names) <= record.channels.keys()]
    changed = {n: v for names in there for n, v in zip(names, turn @ [record[n] for n in names], strict=True)}
    attitude = zip(("phi", "theta", "psi"), euler or (), strict=False)
    return record.with_channels(**changed, **{n: sign * record[n] for n, sign in attitude if n in record})


FLU = np.diag([1.0, -1.0, -1.0])
ROTATIONS = [
    np.array([s * row for s, row in zip(signs, np.eye(3)[list(order)], strict=True)])
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
]
PROPER = [one for one in ROTATIONS if np.linalg.det(one) > 0.0 and not np.allclose(one, np.eye(3))]


@pytest.mark.parametrize(
    ("of", "turn"),
    [
        *(("do328", turn) for turn in (PROPER[7], PROPER[15], FLU)),
        ("independent", PROPER[15]),
        *(pytest.param("independent", turn, marks=pytest.mark.slow) for turn in (PROPER[7], FLU)),
    ],
    ids=str,
)
def test_turned_frames_are_axes_and_nothing_else(of: str, turn: np.ndarray) -> None:
    """A rotation of the inertial unit by quarter turns: one fault, converted, or refused; no single channel is."""
    flight = clean(of, "clean-1", 3001)
    for attitude in [None, (1.0, -1.0, -1.0)] if turn is FLU else [None]:
        checked = cs.check([in_axes(one, turn, attitude) for one in flight.records], flight.aircraft)
        corrected = [one for one in checked.findings if one.handled == "corrected"]
        assert checked.findings and {one.kind for one in corrected} <= {"axes"}
        for mended, healthy in zip(checked.records if corrected else (), flight.records, strict=bool(corrected)):
            for name in ("p", "q", "r", "ax", "ay", "az", "theta"):
                assert np.allclose(mended[name], healthy[name])


@pytest.mark.parametrize("turn", PROPER, ids=str)
@pytest.mark.slow
def test_every_turn_of_the_inertial_unit_is_axes(turn: np.ndarray) -> None:
    for flight in (clean("independent", "clean-1", 3002), clean("do328", "clean-4", 1803)):
        checked = cs.check([in_axes(one, turn) for one in flight.records], flight.aircraft)
        assert checked.findings
        assert {one.kind for one in checked.findings if one.handled == "corrected"} <= {"axes"}


def test_heading_from_east_and_forces_of_the_other_sign_are_axes() -> None:
    flight = clean("independent", "clean-1", 3001)
    aircraft, records = flight.aircraft, flight.records
    east = [one.with_channels(psi=0.5 * np.pi - one["psi"]) for one in records]
    (found,) = cs.check(east, aircraft).findings
    assert (found.kind, found.target, found.term, found.handled) == ("axes", "earth", "ENU", "corrected")
    felt = [one.with_channels(**{n: -one[n] for n in ("ax", "ay", "az")}) for one in records]
    checked = cs.check(felt, aircraft)
    assert [(one.kind, one.target, one.handled) for one in checked.findings] == [("axes", "body", "corrected")]
    assert np.allclose(checked.records[0]["az"], records[0]["az"])


def placed(record: Record, arm: Sequence[float]) -> Record:
    """What an accelerometer at `arm` [m] from the c.g. reads: a + omega_dot x arm + omega x (omega x arm)."""
    omega = np.stack([record[name] for name in "pqr"], axis=1)
    turning = signal.savgol_filter(omega, 9, 2, deriv=1, delta=record.dt, axis=0)
    sensed = np.cross(turning, arm) + np.cross(omega, np.cross(omega, arm))
    return record.with_channels(**{n: record[n] + sensed[:, i] for i, n in enumerate(("ax", "ay", "az"))})


@pytest.mark.parametrize("arm", [(2.0, 0.0, 0.0), (-2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0), (0.0, 0.0, -2.0)])
def test_an_accelerometer_away_from_the_cg_is_corrected_in_no_other_way(arm: tuple[float, ...]) -> None:
    """A light aircraft of the independent simulator: 2 m ahead made the lateral acceleration reversed, at 1e6 to 1."""
    flight = clean("independent", "clean-1", 3002)
    checked = cs.check([placed(one, arm) for one in flight.records], flight.aircraft)
    assert not [one for one in checked.findings if one.handled != "reported"] and not checked.doubts


def test_a_sign_competes_with_the_place_of_the_instrument() -> None:
    """An instrument stays where it is. Reversed in one record of five, the lateral acceleration has the wrong sign; in
    all of them a place of the accelerometer explains it, too, and nothing is corrected without saying so."""
    flight = clean("independent", "clean-1", 3002)
    reversed_ = [one.with_channels(ay=-one["ay"]) for one in flight.records]
    (one,) = cs.check([reversed_[0], *flight.records[1:]], flight.aircraft).findings
    assert (one.kind, one.target, one.records, one.handled) == ("data_sign", "ay", ("m1",), "corrected")
    (every,) = cs.check(reversed_, flight.aircraft).findings
    assert (every.kind, every.target, every.handled) == ("data_sign", "ay", "reported")
    assert "accelerometer_position" in [other["kind"] for other in every.indistinguishable_from]


@pytest.mark.parametrize("drift", [0.007, 0.014])
def test_a_clock_that_drifts_is_no_unit(drift: float) -> None:
    """An inertial unit that is 0.35 s late at the end: a lateral acceleration in ft/s2 made more of it fit."""
    flight = clean("do328", "clean-4", 1803)
    fault = DataFault(kind="clock_drift", target="inertial", records=("m1", "m2", "m3", "m4"), value=drift)
    assert not cs.check(with_fault(fault, flight.records, 1803), flight.aircraft).findings


@pytest.mark.parametrize("name", REAL)
def test_real_flights_keep_quiet(name: str, flight_data) -> None:
    """ATTAS, HFB-320, and the corrected records of a Twin Otter and a Tu-144."""
    flight = real_flight(name, flight_data.parent)
    assert not cs.check(flight.records, flight.aircraft).findings


def test_without_an_aircraft_and_with_few_channels_nothing_is_made_up(
    flown: tuple[Aircraft, tuple[Record, ...]],
) -> None:
    _, records = flown
    few = [Record(name=r.name, t=r.t, channels={n: r[n] for n in ("delta_e", "q", "theta")}) for r in records]
    assert not cs.check(few).findings
    turned = [r.with_channels(q=np.degrees(r["q"])) for r in few]
    assert kinds(cs.check(turned).findings) == [("data_unit", "q")]


def kinds(findings: Sequence[Finding]) -> list[tuple[str, str]]:
    return [(one.kind, one.target) for one in findings]


def test_nothing_to_check_is_an_input_error() -> None:
    with pytest.raises(InputError, match="no record was given"):
        cs.check([])


# -- the aircraft file -------------------------------------------------------------------------------------------------

POUND, FOOT = 0.45359237, 0.3048
ANGLES = ("alpha", "beta", "delta_e", "delta_a", "delta_r")


def scaled_inertia(aircraft: Aircraft, factor: float) -> Inertia:
    return Inertia(**{name: factor * getattr(aircraft.inertia, name) for name in INERTIAS})


def per_degree(aircraft: Aircraft) -> Aircraft:
    by_angle = {n: v for n, v in aircraft.derivatives.items() if n.split("_", 1)[1] in ANGLES}
    return aircraft.with_derivatives({name: DEG * value for name, value in by_angle.items()})


FILES = {
    "mass": lambda a: replace(a, mass=a.mass / POUND),
    "area": lambda a: replace(a, area=a.area / FOOT**2),
    "inertia": lambda a: replace(a, inertia=scaled_inertia(a, 1.0 / (POUND * FOOT**2))),
    "lateral lengths": lambda a: replace(
        a,
        moment_length_lateral=a.moment_length_lateral / FOOT,
        rate_length_lateral=a.rate_length_lateral / FOOT,
    ),
    "derivatives": per_degree,
}


@pytest.mark.parametrize("parameter", FILES)
def test_a_number_of_the_file_in_another_unit_is_told(
    parameter: str, flown: tuple[Aircraft, tuple[Record, ...]]
) -> None:
    """By flight: the data are well, and so is the file as it was."""
    aircraft, records = flown
    checked = cs.check(records, FILES[parameter](aircraft))
    assert not checked.findings and not checked.clean
    assert checked.doubts[0].parameter == parameter, str(checked)
    assert "Aircraft file: " in str(checked) and checked.to_dict()["file"][0]["parameter"] == parameter


def test_a_unit_of_the_file_and_a_reversed_surface_are_not_confused(
    flown: tuple[Aircraft, tuple[Record, ...]],
) -> None:
    aircraft, records = flown
    checked = cs.check(with_fault(DataFault(kind="data_sign", target="delta_e", records=BOTH), records, 3), aircraft)
    assert kinds(checked.findings) == [("data_sign", "delta_e")] and not checked.doubts


def test_surfaces_that_never_move_leave_nothing_to_identify(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    aircraft, records = flown
    still = [r.with_channels(**{name: np.full(len(r), r[name][0]) for name in SURFACES}) for r in records]
    (finding,) = cs.check(still, aircraft).findings
    assert (finding.kind, finding.handled) == ("data_stuck", "reported") and "No surface moves" in finding.sentence


def test_density_and_thrust_are_known_without_a_trim(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """Air is between sea level and the stratosphere, thrust a part of the weight."""
    aircraft, records = flown
    bare = replace(aircraft, trim={})
    turned = [r.with_channels(rho=r["rho"] / 515.3788184, thrust=r["thrust"] / 1000.0) for r in records]
    found = cs.check(turned, bare)
    assert sorted(kinds(found.findings)) == [("data_unit", "rho"), ("data_unit", "thrust")]


def test_an_angle_is_told_in_degrees(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """Frozen at 0.1 rad, which is 5.73 deg; the number for a program stays in rad."""
    record = flown[1][0]
    beta = np.where(record.t > 5.0, 0.1, record["beta"])
    (one,) = cs.check([record.with_channels(beta=beta)]).findings
    assert one.kind == "data_stuck" and "frozen at 5.73 deg in" in one.sentence
    assert one.value == pytest.approx(0.1) and one.unit == "rad"


# -- what outsiders met ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("without", "surface"), [((), "delta_e"), (("rho",), "delta_r"), (("rho", "altitude"), "delta_e")], ids=str
)
def test_a_surface_of_the_other_sign_is_the_first_line(
    without: tuple[str, ...], surface: str, flown: tuple[Aircraft, tuple[Record, ...]]
) -> None:
    """Also where density is not recorded, but known from the trim of the file."""
    aircraft, records = flown
    flipped = [r.with_channels(**{surface: -r[surface]}).without(*without) for r in records]
    checked = cs.check(flipped, aircraft)
    assert kinds(checked.findings) == [("data_sign", surface)]
    assert str(checked).startswith(f"- {surface}: sign convention opposite to the file")
    assert "were" not in str(checked).splitlines()[0]  # a check changes no file
    assert not cs.check([r.without(*without) for r in records], aircraft).findings


@pytest.mark.parametrize("knows", [True, False])
def test_lateral_acceleration_of_the_other_sign_without_a_vane(
    knows: bool, flown: tuple[Aircraft, tuple[Record, ...]]
) -> None:
    """Side force opposes sideslip, which p, r and the bank angle make."""
    aircraft, records = flown
    bare = [r.without("beta") for r in records]
    file = aircraft if knows else None
    assert not cs.check(bare, file).findings
    turned = [r.with_channels(ay=-r["ay"]) for r in bare]
    assert kinds(cs.check(turned, file).findings) == [("data_sign", "ay")]


@pytest.mark.parametrize("without", [(), ("phi", "theta"), ("ay", "alpha", "beta")], ids=str)
def test_accelerations_in_g(without: tuple[str, ...], flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """All axes of an accelerometer at once, also in one record alone and without attitude or vanes."""
    record = flown[1][0].without(*without)
    axes = [name for name in ("ax", "ay", "az") if name in record]
    in_g = record.with_channels(**{name: record[name] / 9.80665 for name in axes})
    (found,) = cs.check([in_g]).findings
    assert (found.target, found.handled) == ("+".join(axes), "corrected")
    one_axis = record.with_channels(az=record["az"] / 9.80665)
    assert "ax" not in {n for one in cs.check([one_axis]).findings if one.handled == "corrected" for n in one.target}


def test_altitude_in_feet_without_density() -> None:
    """The demonstration: the density of the altitude cannot carry the aircraft."""
    aircraft, records = Aircraft.read(DEMO / "aircraft.toml"), read_records([DEMO / "m[12].csv"])
    feet = [r.with_channels(altitude=r["altitude"] / FOOT).without("rho") for r in records]
    assert kinds(cs.check(feet, aircraft).findings) == [("data_unit", "altitude")]


def test_two_kinds_of_correction_in_one_channel_are_refused(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """A vertical acceleration that is reversed and in g beside a reversed pitch rate: told, and left as it is."""
    aircraft, records = flown
    both = [r.with_channels(az=-r["az"] / 9.80665, q=-r["q"]) for r in records]
    checked = cs.check(both, aircraft)
    of_az = [one for one in checked.findings if "az" in one.target]
    assert of_az and all(one.handled == "reported" for one in of_az), checked
    assert all(np.array_equal(a["az"], b["az"]) for a, b in zip(checked.records, both, strict=True))
    assert all(np.array_equal(np.abs(a["q"]), np.abs(b["q"])) for a, b in zip(checked.records, both, strict=True))


@pytest.mark.parametrize("seed", [1, 2, 8])
def test_a_flow_angle_that_hardly_moves_is_as_it_was_recorded(seed: int) -> None:
    """Ordinary errors of a vane, as by its place and by upwash, make what a small angle lacks: that says nothing of the
    angle. Truth: rates and specific forces of a turn from the equations of motion, with a sideslip that dies away."""
    rng = np.random.default_rng(seed)
    t, V, theta = np.arange(0.0, 25.0, 0.04), 80.0, 0.078
    quick = rng.uniform(1.0, 2.5)
    banked = np.interp(t, [0, 2, 5, 9, 12, 25], np.array([0.0, 0.0, 0.5, 0.2, 0.0, 0.1]) * rng.uniform(0.6, 1.2))
    phi = np.convolve(np.pad(banked, 12, mode="edge"), np.ones(25) / 25, "valid")
    beta = rng.uniform(0.01, 0.05) * np.sin(quick * t + rng.uniform(0.0, 6.0)) * np.exp(-(((t - 8.0) / 6.0) ** 2))
    alpha = 0.078 + 0.006 * (1.0 / np.cos(phi) - 1.0)
    turn = 9.81 * np.tan(phi) / V
    p, q, r = np.gradient(phi, t), turn * np.sin(phi) * np.cos(theta), turn * np.cos(phi) * np.cos(theta)
    across = np.tan(beta) * (p * np.cos(alpha) + r * np.sin(alpha))
    down = (np.gradient(alpha, t) - q + across) * V * np.cos(beta) / np.cos(alpha)
    right = (np.gradient(beta, t) - p * np.sin(alpha) + r * np.cos(alpha)) * V
    exact = {"V": np.full(len(t), V), "alpha": alpha, "beta": beta, "p": p, "q": q, "r": r, "phi": phi}
    exact |= {
        "theta": np.full(len(t), theta),
        "psi": np.cumsum(turn) * 0.04,
        "ax": np.full(len(t), 9.81 * np.sin(theta)),
    }
    exact |= {
        "ay": right - 9.81 * np.sin(phi) * np.cos(theta),
        "az": down - 9.81 * np.cos(phi) * np.cos(theta),
    }
    noise = {"V": 0.2, "alpha": 0.002, "beta": 0.0044, "ax": 0.02, "ay": 0.02, "az": 0.03}
    noisy = {name: values + rng.normal(0.0, noise.get(name, 1e-4), len(t)) for name, values in exact.items()}
    assert not cs.check([cs.Record.from_arrays(name="turn", t=t, channels=noisy)]).findings


def test_a_long_pause_and_a_channel_without_samples_are_told(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    aircraft, (first, second) = flown
    paused = replace(first, t=np.where(first.t > 8.0, first.t + 100.0, first.t))
    empty = second.with_channels(q=np.full(len(second), np.nan))
    checked = cs.check([paused, empty], aircraft)
    assert kinds(checked.findings) == [("data_dropout", "t"), ("data_dropout", "q")]
    assert "missing in m1 for 100" in str(checked) and "q has no sample at all in m2" in str(checked)
    ((begin, end),) = checked.findings[0].intervals_s["m1"]
    assert begin == pytest.approx(8.0, abs=0.05) and end - begin == pytest.approx(100.0, abs=0.05)


def test_a_reversed_elevator_makes_no_outlier() -> None:
    """Simulated at 10 Hz: the elevator goes from -5.95 to +4.08 deg within a sample and back, and az with it."""
    aircraft = Aircraft.read(DEMO / "aircraft.toml").with_derivatives({"CL_delta_e": 1.2})
    at = cs.trim(aircraft, V=aircraft.trim["V"], altitude=aircraft.trim["altitude"])
    t = np.arange(300) / 10.0
    channels = {name: np.full(len(t), value) for name, value in at.inputs.items()}
    channels["delta_e"] = channels["delta_e"] + np.where(t < 10.0, 0.0, np.where(t < 12.0, -0.1038, 0.0))
    channels["delta_e"][120] += 0.0712
    model = cs.aircraft_model(aircraft)
    flight = cs.simulate(model, Record(name="m", t=t, channels=channels), at.state).as_record("m")
    rng = np.random.default_rng(2)
    noisy = flight.with_channels(az=flight["az"] + 0.05 * rng.standard_normal(len(t)))
    assert not [one for one in cs.check([noisy], aircraft).findings if one.target == "az"]
    code = noisy["az"].copy()
    code[200] += 12.0
    found = cs.check([noisy.with_channels(az=code)], aircraft).findings
    assert [one.kind for one in found if one.target == "az"] == ["data_spikes"]


@pytest.mark.parametrize(("without", "stated"), [((), True), (("altitude",), True), ((), False)], ids=str)
def test_thrust_in_pounds_against_the_drag_of_the_trim(without: tuple[str, ...], stated: bool) -> None:
    """The demonstration: in steady flight thrust is drag, which the trim of the file states, or its aerodynamics."""
    aircraft = Aircraft.read(DEMO / "aircraft.toml")
    trim = {name: value for name, value in aircraft.trim.items() if stated or name != "thrust"}
    aircraft = replace(aircraft, trim=trim)
    records = [one.without(*without) for one in read_records([DEMO / "m*.csv"])]
    newton = 4.4482216152605
    (found,) = cs.check([r.with_channels(thrust=r["thrust"] / newton) for r in records], aircraft).findings
    assert (found.target, found.handled, found.value) == ("thrust", "corrected", pytest.approx(newton))
    assert not cs.check(records, aircraft).findings


def test_altitude_in_feet_without_a_file() -> None:
    """The rate of climb is that of airspeed and attitude."""
    records = read_records([DEMO / "m[12].csv"])
    feet = [r.with_channels(altitude=r["altitude"] / FOOT).without("rho") for r in records]
    assert kinds(cs.check(feet).findings) == [("data_unit", "altitude")]


def test_a_channel_that_is_believed_stays_as_it_was_recorded(flown: tuple[Aircraft, tuple[Record, ...]]) -> None:
    """Both are reversed. The acceleration is corrected without the belief; the elevator has its rival in the file."""
    aircraft, records = flown
    turned = [r.with_channels(ay=-r["ay"], delta_e=-r["delta_e"]) for r in records]
    found = cs.check(turned, aircraft)
    assert sorted(kinds(found.findings)) == [("data_sign", "ay"), ("data_sign", "delta_e")]
    assert all(one.odds is not None and one.odds > 1000.0 for one in found.findings)
    assert [one.handled for one in found.findings if one.target == "ay"] == ["corrected"]
    (rival,) = next(one.indistinguishable_from for one in found.findings if one.target == "delta_e")
    assert rival["target"] == "Cm_delta_e"
    believed = cs.check(turned, aircraft, undo=["ay"])
    assert ("data_sign", "ay") not in kinds(believed.findings)
    assert all(np.array_equal(a["ay"], b["ay"]) for a, b in zip(believed.records, turned, strict=True))
    assert all(np.array_equal(a["delta_e"], b["delta_e"]) for a, b in zip(believed.records, turned, strict=True))
    with pytest.raises(InputError, match="unknown channel 'delta_x'"):
        cs.check(turned, aircraft, undo=["delta_x"])
