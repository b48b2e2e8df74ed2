"""Pass and fail. Truth: simulations that are off flight by just the tolerance, and by a little more."""

from __future__ import annotations

import numpy as np
import pytest

from casid.acceptance.checks import Check, checks_of, flight_of, smoothed_channels, verdict
from casid.acceptance.flown import Flown
from casid.acceptance.manoeuvres import Window
from casid.acceptance.tolerances import StandardTest, Tolerance
from casid.records.record import Record

T = np.arange(0.0, 10.0, 0.05)
WINDOW = Window(start=0.0, begin=2.0, end=float(T[-1]), rest=5.0)
FLIGHT = {"q": 0.05 * np.sin(T), "theta": 0.1 + 0.02 * np.cos(T), "beta": np.exp(-0.1 * T) * np.cos(2.0 * T)}
KNOT = 1852.0 / 3600.0
EDGE = 1e-6  # of the tolerance: beyond rounding and the smoothing of a curve without noise


def judged(rows: tuple[Tolerance, ...], simulated: dict[str, np.ndarray], **further: object) -> tuple[Check, ...]:
    test = StandardTest(id="1", title="", manoeuvre="any", paragraph="1", tolerances=rows, **further)  # pyright: ignore
    record = Record(name="m", t=T, channels=FLIGHT)
    flight = flight_of(test, record, smoothed_channels(record, test.channels), WINDOW)
    return checks_of(test, record, WINDOW, flight, Flown(channels=simulated, corrections={}))


def row(channel: str = "q", **further: object) -> Tolerance:
    return Tolerance(channel=channel, unit="rad/s", **further)  # pyright: ignore


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_at_an_absolute_tolerance_it_passes_and_beyond_it_fails(sign: float) -> None:
    for off, passes in ((1.0 - EDGE, True), (1.0 + EDGE, False)):
        (found,) = judged((row(absolute=0.01),), {"q": FLIGHT["q"] + sign * 0.01 * off})
        assert found.passed is passes
        assert found.used == pytest.approx(1.0, abs=1e-5)
        assert found.deviation == pytest.approx(sign * 0.01, rel=1e-5)


def test_one_sample_out_of_tolerance_fails_and_its_time_is_told() -> None:
    simulated = FLIGHT["q"].copy()
    simulated[120:130] += 0.02
    (found,) = judged((row(absolute=0.01),), {"q": simulated})
    assert found.passed is False
    assert found.out_s == pytest.approx(0.5) and found.in_s == pytest.approx(len(T) * 0.05 - 0.5)
    assert 6.0 <= found.at_s < 6.5


@pytest.mark.parametrize(("relative_to", "limit"), [("value", 0.1 * np.abs(FLIGHT["q"])), ("peak", 0.1 * 0.05)])
def test_a_relative_tolerance_is_of_the_sample_or_of_the_peak(relative_to: str, limit: np.ndarray | float) -> None:
    rows = (row(relative=0.1, relative_to=relative_to, absolute=1e-3),)
    allowed = np.maximum(limit, 1e-3)
    for off, passes in ((0.99, True), (1.01, False)):
        assert judged(rows, {"q": FLIGHT["q"] + off * allowed})[0].passed is passes


def test_a_row_holds_in_its_span_alone() -> None:
    """From 3 to 5 s after the beginning at 2 s, that is from 5 to 7 s."""
    rows = (row(absolute=0.01, from_s=3.0, to_s=5.0),)
    for outside, passes in ((T < 4.99, True), (T > 7.01, True), ((T > 6.0) & (T < 6.2), False)):
        assert judged(rows, {"q": FLIGHT["q"] + 0.02 * outside})[0].passed is passes
    (found,) = judged((row(absolute=0.01, to_s=20.0),), {"q": FLIGHT["q"]})
    assert found.passed is None and "20 s" in found.why


def test_of_alternatives_one_suffices_and_all_of_the_rest_must_hold() -> None:
    rows = (row(absolute=0.01, either="pitch"), row("theta", absolute=0.01, either="pitch"), row("beta", absolute=0.1))
    off = {name: values + 0.5 for name, values in FLIGHT.items()}
    for good, passes in ((("q", "beta"), True), (("theta", "beta"), True), (("beta",), False), (("q", "theta"), False)):
        assert verdict(judged(rows, off | {name: FLIGHT[name] for name in good})) is passes


