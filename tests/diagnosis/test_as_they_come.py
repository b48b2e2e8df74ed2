"""Records as they come: channels that one of them lacks, dead channels, other rates, effects that the file has already.

Truth: small flights of the Do 328 with `Cm` of alpha^2 hidden, and what is done to them here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights
from scipy import signal
from small_flight import HIDDEN, aircraft_file, records

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_oscillation
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached, prior
from casid.diagnosis.given.as_given import attached_effects
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.model.aircraft import EffectValue
from casid.model.causes.aerodynamics import aero_term
from casid.model.causes.instruments import structural_mode
from casid.model.flown_records import flown_records
from casid.model.operators import TURNING, turned
from casid.model.simulate import simulate
from casid.records.record import Record
from problems.do328 import do328


def three(seed: int = 7) -> list[Record]:
    first, second = records(seed)
    return [first, second, replace(records(seed + 1)[0], name="third")]


def without(*names: str, at: int) -> Callable[[list[Record]], list[Record]]:
    def change(found: list[Record]) -> list[Record]:
        found[at] = found[at].without(*names)
        return found

    return change


def resting(name: str) -> Callable[[list[Record]], list[Record]]:
    return lambda found: [record.with_channels(**{name: np.zeros(len(record))}) for record in found]


def held_rows(name: str, every: int) -> Callable[[list[Record]], list[Record]]:
    """A channel at a fraction of the rate: the other samples are missing."""

    def change(found: list[Record]) -> list[Record]:
        there = [np.arange(len(record)) % every == 0 for record in found]
        return [
            record.with_channels(**{name: np.where(seen, record[name], np.nan)})
            for record, seen in zip(found, there, strict=True)
        ]

    return change


CHANGES = {
    "no ax in one, a dead roll rate": lambda found: resting("p")(without("ax", at=0)(found)),
    "no V and beta in the held-out one": without("V", "beta", at=2),
    "roll rate at half the rate, few readings of beta": lambda found: held_rows("beta", 8)(held_rows("p", 2)(found)),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_the_term_is_found_whatever_a_record_lacks(change: Callable[[list[Record]], list[Record]]) -> None:
    found = diagnose(replace(aircraft_file(), trim={"V": 144.0}), change(three()))
    assert [(c.kind, c.target, c.term) for c in found.causes] == [("aero_term", "Cm", "alpha^2")]
    assert found.causes[0].value == pytest.approx(HIDDEN, rel=0.25)
    document = found.to_dict()
    assert all(np.isfinite(ratio) for ratio in document["gain"]["held_out"]["rms_ratio"].values())


def test_what_a_record_lacks_is_said() -> None:
    flight = prepare(aircraft_file(), resting("p")(without("ax", at=0)(three())))
    assert "ax" in flight.outputs and "p" not in flight.outputs
    assert any(note.startswith("ax: not measured here") for note in flight.records[0].notes)
    assert any(note.startswith("p: constant") for note in flight.records[1].notes)


@pytest.mark.parametrize("at", [0, 2])
def test_a_record_that_shows_nothing_is_named_before_the_work_begins(at: int) -> None:
    found, stages = three(), []
    found[at] = found[at].without("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az")
    with pytest.raises(InputError, match=f"record '{found[at].name}': of the outputs .* it has only none"):
        diagnose(replace(aircraft_file(), trim={"V": 144.0}), found, report=stages.append)
    assert stages == ["faults of the data", "reading the records"]


def test_effects_of_other_records_do_nothing_here() -> None:
    """An extended file of earlier flights names their records; what belongs to them stays in the file."""
    elsewhere = (
        EffectValue(kind="sensor_bias", target="q", value=0.01, records=("m9",)),
        EffectValue(kind="gust", target="z", value=4.0, onset_s={"m9": (3.0, 3.2)}, parameters={"length": 1.0}),
    )
    aircraft = aircraft_file().with_effects(elsewhere)
    flight = prepare(aircraft, three())
    assert attached_effects(flight.aircraft, flight.names) == []
    found = diagnose(aircraft, records())
    assert [c.term for c in found.causes] == ["alpha^2"]
    assert found.extended_aircraft.effects[:2] == elsewhere


def test_a_configuration_change_of_the_file_needs_no_parameters() -> None:
    change = EffectValue(kind="configuration_change", target="CL+CD", value=0.01, onset_s={"first": (3.0, 3.2)})
    flight = prepare(aircraft_file().with_effects([change]), three())
    (one,) = attached_effects(flight.aircraft, flight.names)
    assert dict(one.values) == {"value": 0.01, "duration": 0.0, "CD": 0.0} and one.onsets == {"first": 3.1}


@pytest.fixture(scope="module")
def known_bias() -> Diagnosis:
    """The file has a bias of the pitch rate of 0.002 rad/s that is 0.01 in the records."""
    file = aircraft_file().with_effects([EffectValue(kind="sensor_bias", target="q", value=0.002)])
    return diagnose(file, [record.with_channels(q=record["q"] + 0.01) for record in three()])


def test_an_effect_of_the_file_is_written_as_it_was_fitted(known_bias: Diagnosis) -> None:
    bias, term = known_bias.extended_aircraft.effects
    assert (bias.kind, bias.value) == ("sensor_bias", pytest.approx(0.01, abs=4.0 * bias.std)) and bias.std < 2e-3
    assert term.term == "alpha^2"
    (row,) = [one for one in known_bias.parameters if one.name == "sensor_bias(q)"]
    assert (row.a_priori, row.unit) == (0.002, "rad/s")
    assert row.extended == bias.value and known_bias.to_dict()["parameters"]["sensor_bias(q)"]["a_priori"] == 0.002


def test_the_extended_file_flies_as_the_extended_model(known_bias: Diagnosis) -> None:
    """The truth is the extended model itself, flown from its own initial state in the record that no fit has seen."""
    view = known_bias.held_out_extended
    assert flown_apart(known_bias) < 0.05
    assert max(c.rms / c.noise for c in view.channels.values()) < 3.0


def flown_apart(found: Diagnosis) -> float:
    """Largest difference, in noise, between the simulation by the extended file and the extended model's own."""
    view = found.held_out_extended
    (record,) = view.fit.flight.records
    applied = flown_records(found.extended_aircraft, [record], outputs=view.fit.model.outputs)
    start = view.fit.linear.X[0, 0, : len(applied.model.states)]
    read = simulate(applied.model, applied.records[0], start).outputs
    sigma = np.array([view.fit.noise.measurement[o] for o in view.fit.model.outputs])
    return float(np.abs((read - view.simulated.output[:, 0]) / sigma).max())


