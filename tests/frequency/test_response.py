"""Frequency responses against analytic ones, the textbook's formulas of coherence and error, and scipy.signal."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

import casid as cs
from casid.errors import InputError
from casid.frequency.response import FrequencyResponse, phase_deg, random_error
from casid.frequency.transform import Stretch, spectra
from casid.records.record import Record

DT = 0.02
OMEGA = np.geomspace(2.2, 30.0, 12)
FILTER = signal.butter(2, 0.15)


def record(name: str, **channels: np.ndarray) -> Record:
    return Record(name=name, t=DT * np.arange(len(next(iter(channels.values())))), channels=channels)


def noisy(rng: np.random.Generator, sigma: float, count: int = 1301) -> tuple[np.ndarray, np.ndarray]:
    """White noise, and what the filter makes of it with noise of its own."""
    u = rng.standard_normal(count)
    return u, np.asarray(signal.lfilter(*FILTER, u)) + sigma * rng.standard_normal(count)


def response_of_filter(omega: np.ndarray) -> np.ndarray:
    return np.asarray(signal.freqz(*FILTER, omega * DT)[1])


def short_period(omega: np.ndarray) -> np.ndarray:
    """A pitch rate to an elevator with a delay: 40 (s + 1) exp(-0.1 s) / (s^2 + 2.4 s + 9)."""
    s = 1j * omega
    return -40.0 * (s + 1.0) * np.exp(-0.1 * s) / (s**2 + 2.4 * s + 9.0)


def test_lines_of_a_multisine_give_gain_and_phase_to_rounding() -> None:
    """Lines with whole periods in a window, four apart, do not reach each other through Hann's taper: the response at
    them is that of the system, which is written down line by line, and nothing but it is in the output."""
    window, count = 10.0, 2000
    bins = np.arange(4, 60, 4)
    omega = 2.0 * np.pi * bins / window
    t = DT * np.arange(count)
    angle = omega[:, None] * t + np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, len(bins))[:, None]
    u = np.cos(angle).sum(axis=0)
    y = (short_period(omega)[:, None] * np.exp(1j * angle)).real.sum(axis=0)
    found = cs.frequency_response(record("m1", u=u, y=y), "u", "y", omega=omega, windows=[window])
    assert found.response == pytest.approx(short_period(omega), rel=1e-9)
    assert found.coherence == pytest.approx(np.ones(len(bins)), abs=1e-9)
    exact = np.unwrap(np.angle(short_period(np.linspace(0.01, omega[-1], 4000))))
    turns = (np.degrees(exact[-1]) - found.phase_deg[-1]) / 360.0
    assert turns == pytest.approx(round(turns), abs=1e-6)
    assert np.diff(found.phase_deg) == pytest.approx(np.degrees(np.diff(np.unwrap(np.angle(short_period(omega))))))


def test_a_gain_alone_is_exact_for_any_input() -> None:
    t = DT * np.arange(1301)
    u = signal.chirp(t, 0.1, 26.0, 3.0)
    found = cs.frequency_response(record("m1", u=u, y=-0.5 * u), "u", "y")
    assert found.response == pytest.approx(np.full(100, -0.5 + 0.0j), rel=1e-9)
    assert found.gain_db == pytest.approx(np.full(100, 20.0 * np.log10(0.5)))
    assert np.abs(found.phase_deg) == pytest.approx(np.full(100, 180.0))
    assert found.random_error.max() < 1e-6


def test_one_window_length_is_what_scipy_gives() -> None:
    """scipy.signal.csd and coherence, per Hz, of one record, with the same taper, overlap and detrending."""
    rng = np.random.default_rng(2)
    u, y = noisy(rng, 0.3)
    frequency, peer = signal.csd(u, y, 1.0 / DT, nperseg=500, noverlap=400)
    bins = slice(3, 40)
    omega = 2.0 * np.pi * frequency[bins]
    stretch = Stretch(start=0.0, dt=DT, values=np.stack([u, y], axis=1))
    mine = spectra([stretch], ["u", "y"], omega, 10.0, 0.8)
    assert 2.0 * np.pi * mine.matrix[:, 0, 1] == pytest.approx(peer[bins], rel=1e-9)
    found = cs.frequency_response(record("m1", u=u, y=y), "u", "y", omega=omega, windows=[10.0])
    coherence = signal.coherence(u, y, 1.0 / DT, nperseg=500, noverlap=400)[1]
    assert found.coherence == pytest.approx(coherence[bins], abs=1e-9)
    assert found.input_spectrum == pytest.approx(np.real(mine.matrix[:, 0, 0]))


def test_spectra_integrate_to_the_variance() -> None:
    """Parseval: white noise has the same density up to the Nyquist frequency."""
    u = 3.0 * np.random.default_rng(3).standard_normal(50000)
    stretch = Stretch(start=0.0, dt=DT, values=u[:, None])
    density = np.real(spectra([stretch], ["u"], OMEGA, 4.0, 0.5).matrix[:, 0, 0])
    assert density.mean() * np.pi / DT == pytest.approx(9.0, rel=0.03)


def test_coherence_and_scatter_are_those_of_the_textbook() -> None:
    """Coherence |H|^2 Gxx / (|H|^2 Gxx + Gnn) and standard deviation sqrt((1 - c) / (2 n c)) of the relative gain
    (Bendat and Piersol, ch. 6 and 9), in 150 draws: with one length of window and with the composite of five."""
    rng, sigma = np.random.default_rng(4), 0.5
    power = np.abs(response_of_filter(OMEGA)) ** 2
    exact = power / (power + sigma**2)
    for windows in ([6.0], None):
        draws = []
        for _ in range(150):
            three = [record(f"m{k}", **dict(zip("uy", noisy(rng, sigma), strict=True))) for k in range(3)]
            draws.append(cs.frequency_response(three, "u", "y", omega=OMEGA, windows=windows))
        gains = np.abs([one.response for one in draws])
        scatter = gains.std(axis=0) / gains.mean(axis=0)
        predicted = np.sqrt(np.mean([one.random_error**2 for one in draws], axis=0))
        assert predicted == pytest.approx(scatter, rel=0.2)
        phases = np.angle([one.response / response_of_filter(OMEGA) for one in draws]).std(axis=0)
        assert predicted == pytest.approx(phases, rel=0.2)
        assert np.mean([one.coherence for one in draws], axis=0) == pytest.approx(exact, abs=0.03)


def test_the_error_falls_with_the_root_of_the_averages() -> None:
    """Independent windows, without overlap: n = records times windows in each, exactly."""
    rng = np.random.default_rng(5)
    errors = []
    for count in (4, 16, 64):
        flown = [record(f"m{k}", **dict(zip("uy", noisy(rng, 0.5, 1000), strict=True))) for k in range(count)]
        found = cs.frequency_response(flown, "u", "y", omega=OMEGA, windows=[10.0], overlap=0.0)
        assert found.windows == {10.0: pytest.approx(2.0 * count)}
        errors.append(np.sqrt(np.mean(found.random_error**2)))
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)
    assert random_error(np.array([0.5]), 8.0) == pytest.approx([0.25])


@pytest.mark.parametrize("count", [1, 2, 8])
def test_chance_takes_unrelated_channels_for_related_in_one_case_of_twenty(count: int) -> None:
    """White noise in both, in 400 draws, with windows that do not overlap: 3, 6 and 24 of them."""
    rng, beyond = np.random.default_rng(14), []
    for _ in range(400):
        flown = [record(f"m{k}", u=rng.standard_normal(750), y=rng.standard_normal(750)) for k in range(count)]
        found = cs.frequency_response(flown, "u", "y", omega=[6.0, 14.0, 22.0], windows=[5.0], overlap=0.0)
        assert found.averages == pytest.approx(3.0 * count * np.ones(3))
        beyond.append(found.coherence > found.by_chance)
    assert np.mean(beyond) == pytest.approx(0.05, abs=0.02)


def test_overlapping_windows_are_as_many_as_their_correlation_allows() -> None:
    """Welch's formula for Hann's taper at an overlap of one half: its correlation is 1/6, so that K windows count as
    K / (1 + 2 (K - 1) / K / 36)."""
    count, K = 500, 9
    stretch = Stretch(start=0.0, dt=DT, values=np.random.default_rng(0).standard_normal((2500, 1)))
    found = spectra([stretch], ["u"], OMEGA, count * DT, 0.5)
    assert found.segments == K
    assert found.averages == pytest.approx(K / (1.0 + 2.0 * (K - 1) / K / 36.0), rel=1e-3)


def test_a_second_surface_that_moves_with_the_first_is_taken_off() -> None:
    """y = 2 a - 3 r, and r follows a: alone, a seems to have the gain of both. Partial coherence is 1 again."""
    rng = np.random.default_rng(6)
    a = rng.standard_normal(2000)
    r = 0.7 * a + 0.4 * rng.standard_normal(2000)
    flown = record("m1", a=a, r=r, y=2.0 * a - 3.0 * r)
    alone = cs.frequency_response(flown, "a", "y")
    assert np.abs(np.mean(alone.response)) == pytest.approx(abs(2.0 - 3.0 * 0.7), abs=0.1)
    for mine, other, gain in (("a", "r", 2.0), ("r", "a", -3.0)):
        found = cs.frequency_response(flown, mine, "y", other_inputs=[other])
        assert found.response == pytest.approx(np.full(100, gain + 0.0j), rel=1e-6)
        assert found.coherence == pytest.approx(np.ones(100), abs=1e-6)


def test_conditioning_is_the_solution_for_all_inputs_at_once() -> None:
    """Frisch and Waugh: the response by conditioned spectra is that of least squares with all inputs."""
    rng = np.random.default_rng(7)
    a, noise = rng.standard_normal((2, 1301))
    r = np.asarray(signal.lfilter([0.3, 0.2], [1.0, -0.4], a)) + 0.5 * rng.standard_normal(1301)
    y = np.asarray(signal.lfilter(*FILTER, a)) - r + 0.3 * noise
    found = cs.frequency_response(record("m1", a=a, r=r, y=y), "a", "y", other_inputs=["r"], omega=OMEGA, windows=[8.0])
    stretch = Stretch(start=0.0, dt=DT, values=np.stack([a, r, y], axis=1))
    g = spectra([stretch], ["a", "r", "y"], OMEGA, 8.0, 0.8).matrix
    both = np.linalg.solve(g[:, :2, :2], g[:, :2, 2:])[..., 0]
    assert found.response == pytest.approx(both[:, 0], rel=1e-9)
    explained = np.einsum("fi,fi->f", both.conj(), g[:, :2, 2]).real / g[:, 2, 2].real
    assert found.multiple_coherence == pytest.approx(explained, rel=1e-9)


def test_a_gap_divides_a_record_into_two() -> None:
    rng = np.random.default_rng(8)
    u, y = noisy(rng, 0.3, 2000)
    broken = y.copy()
    broken[900:1000] = np.nan
    halves = [record("a", u=u[:900], y=y[:900]), record("b", u=u[1000:], y=y[1000:])]
    one = cs.frequency_response(record("m", u=u, y=broken), "u", "y", omega=OMEGA)
    two = cs.frequency_response(halves, "u", "y", omega=OMEGA)
    assert one.response == pytest.approx(two.response, rel=1e-9)
    assert one.windows == pytest.approx(two.windows)


def test_an_output_of_a_slower_rate_is_used_at_its_rate() -> None:
    """Every fifth row has a sample, as of a bus of 10 Hz: the response is that of these rows alone."""
    u, y = noisy(np.random.default_rng(9), 0.1, 5000)
    slow = np.where(np.arange(5000) % 5 == 0, y, np.nan)
    found = cs.frequency_response(record("m1", u=u, y=slow), "u", "y")
    rows = Record(name="m1", t=DT * np.arange(0, 5000, 5), channels={"u": u[::5], "y": y[::5]})
    assert found.response == pytest.approx(cs.frequency_response(rows, "u", "y").response, rel=1e-9)


def test_records_of_several_rates_are_joined() -> None:
    """A gain of -2 at 50 and at 40 Hz."""
    rng = np.random.default_rng(10)
    slow = rng.standard_normal(1000)
    flown = [
        record("m1", u=(u := rng.standard_normal(1000)), y=-2.0 * u),
        Record(name="m2", t=0.025 * np.arange(1000), channels={"u": slow, "y": -2.0 * slow}),
    ]
    found = cs.frequency_response(flown, "u", "y")
    assert found.response == pytest.approx(np.full(100, -2.0 + 0.0j), rel=1e-9)
    assert found.records == ("m1", "m2")


def test_the_phase_of_a_delay_runs_on() -> None:
    """-0.4 omega rad, far beyond a turn; a frequency without meaning between does not add one."""
    omega = np.linspace(1.0, 40.0, 60)
    response = np.exp(-0.4j * omega)
    usable = np.ones(60, dtype=bool)
    usable[20:23] = False
    response[20:23] = [-1.0, 1.0j, 1.0]
    assert phase_deg(response, usable)[usable] == pytest.approx(np.degrees(-0.4 * omega)[usable])


def test_the_result_is_told_in_every_form() -> None:
    pytest.importorskip("pandas")
    u, y = noisy(np.random.default_rng(11), 1.0)
    found = cs.frequency_response(record("m1", u=u, y=y), "u", "y")
    told = found.to_dict()
    assert told["omega"] == pytest.approx(found.omega) and len(told["gain_db"]) == 100
    assert told["windows"][0]["seconds"] == pytest.approx(13.0)
    assert found.to_frame()["coherence"].to_numpy() == pytest.approx(found.coherence)
    assert "not usable" in str(found) and "windows" in str(found)
    assert isinstance(found, FrequencyResponse) and "m1" in repr(found)


def test_what_cannot_be_estimated_is_refused() -> None:
    u, y = noisy(np.random.default_rng(12), 0.3)
    flown = record("m1", u=u, y=y, rest=np.zeros(len(u)))
    broken = record("m1", u=u, y=np.where(np.arange(len(y)) % 40 == 0, np.nan, y))
    for what, wrong in (
        ("did you mean 'y'", lambda: cs.frequency_response(flown, "u", "y_")),
        ("different", lambda: cs.frequency_response(flown, "u", "u")),
        ("does not move", lambda: cs.frequency_response(flown, "rest", "y")),
        ("does not move", lambda: cs.frequency_response(flown, "u", "y", other_inputs=["rest"])),
        ("two periods", lambda: cs.frequency_response(flown, "u", "y", omega=[0.1, 1.0])),
        ("averages", lambda: cs.frequency_response(flown, "u", "y", windows=[26.0])),
        ("longest has", lambda: cs.frequency_response(flown, "u", "y", windows=[30.0])),
        ("longest has", lambda: cs.frequency_response(broken, "u", "y", omega=[20.0, 150.0], windows=[10.0])),
        ("Nyquist", lambda: cs.frequency_response(flown, "u", "y", omega=[2.0, 200.0])),
        ("overlap", lambda: cs.frequency_response(flown, "u", "y", overlap=1.0)),
        ("increasing", lambda: cs.frequency_response(flown, "u", "y", omega=[3.0, 2.0])),
        ("windows", lambda: cs.frequency_response(flown, "u", "y", windows=[-1.0])),
    ):
        with pytest.raises(InputError, match=what):
            wrong()


def test_a_response_is_kept_whole(tmp_path) -> None:
    u, y = noisy(np.random.default_rng(13), 0.3)
    found = cs.frequency_response(record("m1", u=u, y=y), "u", "y")
    found.save(tmp_path / "response.casid")
    again = cs.load(tmp_path / "response.casid")
    assert again.response == pytest.approx(found.response, abs=0.0)
    assert math.isclose(again.random_error.max(), found.random_error.max())
