"""Manoeuvres by the inputs that move. Truth: the times at which they were made to move."""

from __future__ import annotations

import numpy as np
import pytest

from casid.acceptance.manoeuvres import MANOEUVRES, window_between, windows
from casid.records.record import Record

T = np.arange(0.0, 120.0, 0.02)


def pulse(start: float, end: float, size: float = 0.05) -> np.ndarray:
    return size * ((start <= T) & (end > T))


def record(noise: float = 0.0, **inputs: np.ndarray) -> Record:
    rng = np.random.default_rng(1)
    rest = {name: np.zeros(len(T)) for name in ("delta_e", "delta_a", "delta_r")} | {"V": np.full(len(T), 95.0)}
    channels = {**rest, **inputs}
    return Record(name="m", t=T, channels={n: v + rng.normal(0.0, noise, len(T)) for n, v in channels.items()})


@pytest.mark.parametrize("noise", [0.0, 5e-4])
def test_an_input_begins_a_manoeuvre_and_the_next_one_ends_it(noise: float) -> None:
    """Elevator at 10 s, a doublet; aileron from 30 to 31 s; rudder from 50 s on."""
    flown = record(noise, delta_e=pulse(10, 11) - pulse(11, 12), delta_a=pulse(30, 31), delta_r=pulse(50, 200))
    expected = {"elevator input": (9.0, 10.0, 30.0), "aileron input": (29.0, 30.0, 50.0)}
    expected |= {"rudder input": (49.0, 50.0, 120.0), "phugoid": (None, None, None)}
    expected |= {"longitudinal free response": (12.0, 12.0, 30.0)}
    for manoeuvre, (start, begin, end) in expected.items():
        found = windows(flown, manoeuvre)
        if start is None:  # 18 s are no period of a phugoid at 95 m/s, 43 s
            assert not found
            continue
        assert found[0].start == pytest.approx(start, abs=0.06)
        assert found[0].begin == pytest.approx(begin, abs=0.06)
        assert found[0].end == pytest.approx(end, abs=0.06)


def test_a_phugoid_needs_the_time_of_one() -> None:
    """Truth: Lanchester's period at 95 m/s is 43.0 s."""
    (found,) = windows(record(delta_e=pulse(10, 11)), "phugoid")
    assert found.begin == pytest.approx(11.0, abs=0.06) and found.end == T[-1]
    assert not windows(record(delta_e=pulse(10, 11), delta_a=pulse(53.5, 54)), "phugoid")
    assert windows(record(delta_e=pulse(10, 11), delta_a=pulse(54.5, 55)), "phugoid")


def test_the_rest_before_is_as_long_as_the_standard_asks_where_there_is_one() -> None:
    power = record(thrust=9000.0 + 4000.0 * np.clip((T - 40.0) / 2.0, 0.0, 1.0), delta_e=pulse(10, 11))
    (found,) = windows(power, "power change", before_s=5.0)
    assert found.begin - found.start == pytest.approx(5.0)
    late = record(thrust=9000.0 + 4000.0 * np.clip((T - 40.0) / 2.0, 0.0, 1.0), delta_e=pulse(36, 37))
    (found,) = windows(late, "power change", before_s=5.0)
    assert found.start == pytest.approx(37.0, abs=0.1)
    assert found.rest == pytest.approx(T[-1] - 42.0, abs=0.3)


def test_inputs_that_rest_begin_nothing() -> None:
    flown = record(5e-4)
    assert not any(windows(flown, manoeuvre) for manoeuvre in MANOEUVRES)


def test_a_window_that_is_given_begins_where_its_input_moves() -> None:
    flown = record(delta_e=pulse(10, 11))
    assert window_between(flown, "elevator input", 8.0, 20.0).begin == pytest.approx(10.0, abs=0.06)
    assert window_between(flown, "configuration change", 8.0, 20.0).begin == 8.0