def test_what_is_expected_is_written_too() -> None:
    """A tail in the slipstream is minor, and the derivatives were fitted beside it: without it the file is worse than
    the one it comes from."""
    hidden = Attached(effect=aero_term("Cm", "delta_e*Tc"), values={"value": -10.0})
    found = diagnose(do328(), flights([hidden], seed=5, count=4))
    assert not found.causes and found.is_extended
    assert found.extended_aircraft.terms["Cm"]["delta_e*Tc"] == pytest.approx(-10.0, rel=0.2)
    assert flown_apart(found) < 0.05


@pytest.mark.slow
def test_a_late_heading_is_found_though_it_passes_north() -> None:
    """Truth: 0.3 s, on a heading that jumps by a turn where it passes 360 deg."""
    found = []
    for record in flights(seed=2, count=3, rate_hz=50.0, size=2.0):
        heading = 6.2 + turned(record.t, *(record[name] for name in TURNING))
        late = np.interp(record.t - 0.3, record.t, heading) + np.random.default_rng(4).normal(0.0, 1e-3, len(record))
        found.append(record.with_channels(psi=late % (2.0 * np.pi)))
    assert max(np.ptp(record["psi"]) for record in found) > 6.0
    (cause,) = diagnose(do328(), found).causes
    names = [(cause.kind, cause.target), *((o["kind"], o["target"]) for o in cause.indistinguishable_from)]
    assert ("sensor_delay", "psi") in names
    assert cause.value == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize("size", [0.01, 0.2])
def test_a_hum_has_its_frequency_whatever_the_rates_of_the_records(size: float) -> None:
    """Truth: 3.3 Hz in the pitching moment of records at 50 and at 25 Hz; also one that is beyond any chance."""
    found = []
    for rate, name in ((50.0, "fast"), (25.0, "slow")):
        t = np.arange(0.0, 20.0, 1.0 / rate)
        (record,) = flights(seed=3, count=1, rate_hz=rate, disturbance={"dCm": size * np.sin(2.0 * np.pi * 3.3 * t)})
        found.append(replace(record, name=name))
    flight = prepare(do328(), found)
    hum = missing_oscillation(weigh(fit(flight, (), flight.noise())))[0]
    assert hum.station == "dCm" and hum.frequency == pytest.approx(3.3, abs=0.03)


def test_a_term_that_the_file_has_at_zero_is_free() -> None:
    """0 or absent: no prior (formats); a stated uncertainty is one, but not near zero."""
    plane = do328().with_terms({"Cm": {"alpha^2": 0.0}})
    names = ["Cm_alpha^2", "Cm_alpha"]
    loose, stated = (
        prior(flight, flight.model(), names)[1] ** -0.5
        for flight in (prepare(replace(plane, relative_uncertainty=r), records()) for r in (0.0, 0.05))
    )
    assert loose[0] > 2.0 * HIDDEN and loose[0] == stated[0], "0 has no relative uncertainty"
    assert stated[1] == pytest.approx(0.05 * abs(plane.derivatives["Cm_alpha"])) and loose[1] > 10.0 * stated[1]


@pytest.mark.parametrize("rate_hz", [25.0, 100.0])
def test_an_angular_acceleration_computed_from_the_rate_is_left_out(rate_hz: float) -> None:
    """Truth: differences of the measured rate, smoothed and rounded, tell nothing that the rate does not; an instrument
    of its own does, though it measures the same motion, of an aircraft that shakes as well."""
    shaken = Attached(effect=structural_mode("q"), values={"value": 0.05, "frequency_hz": 5.0, "damping": 0.03})
    noise = NOISE | dict.fromkeys(("pdot", "qdot", "rdot"), 0.005)
    measured = flights([shaken], seed=2, count=3, rate_hz=rate_hz, noise=noise)

    def differentiated(record: Record) -> Record:
        slope = np.gradient(record["q"], record.t)
        return record.with_channels(qdot=np.round(signal.savgol_filter(slope, 7, 2), 4))

    assert {"pdot", "qdot", "rdot"} <= set(prepare(do328(), measured).outputs)
    flight = prepare(do328(), [differentiated(record) for record in measured])
    assert "qdot" not in flight.outputs and {"pdot", "rdot"} <= set(flight.outputs)
    assert "qdot: computed from q, whose noise it has, and nothing new, so it is left out" in flight.records[0].notes
