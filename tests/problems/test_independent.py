"""Diagnoses of aircraft that a simulator of its own flew. Truth: what was put in (`problems.independent`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter

from casid.diagnosis.diagnose import diagnose
from casid.model.aircraft import Aircraft
from casid.records.record import Record
from problems.blind.independent import aircraft_of, records_of
from problems.independent.effects import Effect
from problems.independent.flights import fly_effect
from problems.independent.planes import JET, LIGHT, Plane

AIR_DATA = ("V", "alpha", "beta")
LOW_PASS_HZ = 5.0


def flown(plane: Plane, seed: int, effect: Effect | None = None) -> tuple[Aircraft, list[Record]]:
    given = fly_effect(plane, seed, effect)
    return aircraft_of(given), list(records_of(given))


def late(record: Record, names: tuple[str, ...], seconds: float) -> Record:
    return record.with_channels(**{name: np.interp(record.t - seconds, record.t, record[name]) for name in names})


@pytest.mark.slow
@pytest.mark.parametrize("plane", [JET, LIGHT], ids=lambda plane: plane.name)
def test_late_air_data_are_one_finding_of_which_a_delay_comes_first(plane: Plane) -> None:
    aircraft, records = flown(plane, 2)
    (cause,) = diagnose(aircraft, [late(r, AIR_DATA, 0.024) for r in records]).causes
    assert (cause.kind, cause.target) == ("sensor_delay", "air_data")
    assert abs(cause.value - 0.024) < max(2.6 * cause.std, 0.002)


@pytest.mark.slow
def test_a_cubic_term_beside_tables_is_named() -> None:
    hidden = Effect(kind="aero_term", target="Cm", term="alpha*alpha*alpha", value=-60.0)
    (cause,) = diagnose(*flown(LIGHT, 5, hidden)).causes
    assert (cause.kind, cause.target, cause.term) == ("aero_term", "Cm", "alpha^3")
    assert cause.value == pytest.approx(-60.0, abs=max(2.6 * cause.std, 12.0))


@pytest.mark.slow
def test_a_unit_of_the_file_is_not_said_of_derivatives_that_are_off_by_a_quarter() -> None:
    """A jet at 10 Hz without a vane of sideslip and without thrust, of which the file has 1.25 of every derivative."""
    given = fly_effect(JET, 1, None)
    aircraft = aircraft_of(given)
    known = {name: value for name, value in values_of(given.fit.values).items() if name in aircraft.derivatives}
    aircraft = aircraft.with_derivatives({name: 1.25 * value for name, value in known.items() if name[-2:] != "_0"})
    found = diagnose(aircraft, [r.without("beta", "thrust") for r in records_of(given)])
    assert not found.causes and not any(one.impossible for one in found.contradicted), str(found)
    assert found.verdict in ("adequate", "values wrong")


def values_of(fit: Mapping[str, Mapping[tuple[str, ...], float]]) -> dict[str, float]:
    return {f"{c}_{'*'.join(term) or '0'}": value for c, terms in fit.items() for term, value in terms.items()}


def as_filtered(record: Record, plane: Plane, seed: int) -> Record:
    """The record behind a low pass, with further noise that is slow, 0.4 to 6 s, and half as large again as the white
    noise."""
    rng, found = np.random.default_rng(seed), {}
    low_pass = np.array(butter(2, 2.0 * LOW_PASS_HZ * record.dt, output="ba"))
    for name in (*AIR_DATA, "p", "q", "r", "phi", "theta", "ax", "ay", "az"):
        stays = np.exp(-record.dt / rng.uniform(0.4, 6.0))
        white = rng.standard_normal(len(record) + 2000)
        slow = np.asarray(lfilter([np.sqrt(1.0 - stays**2)], [1.0, -stays], white))[2000:]
        found[name] = filtfilt(low_pass[0], low_pass[1], record[name] + 1.5 * plane.noise[name] * slow)
    return record.with_channels(**found)


@pytest.mark.slow
def test_the_deviation_of_a_scale_is_honest_in_coloured_noise() -> None:
    """Pitch angles 12 % small in one record each, filtered and with slow noise: errors are as large as is stated."""
    errors = []
    for seed in range(8):
        plane = (JET, LIGHT)[seed % 2]
        hidden = Effect(kind="sensor_scale", target="theta", value=-0.12)
        aircraft, records = flown(plane, 100 + seed, hidden)
        fitted, held = (as_filtered(one, plane, 10 * seed + i) for i, one in enumerate(records[:2]))
        found = diagnose(aircraft, [fitted], [replace(held, name="held")], axes="longitudinal")
        errors += [
            (c.value + 0.12) / c.std for c in (*found.causes, *found.minor) if c.key == ("sensor_scale", "theta", None)
        ]
    assert len(errors) >= 6
    assert np.sqrt(np.mean(np.square(errors))) < 1.8  # eight normal variables are beyond it in one case of a thousand