def test_what_is_not_measured_is_not_judged() -> None:
    found = judged((row("alpha", absolute=0.01), row(absolute=0.01)), {"q": FLIGHT["q"]})
    assert found[0].passed is None and "alpha" in found[0].why
    assert verdict(found) is None
    worse = judged((row("alpha", absolute=0.01), row(absolute=0.01)), {"q": FLIGHT["q"] + 1.0})
    assert verdict(worse) is False


PERIOD = Tolerance(channel="beta", quantity="period", relative=0.1, unit="s")


def test_a_period_at_the_edge_of_its_tolerance() -> None:
    """Truth: the same oscillation with a period that is 10 % longer, less and more a little."""
    for stretch, passes in ((1.099, True), (1.101, False)):
        (found,) = judged((PERIOD,), {"beta": np.exp(-0.1 * T) * np.cos(2.0 * T / stretch)})
        assert found.passed is passes
        assert found.flight is not None and found.flight.value == pytest.approx(np.pi, rel=1e-6)


def test_too_few_cycles_are_not_judged_unless_the_decay_is_told() -> None:
    half = Tolerance(channel="beta", quantity="time_to_half", relative=0.1, unit="s")
    simulated = {"beta": FLIGHT["beta"]}  # 3.2 cycles
    assert judged((PERIOD,), simulated, cycles=3.0)[0].passed is True
    assert judged((PERIOD,), simulated, cycles=6.0)[0].passed is None
    assert judged((PERIOD, half), simulated, cycles=6.0, cycles_unless="time_to_half")[0].passed is True


def test_noise_of_flight_is_no_deviation() -> None:
    """Noise of half the tolerance, whose largest readings are beyond it."""
    noisy = FLIGHT["q"] + np.random.default_rng(1).normal(0.0, 0.005, len(T))
    assert np.abs(noisy - FLIGHT["q"]).max() > 0.01
    test = StandardTest(id="1", title="", manoeuvre="any", paragraph="1", tolerances=(row(absolute=0.01),))
    record = Record(name="m", t=T, channels={"q": noisy})
    flight = flight_of(test, record, smoothed_channels(record, ["q"]), WINDOW)
    (found,) = checks_of(test, record, WINDOW, flight, Flown(channels={"q": FLIGHT["q"]}, corrections={}))
    assert found.passed is True


def test_a_simulation_that_diverged_fails() -> None:
    test = StandardTest(id="1", title="", manoeuvre="any", paragraph="1", tolerances=(row(absolute=0.01),))
    record = Record(name="m", t=T, channels=FLIGHT)
    flight = flight_of(test, record, smoothed_channels(record, ["q"]), WINDOW)
    (found,) = checks_of(test, record, WINDOW, flight, Flown(channels={}, corrections={}, diverged="at 3 s"))
    assert found.passed is False and "3 s" in found.why


@pytest.mark.parametrize("recorded", [("altitude",), ("rho",), ("altitude", "rho"), ()])
def test_calibrated_airspeed_takes_altitude_or_density(recorded: tuple[str, ...]) -> None:
    """Truth: the standard atmosphere at 20 000 ft has 0.65269 kg/m3 and 46563 Pa; the Mach number there follows from
    the impact pressure of 250 kt at sea level."""
    impact = 101325.0 * ((1.0 + (250.0 * KNOT) ** 2 * 1.225 / (7.0 * 101325.0)) ** 3.5 - 1.0)
    true = np.sqrt(1.4 * 46563.0 / 0.65269 * 5.0 * ((1.0 + impact / 46563.0) ** (2.0 / 7.0) - 1.0))
    further = {"altitude": np.full(len(T), 6096.0), "rho": np.full(len(T), 0.65269)}
    record = Record(name="m", t=T, channels={"V": np.full(len(T), true), **{n: further[n] for n in recorded}})
    rows = (Tolerance(channel="calibrated_airspeed", unit="m/s", absolute=1.0),)
    test = StandardTest(id="1", title="", manoeuvre="any", paragraph="1", tolerances=rows)
    flight = flight_of(test, record, smoothed_channels(record, test.channels), WINDOW)
    if not recorded:
        assert "calibrated_airspeed" not in flight.samples
        return
    np.testing.assert_allclose(flight.samples["calibrated_airspeed"], 250.0 * KNOT, rtol=1e-3)
