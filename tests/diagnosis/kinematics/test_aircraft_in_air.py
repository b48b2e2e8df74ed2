"""Slow noise of air data against moving air. Truth: noise that was added, and Dryden turbulence that was flown in."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights, rough_file
from scipy.signal import lfilter

from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.kinematics.check import judge_kinematics, moves_the_aircraft
from casid.diagnosis.kinematics.kinematics import reconstruct
from casid.diagnosis.kinematics.turbulence import turbulence
from casid.records.record import Record
from problems.blind import flown
from problems.do328 import V_TRIM

_T = np.arange(0.0, 20.0, 0.04)
_AIR_DATA = ("V", "alpha", "beta")


def with_drifting(record: Record, rng: np.random.Generator, sizes: dict[str, float], memory_s: float) -> Record:
    """Noise beside the white one: first-order Gauss-Markov, of so many times its 1-sigma."""
    told = np.exp(-record.dt / memory_s)
    added = {}
    for name, size in sizes.items():
        news = rng.normal(0.0, size * NOISE[name] * np.sqrt(1.0 - told**2), len(record) + 200)
        added[name] = record[name] + np.asarray(lfilter([1.0], [1.0, -told], news))[200:]
    return record.with_channels(**added)


@cache
def in_calm_air() -> Subject:
    """Vanes and airspeed that wander for two seconds at a time, as far as the air at 0.4 m/s makes them."""
    rng, sizes = np.random.default_rng(1), {"V": 1.0, "alpha": 1.0, "beta": 1.0}
    return prepare(rough_file(), [with_drifting(one, rng, sizes, 2.0) for one in flights(seed=6, count=3)])


@cache
def in_moving_air(sigma: float, slow: bool) -> Subject:
    air = flown.turbulence(np.random.default_rng(7), _T, sigma, V_TRIM, 20.98)
    records, rng = flights(seed=7, count=3, disturbance=air), np.random.default_rng(2)
    sizes = dict.fromkeys(NOISE, 0.7) if slow else {}
    return prepare(rough_file(), [with_drifting(one, rng, sizes, 0.3) for one in records])


def test_vanes_that_wander_are_no_moving_air() -> None:
    """Kinematics, which know moving air by these readings alone, take it for turbulence."""
    flight = in_calm_air()
    by_kinematics = turbulence(flight, reconstruct(flight))
    assert by_kinematics.named and by_kinematics.gain > 1000.0
    refitted = fit(flight, [], flight.noise(), extent="settled")
    assert not moves_the_aircraft(by_kinematics, refitted)
    assert not judge_kinematics(flight, [], [], refitted).turbulence.named


@pytest.mark.parametrize(
    ("sigma", "slow"),
    [
        (0.5, True),
        (1.0, False),
        pytest.param(0.5, False, marks=pytest.mark.slow),
        pytest.param(1.0, True, marks=pytest.mark.slow),
    ],
)
def test_turbulence_is_named_with_its_size_beside_slow_noise_of_all_channels(sigma: float, slow: bool) -> None:
    flight = in_moving_air(sigma, slow)
    found = judge_kinematics(flight, [], [], fit(flight, [], flight.noise(), extent="settled")).turbulence
    assert found.named
    assert abs(found.sigma - sigma) < 3.0 * found.std, (found.sigma, found.std)
