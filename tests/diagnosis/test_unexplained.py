"""What stays unexplained beside noise that moves slowly. Truth: nothing is missing, or something is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights, rough_file
from scipy.signal import lfilter

from casid.diagnosis.causes import still_missing
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.last_tests import _not_by_noise
from casid.records.record import Record
from problems.do328 import do328

_MEMORY_S = 0.15


def with_slow_noise(record: Record, rng: np.random.Generator, but: tuple[str, ...] = ()) -> Record:
    """As much again as the white noise of every channel, with a memory: what drifts and filters of instruments make."""
    told = np.exp(-record.dt / _MEMORY_S)

    def slow(sigma: float) -> np.ndarray:
        news = rng.normal(0.0, sigma * np.sqrt(1.0 - told**2), len(record))
        return np.asarray(lfilter([1.0], [1.0, -told], news))

    return record.with_channels(
        **{name: record[name] + slow(sigma) for name, sigma in NOISE.items() if name not in but}
    )


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.slow
def test_slow_noise_is_nothing_that_the_simulation_misses(seed: int) -> None:
    """Taken as white, each of its readings counts as news: an unknown history of the air gains hundreds."""
    rng = np.random.default_rng(seed)
    found = diagnose(rough_file(), [with_slow_noise(one, rng) for one in flights(seed=seed, count=3)])
    assert (found.verdict, found.causes, found.unexplained) == ("values wrong", (), ()), str(found)


@pytest.mark.slow
def test_what_is_missing_beside_slow_noise_is_still_missing() -> None:
    """An oscillating rolling moment that no cause of the catalogue has; the air data are white."""
    rng, t = np.random.default_rng(3), np.arange(0.0, 20.0, 0.04)
    moment = 0.002 * np.sin(2.0 * np.pi * 0.35 * t) * np.sin(0.4 * t) ** 2
    records = flights(seed=3, count=3, disturbance={"dCl": moment})
    found = diagnose(rough_file(), [with_slow_noise(one, rng, ("V", "alpha", "beta")) for one in records])
    assert found.verdict in ("unexplained", "partly explained"), str(found)
    assert found.unexplained[0].place.name == "Cl"


@pytest.mark.slow
def test_coarse_steps_of_an_attitude_are_nothing_that_is_missing_there() -> None:
    """The pitch attitude in steps of 0.35 deg, seven times its noise: 20 levels."""
    step = np.radians(0.35)
    records = [one.with_channels(theta=step * np.round(one["theta"] / step)) for one in flights(seed=6, count=3)]
    found = diagnose(rough_file(), records)
    assert (found.verdict, found.causes, found.unexplained) == ("values wrong", (), ()), str(found)


SLOW = {
    "CL": 0.06,
    "CD": 0.012,
    "CY": 0.02,
    "Cl": 0.003,
    "Cm": 0.03,
    "Cn": 0.004,
}  # the most that a coefficient changes


@pytest.mark.parametrize("name", SLOW)
@pytest.mark.parametrize("seed", range(2))
def test_a_coefficient_that_changes_slowly_is_no_noise_of_an_instrument(name: str, seed: int) -> None:
    """From the beginning of each record to its end, by a third to all of that: it stays what is missing where the noise
    of each reading may be as slow as the residuals. A hundredth of it is nothing."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.04)
    begun = SimpleNamespace(fixed=False, required=0.0)
    for part in (rng.uniform(0.3, 1.0), 0.01):
        change = part * SLOW[name] * (t / 10.0 - 1.0)
        flight = prepare(do328(), flights(seed=seed, count=2, disturbance={f"d{name}": change}))
        fitted = fit(flight, (), flight.noise(), extent="settled")
        left = still_missing(weigh(fitted), missing_inputs(weigh(fitted)), (), 0.0)
        found = _not_by_noise(fitted, left, (), begun)  # pyright: ignore
        assert (name in [one.place.name for one in found]) == (part > 0.1)
